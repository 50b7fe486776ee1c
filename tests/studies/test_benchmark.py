"""The benchmark: its rows, its tables, and the place of a part of one's own."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from alloc.rules import RULES
from studies import benchmark, rank, standing
from studies.population import population
from studies.runner.study import run_study
from studies.statistics import in_digits

RULES_RUN, CONTROLLERS_RUN = ("alone", "cooperative", "oracle"), ("cut-and-ramp", "perturb-observe")


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Three events under some pairs; under the others the rows of `alone`."""

    def cells(events, seed):
        return [one for one in benchmark.cells(events, seed)
                if one.columns["rule"] in RULES_RUN and one.columns["controller"] in CONTROLLERS_RUN]  # fmt: skip

    made = run_study(replace(benchmark.STUDY, cells=cells), tmp_path_factory.mktemp("rows"), 3)
    assert set(made["status"]) == {"ok"}
    found = [made]
    alone = made[(made["rule"] == "alone") & made["knob"].isna()]
    for controller, rules in benchmark.UNDER.items():
        own = made[made["controller"] == controller]
        base = alone[alone["controller"] == (controller if len(own) else "perturb-observe")]
        found += [
            base.assign(rule=rule, controller=controller)
            for rule in sorted({*rules} - {*own["rule"]})
        ]
    base = alone[alone["controller"] == "perturb-observe"]
    found += [base.assign(controller=name) for name in ("none", "pi-creep")]
    return pd.concat(found, ignore_index=True)


def test_the_population_is_broad():
    drawn = pd.DataFrame([population.draw(7, k) for k in range(400)])
    assert set(drawn["fleet"]) == set(population.FLEETS)
    assert set(drawn["curve"]) == set(population.CURVES)
    assert drawn["case"].value_counts(normalize=True).between(0.1, 0.75).all()
    units = [population.event(7, k).event(k).world().units.size for k in range(40)]
    assert 1 < min(units) <= 3
    assert max(units) >= 14


def test_tuning_meets_no_event_that_judges():
    judging, tuning = ({population.event(seed, k).event(k).hash for k in range(10)}
                       for seed in (population.SEED, population.TUNING))  # fmt: skip
    assert not judging & tuning


def test_a_reported_rule_is_told_what_cooperative_is_told():
    event = population.event(population.SEED, 0)
    told = [benchmark.run(event, one, "perturb-observe", 0) for one in ("exact", "exact-reported")]
    assert told[0] != told[1]
    own = RULES["exact"].with_belief(RULES["cooperative"].belief.name)
    assert own.belief is RULES["cooperative"].belief


def test_tables_have_a_row_for_each_pair(rows):
    found = benchmark.table(rows)
    assert len(found) == sum(map(len, benchmark.UNDER.values()))
    alone = found[found["rule"] == "alone"]["gain over alone [points]"]
    assert set(alone) == {"+0.00"}
    controllers = benchmark.tabulate_controllers(rows).set_index("controller")
    assert controllers.loc["perturb-observe", "over perturb-observe [points]"] == "+0.00"
    parts = benchmark.tabulate_parts(rows).set_index("controller")
    assert parts.loc["perturb-observe", "starts"] == "+0.00"
    points = benchmark.tabulate_front(rows)
    own = points[points["own"]].set_index("controller")["used [%]"]
    used = benchmark.split_runs(rows, "alone")["cut-and-ramp"]["bound_use"].mean() * 100.0
    assert own["cut-and-ramp"] == pytest.approx(used)
    assert (points.groupby("controller").size()[["cut-and-ramp", "perturb-observe"]] == 5).all()


def test_all_tables_say_alike_how_gains_are_spread(rows):
    """Median, trimmed mean, worst, shares of gained and of harmed: of the table, of a rank, of their definitions."""
    gains = np.array([-0.04, -0.002, *[0.0] * 14, 0.002, 0.004, 0.01, 0.2])
    base = pd.DataFrame({"bound_use": np.full(20, 0.5)}, index=[f"event {k}" for k in range(20)])
    runs = base + gains[:, None]
    texts = [column.text(runs, base) for column in standing.DISTRIBUTION.values()]
    assert [text.split(" [")[0] for text in texts] == [
        "+0.00",
        "+0.04",
        "\N{MINUS SIGN}4.0",
        "15",
        "5",
    ]
    lost = {name: column.measure(base, runs) for name, column in standing.DISTRIBUTION.items()}
    assert lost["harmed"] == standing.DISTRIBUTION["gained"].measure(runs, base)
    pair, part = ("cooperative", "cut-and-ramp"), rows["rule"] == "cooperative"
    single = rows[part & (rows["controller"] == "cut-and-ramp")]
    ranked = rank.tabulate_gains(rows, single, pair).iloc[0]
    line = benchmark.table(rows).set_index(["controller", "rule"]).loc[pair[::-1]]
    for name, column in standing.DISTRIBUTION.items():
        number = ranked[name] * (1.0 if column.signed else column.scale)
        text = in_digits(number, column.digits, column.signed)
        assert line[column.heading].split(" [")[0] == text, name


