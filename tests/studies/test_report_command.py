"""`readhesion report` as a user meets it: what it writes, what it does not do twice; bad input is in the battery."""

import sys

import pytest

from tests.studies import report_pages
from tests.studies.test_plugins import plain  # noqa: F401 what a plug-in registers is taken back

report_pages.need_packages()

RAISING = """
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.onboard.host import CONTROLLERS


class Raising:
    def __init__(self, context):
        pass

    def decide(self, sense):
        if sense.time > 0.4:
            raise RuntimeError("no </td> today")
        return TorqueDecision(sense.target, True, "ok", 0.0)


CONTROLLERS.register("raising", HostedController("raising", "breaks after a while", each_unit(Raising)))
"""


@pytest.fixture
def report(call, short_file, tmp_path):
    """Run the command on the short event; gives exit code, stdout, stderr."""

    def report(*options: object) -> tuple[int, str, str]:
        return call(
            "report", "--scenario", short_file, "--rules", "alone,exact", "--controllers", "none", "--seeds", 2, "--jobs", 1,
            "--results", tmp_path / "results", "--out", tmp_path / "page.html", *options,
        )  # fmt: skip

    return report


def test_a_second_call_runs_nothing_and_replaces_the_file(report, tmp_path, monkeypatch):
    assert report()[0] == 0
    first = (tmp_path / "page.html").read_text()
    (tmp_path / "page.html").write_text("old")
    monkeypatch.setattr("studies.core.runner.run_cell", None)
    code, out, _ = report()
    assert code == 0
    assert "4 runs, 2 replays" in out
    again = (tmp_path / "page.html").read_text()
    unlike = [
        pair
        for pair in zip(first.splitlines(), again.splitlines(), strict=True)
        if pair[0] != pair[1]
    ]
    assert all("<dt>made</dt>" in one for one, _ in unlike)


def test_rows_of_a_comparison_are_taken_over(call, report, short_file, tmp_path):
    options = (
        "--rules",
        "alone,exact",
        "--controllers",
        "none",
        "--seeds",
        2,
        "--jobs",
        1,
        "--no-figures",
        "--json",
    )
    call("compare", "--scenario", short_file, *options, "--out", tmp_path / "results")
    before = sorted((tmp_path / "results" / "rows").iterdir())
    assert report()[0] == 0
    assert sorted((tmp_path / "results" / "rows").iterdir()) == before


def test_a_page_that_cannot_be_made_leaves_the_old_one(report, tmp_path, monkeypatch):
    (tmp_path / "page.html").write_text("old")
    monkeypatch.setattr("studies.report.page.MOST_BYTES", 10)
    monkeypatch.setattr("studies.report.page.rendered.__defaults__", (10,))
    code, _, err = report()
    assert code == 2
    assert "fewer events" in err
    assert (tmp_path / "page.html").read_text() == "old"


def test_runs_that_fail_are_shown_with_their_reason(call, short_file, tmp_path):
    plugin = tmp_path / "raising.py"
    plugin.write_text(RAISING)
    page = tmp_path / "page.html"
    code, out, _ = call(
        "--plugin", plugin, "report", "--scenario", short_file, "--rules", "alone", "--controllers", "none,raising",
        "--seeds", 1, "--jobs", 1, "--results", tmp_path / "results", "--out", page,
    )  # fmt: skip
    text = page.read_text()
    assert code == 0
    assert "1 failed" in out
    assert "1 of 1 failed" in text
    assert "RuntimeError: no &lt;/td&gt; today" in text
    assert 'data-replay="short/alone/none/0"' in text
    assert 'data-replay="short/alone/raising/0"' not in text
    assert "2 runs, of which 1 count" in text


def test_a_missing_package_is_named_before_anything_is_run(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "plotly", None)
    code, _, err = call("report", "--scenario", "wet-patch")
    assert code == 2
    assert "pip install 'readhesion[report]'" in err
    assert not list(tmp_path.iterdir())
