"""The page of a comparison: it works offline at two widths, names are text, and mistakes are one line."""

import re
import sys
from pathlib import Path

import pandas as pd
import pytest

from alloc.rules import RULES
from studies import StudyError
from studies.command.report import write_report
from studies.compare import choose_grid, make_study
from studies.files.scenario_files import load_scenario
from studies.runner.study import run_study

CHROMIUM = Path("/usr/bin/chromium")
OPTIONS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
CHOICES = (("wet-patch", "greedy"), ("wet-patch", "cooperative"), ("failed-unit", "greedy"))
NASTY = '<b onclick="alert(1)">mine</b></script>'


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    events = [load_scenario(name) for name in ("wet-patch", "failed-unit")]
    chosen = choose_grid(events, ["alone", "greedy", "cooperative"], ["cut-and-ramp"], 1)
    return run_study(make_study(chosen), tmp_path_factory.mktemp("compare"))


def page_of(rows: pd.DataFrame, folder: Path, events: tuple[str, ...] = ()) -> Path:
    rows.to_parquet(folder / "rows.parquet")
    write_report(folder, folder / "report.html", events)
    return folder / "report.html"


@pytest.mark.skipif(not CHROMIUM.exists(), reason="the system has no Chromium")
@pytest.mark.parametrize("width", [1400, 390])
def test_page_works_offline(rows, tmp_path, width):
    browsers = pytest.importorskip("playwright.sync_api")
    path = page_of(rows, tmp_path)
    assert path.stat().st_size < 12e6
    with browsers.sync_playwright() as program:
        browser = program.chromium.launch(executable_path=str(CHROMIUM), args=OPTIONS)
        page = browser.new_page(viewport={"width": width, "height": 800}, offline=True)
        page.set_default_timeout(240e3)  # the machine may be busy
        messages: list[str] = []
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.goto(path.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= width

        def column(number):
            cells = f"#numbers tbody tr:not([hidden]) td:nth-child({number})"
            return page.locator(cells).all_inner_texts()

        used = page.locator("#numbers th:nth-child(3) button")
        used.press("Enter")
        most_first = column(3)
        assert most_first == sorted(most_first, key=float, reverse=True)
        used.press("Enter")
        assert column(3) == most_first[::-1]
        page.fill("#filter", "COOP")
        assert [name.rstrip("=*") for name in column(1)] == ["cooperative"]

        seen = set()
        for event, rule in CHOICES:
            page.select_option("#event", event)
            page.select_option("#rule", rule)
            page.locator("#instant").fill("70")
            assert page.locator(".run").last.locator("xpath=../h3").inner_text().startswith(rule)
            seen.add(page.locator(".run").last.evaluate("plot => String(plot.data[1].y)"))
        assert len(seen) == 3
        assert not messages
        browser.close()


def test_names_are_text(rows, tmp_path, monkeypatch):
    monkeypatch.setitem(RULES._parts, NASTY, RULES["greedy"])
    monkeypatch.setitem(RULES._origins, NASTY, RULES.origin("greedy"))
    nasty = rows.replace({"rule": {"greedy": NASTY}, "scenario": {"failed-unit": NASTY}})
    text = page_of(nasty, tmp_path).read_text("utf-8")
    assert "mine" in text
    assert "<b onclick" not in text
    assert "mine</b>" not in text


def test_mistakes_are_one_line(rows, tmp_path, monkeypatch):
    with pytest.raises(StudyError, match="run readhesion compare first"):
        write_report(tmp_path / "nowhere", tmp_path / "report.html")
    with pytest.raises(StudyError, match="'mine' of this comparison is not registered"):
        page_of(rows.replace({"rule": {"greedy": "mine"}}), tmp_path)
    with pytest.raises(StudyError, match="not as its stored row says"):
        page_of(rows.assign(bound_use=0.5), tmp_path)
    with pytest.raises(StudyError, match="'wet-start' is not in this comparison"):
        page_of(rows, tmp_path, ("wet-start",))
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(StudyError, match=re.escape("pip install 'readhesion[report]'")):
        page_of(rows, tmp_path)