def test_rows_are_read_as_they_were_stored(rows, tmp_path, monkeypatch):
    benchmark.store_rows(rows, tmp_path / "kept.parquet")
    monkeypatch.setattr(benchmark, "ROOT", tmp_path)
    with pytest.raises(benchmark.StudyError, match="readhesion benchmark"):
        benchmark.read_stored()
    monkeypatch.setattr(benchmark, "STORED", ("kept.parquet",))
    again = benchmark.read_stored()
    assert not benchmark.is_stale()
    assert benchmark.table(again).equals(benchmark.table(rows))
    assert (benchmark.tabulate_front(again)["own"] == benchmark.tabulate_front(rows)["own"]).all()
    again.attrs["sources"] = "others"
    monkeypatch.setattr(benchmark, "read_stored", lambda: again)
    assert benchmark.is_stale()


def test_a_rule_is_ranked_among_the_stored_ones(rows, monkeypatch):
    stored = rows.astype(dict.fromkeys(benchmark.METRICS_STORED, "float32"))
    own = rows[(rows["rule"] == "cooperative") & (rows["controller"] == "perturb-observe")]
    own = own.assign(bound_use=own["bound_use"] + 0.01)
    monkeypatch.setattr(rank, "read_stored", lambda: stored)
    pair = "mine", "perturb-observe"
    tables = rank.rank_study(*pair).make_tables(own)
    places, gains = tables["table"], tables["gains"]
    by = places.set_index("name")
    assert by.loc["mine", "used"] == pytest.approx(by.loc["cooperative", "used"] + 1.0, abs=1e-4)
    assert by.loc["cooperative", "less"] == pytest.approx(1.0, abs=1e-4)
    assert not by.loc["cooperative", "tied"]
    assert by.loc["oracle", "mark"] == "°"
    assert list(places["used"]) == sorted(places["used"], reverse=True)
    assert gains.loc[0, "number"] == 3
    runs = benchmark.split_runs(stored, "perturb-observe")
    expected = benchmark.find_gain(runs, "cooperative", "alone").mean() + 1.0
    assert gains.loc[0, "gain"] == pytest.approx(expected, abs=1e-4)
    said = rank.format_rank(pair, tables)
    assert max(map(len, said)) <= 80
    assert sum(one.startswith(">") for one in said) == 1


def test_a_controller_is_ranked_where_units_act_alone(rows):
    own = rows[(rows["rule"] == "alone") & (rows["controller"] == "pi-creep")]
    pair = "alone", "mine"
    places = rank.tabulate_places(rows, own, pair)
    gains = rank.tabulate_gains(rows, own, pair)
    by = places.set_index("name")
    assert by.loc["pi-creep", "tied"]
    assert gains.loc[0, "gain"] == pytest.approx(0.0, abs=1e-5)
    assert np.isnan(gains.loc[gains["number"] == 0, "worst"]).all()


def test_stored_rows_are_of_this_code():
    stored = benchmark.read_stored()
    assert stored["scenario"].nunique() >= 100
    pairs = (
        (1, "cooperative", "perturb-observe"),
        (14, "exact-reported", "mpc"),
        (9, "alone", "pi-creep"),
    )
    for k, rule, controller in pairs:
        row = benchmark.run(population.event(population.SEED, k), rule, controller, k)
        kept = stored[(stored["seed"] == k) & stored["knob"].isna()]
        kept = kept[(kept["rule"] == rule) & (kept["controller"] == controller)].iloc[0]
        for name in benchmark.METRICS_STORED:
            assert kept[name] == pytest.approx(row[name], rel=1e-3, abs=1e-4, nan_ok=True), name
