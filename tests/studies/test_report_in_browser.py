"""The page in a real Chromium without network: it starts without a message, and what can be operated does what it says."""

import csv
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from studies.report import page
from studies.scenario.scenario import load_scenario
from tests.studies import report_pages
from tests.studies.conftest import SHORT

report_pages.need_packages()
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright: pip install -e '.[test]'")

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason=f"no browser; none of {', '.join(NAMES)} is installed"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "short.toml").write_text(SHORT)
    made = report_pages.make(load_scenario(folder / "short.toml"), folder / "results")
    material = replace(made.material, replays=[with_faults(one) for one in made.material.replays])
    (folder / "page.html").write_text(page.rendered(material), encoding="utf-8")
    return made, folder / "page.html"


def with_faults(one):
    """Two replays as they are where a run failed, and where one does not count."""
    if one.label == "milder/oracle/none/0":
        return replace(one, status="failed", reason="no <b>answer</b>", run={})
    if one.label == "milder/oracle/cut-and-ramp/0":
        return replace(one, status="degraded", reason="half of its calls")
    return one


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as started:
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=sandbox)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def said():
    """What pages say on the console or ask the network for."""
    return []


@pytest.fixture(autouse=True)
def silent(said):
    """Whatever a page says in a test fails it."""
    yield
    found = list(said)
    said.clear()
    assert found == []


@pytest.fixture(scope="module")
def opened(browser, made, said):
    """Open the page offline, on a screen of these properties."""
    contexts = []

    def opened(**screen):
        context = browser.new_context(offline=True, **screen)
        contexts.append(context)
        tab = context.new_page()
        tab.on("console", lambda message: said.append(message.text))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.on(
            "request", lambda request: request.url.startswith("file:") or said.append(request.url)
        )
        tab.goto(made[1].as_uri())
        tab.wait_for_selector("body[data-ready=yes]", timeout=60_000)
        return tab

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture(scope="module")
def tab(opened):
    """The page on a desk's screen, once for all tests: to start it takes longer than what they do."""
    return opened(viewport={"width": 1400, "height": 1000})


def test_the_browser_unpacks_the_same_numbers_as_python(tab, made):
    replay = made[0].material.replays[-1]
    wanted, _ = report_pages.unpacked(replay)
    found = tab.evaluate(
        """async (label) => {
          const content = JSON.parse(document.getElementById("content").textContent).replays[label];
          const run = await unpackRun(content), series = {};
          for (const [name, one] of Object.entries(run.series))
            series[name] = Array.from({length: one.columns ?? 1}, (_, column) => [...one.at(column)]);
          return series;
        }""",
        replay.label,
    )
    assert found.keys() == wanted.keys()
    for name, values in wanted.items():
        np.testing.assert_allclose(
            np.array(found[name]).T.reshape(values.shape), values, rtol=1e-6, atol=1e-9
        )


def test_slider_and_play_choose_the_instant(tab):
    tab.select_option("#pace", "0.25")
    slider, readout = tab.locator("#instant"), tab.locator("#readout")
    slider.fill("10")
    assert readout.inner_text().startswith("0.50 s")
    before = tab.evaluate("document.querySelector('#force-plot .cursor').style.left")
    slider.fill("30")
    assert readout.inner_text().startswith("1.50 s")
    assert tab.evaluate("document.querySelector('#force-plot .cursor').style.left") != before
    slider.fill("0")
    tab.click("#play")
    sync_api.expect(slider).not_to_have_value("0")
    assert tab.locator("#play").inner_text() == "❚❚ Pause"
    tab.click("#play")
    stopped = slider.input_value()
    tab.wait_for_timeout(300)
    assert slider.input_value() == stopped


def test_a_choice_shows_another_run_and_bars_have_its_forces(tab, made):
    tab.click('button[data-replay="milder/exact/none/0"]')
    sync_api.expect(tab.locator("#event-title")).to_contain_text("of <b>two")
    assert tab.locator("#rule").input_value() == "exact"
    tab.locator("#instant").fill("20")
    drawn = tab.evaluate(
        "document.getElementById('units-plot').data.find((one) => one.name === 'delivers').y"
    )
    replay = next(one for one in made[0].material.replays if one.label == "milder/exact/none/0")
    force = report_pages.unpacked(replay)[0]["rail_force"][20]
    structure = made[0].grid.scenarios[1].event(0).model.structure
    wanted = [force[structure.axle_unit == unit].sum() / 1e3 for unit in range(len(drawn))]
    np.testing.assert_allclose(drawn, wanted, rtol=1e-5)


def test_a_link_restores_run_and_instant_and_one_that_fits_nothing_is_passed_over(opened, made):
    tab = opened(viewport={"width": 1200, "height": 900})
    for name, value in (("event", "milder"), ("rule", "exact"), ("controller", "cut-and-ramp")):
        tab.select_option(f"#{name}", value)
    sync_api.expect(tab.locator("#event-title")).to_contain_text("exact under cut-and-ramp")
    tab.locator("#instant").fill("20")
    link = tab.locator("#link").get_attribute("href")
    assert link == "#replay=milder/exact/cut-and-ramp/alone/1.00"
    before = tab.evaluate(
        "['event', 'rule', 'controller'].map((one) => document.getElementById(one).value)"
    )
    tab.goto("about:blank")
    for address, wanted in ((link, before), ("#replay=none/exact/none/alone/1.00", None)):
        tab.goto(made[1].as_uri() + address)
        tab.wait_for_selector("body[data-ready=yes]", timeout=60_000)
        found = tab.evaluate(
            "['event', 'rule', 'controller'].map((one) => document.getElementById(one).value)"
        )
        if wanted is None:
            assert found[0] != "none"
        else:
            assert found == wanted
            assert tab.locator("#readout").inner_text().startswith("1.00 s")
        tab.goto("about:blank")


def test_tables_and_plots_are_given_as_files(opened, made):
    tab = opened(viewport={"width": 1200, "height": 900})
    files = {}
    for selector in ('[data-csv="standings"]', '[data-csv="runs"]', '[data-svg="force-plot"]'):
        with tab.expect_download() as download:
            tab.click(selector)
        files[download.value.suggested_filename] = download.value.path().read_text()
    assert files["force-plot.svg"].startswith("<svg")
    rows = list(csv.DictReader(files["runs.csv"].splitlines()))
    assert len(rows) == 12
    stored = made[0].rows
    own = stored[
        (stored["scenario"] == "short")
        & (stored["rule"] == "exact")
        & (stored["controller"] == "none")
    ]
    (row,) = (
        r for r in rows if (r["event"], r["rule"], r["controller"]) == ("short", "exact", "none")
    )
    assert float(row["bound_use"]) == pytest.approx(own["bound_use"].mean())
    assert [r["rule"] for r in csv.DictReader(files["standings.csv"].splitlines())].count(
        "exact"
    ) == 2


def test_a_run_that_failed_shows_its_reason_in_place_of_plots_and_a_degraded_one_both(tab):
    for name, value in (("event", "milder"), ("rule", "oracle"), ("controller", "none")):
        tab.select_option(f"#{name}", value)
    trouble, plots = tab.locator("#trouble"), tab.locator("#replay-plots")
    sync_api.expect(trouble).to_have_text("failed: no <b>answer</b>")
    assert not plots.is_visible()
    assert tab.locator("#play").is_disabled()
    tab.select_option("#controller", "cut-and-ramp")
    sync_api.expect(trouble).to_have_text("degraded: half of its calls")
    assert plots.is_visible()
    tab.select_option("#rule", "exact")
    sync_api.expect(trouble).to_be_hidden()


def test_filters_and_sorting_do_what_they_say(tab):
    visible = "#runs tbody tr:not([hidden])"
    tab.select_option("[data-filter=rule]", "exact")
    assert tab.locator(visible).count() == 4
    assert set(tab.locator(f"{visible} td[data-column=rule]").all_inner_texts()) == {"exact"}
    tab.select_option("[data-filter=scenario]", "milder")
    assert tab.locator("#shown").inner_text() == "2 of 12 rows"
    for name in ("rule", "scenario"):
        tab.select_option(f"[data-filter={name}]", "")

    def numbers(kind):
        cells = f"{visible} td.{kind}[data-column=slip_time]"
        texts = tab.locator(cells).evaluate_all("(some) => some.map((one) => one.dataset.number)")
        return [float(text) for text in texts if text]

    heading = tab.locator("#runs th[data-column=slip_time]")
    heading.locator("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    assert numbers("value") == sorted(numbers("value"))
    heading.locator("button").click()
    assert numbers("value") == sorted(numbers("value"), reverse=True)
    tab.check("#differences")
    assert len(numbers("difference")) == 8
    assert numbers("difference") == sorted(numbers("difference"), reverse=True)
    shown = tab.locator("#runs tbody tr:first-child td:visible").count()
    assert tab.locator("#runs thead th:visible").count() == shown
    tab.check("#more")
    assert tab.locator("#runs tbody tr:first-child td:visible").count() > shown
    assert (
        tab.locator("#runs thead th:visible").count()
        == tab.locator("#runs tbody tr:first-child td:visible").count()
    )


def test_a_heading_explains_itself_on_hover_and_by_keyboard(tab):
    box = tab.locator("#hint")
    tab.locator("#runs th[data-column=damage] button").hover()
    assert "wheel damage Q" in box.inner_text()
    assert "[kJ]" in box.inner_text()
    tab.keyboard.press("Escape")
    assert not box.is_visible()
    tab.locator("#runs th[data-column=utilisation] button").focus()
    assert "adhesion used" in box.inner_text()


def test_nothing_is_wider_than_a_phone_and_paper_has_all_columns(opened):
    tab = opened(viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    assert tab.locator("#play").bounding_box()["height"] >= 32
    assert (
        float(
            tab.evaluate(
                "parseFloat(getComputedStyle(document.querySelector('#runs td')).fontSize)"
            )
        )
        >= 12
    )
    tab.emulate_media(media="print")
    assert not tab.locator("#play").is_visible()
    assert tab.locator("#runs thead .paper").first.is_visible()
    assert tab.pdf(prefer_css_page_size=True).startswith(b"%PDF")


BARS = "some => some.map((one) => one.getBoundingClientRect()).map((box) => [box.left, box.right])"


def test_a_part_of_a_train_gives_bars_a_width_and_any_part_can_be_chosen(opened, tab):
    """A train that fits the screen is shown whole; else every car is in one part, and one of them comes first."""
    tab.select_option("#event", "short")
    assert not tab.locator("#part").is_visible()
    phone = opened(viewport={"width": 320, "height": 640}, is_mobile=True, has_touch=True)
    part = phone.locator("#part")
    assert part.is_visible()
    named = part.locator("option").all_inner_texts()
    assert named == ["all 8 cars", "cars 1 to 3", "cars 4 to 5", "cars 6 to 8"]
    assert part.input_value() != "-1"
    frame = phone.locator("#train-plot .nsewdrag").first.bounding_box()
    left, right = frame["x"], frame["x"] + frame["width"]
    seen = []
    for value, axles in (("0", (1, 12)), ("1", (13, 20)), ("2", (21, 32))):
        part.select_option(value)
        boxes = phone.locator("#train-plot .barlayer .point path").evaluate_all(BARS)
        own = range(axles[0], axles[1] + 1)
        assert all(left <= boxes[axle - 1][0] < boxes[axle - 1][1] <= right for axle in own)
        assert all(boxes[axle - 1][1] - boxes[axle - 1][0] >= 3.5 for axle in own)
        seen += own
        ends = phone.evaluate("document.getElementById('slip-plot').layout.yaxis.range")
        assert ends == [axles[1] + 0.5, axles[0] - 0.5]
    assert seen == list(range(1, 33))
    assert phone.evaluate("document.documentElement.scrollWidth") <= 320


def test_in_a_browser_that_cannot_unpack_the_table_works_and_the_page_says_why_plots_do_not(
    browser, made
):
    context = browser.new_context(offline=True)
    context.add_init_script("delete window.DecompressionStream")
    old = context.new_page()
    old.goto(made[1].as_uri())
    sync_api.expect(old.locator("#plot-note")).to_contain_text("too old to unpack the plots")
    old.select_option("[data-filter=rule]", "exact")
    assert old.locator("#shown").inner_text() == "4 of 12 rows"
    context.close()
