"""`readhesion analyse` and `readhesion simulate --log` as a user meets them; bad input is in the battery."""

import json

import pandas as pd
import pytest

from alloc.recording import save
from studies.logs.remarks import MOST
from studies.logs.simulated import write_log
from tests.simulation.slides import TRAIN, braked, readhering


@pytest.fixture
def log(tmp_path):
    """Log of three cars that slide."""
    path = tmp_path / "slide.csv"
    write_log(braked(readhering, duration=6.0), TRAIN, path)
    return path


def test_a_simulated_event_goes_out_as_a_log_and_comes_back(call, short_file, tmp_path):
    path = tmp_path / "event.csv"
    code, out, _ = call("simulate", short_file, "--json", "--log", path)
    damage = json.loads(out)["metrics"]["damage"]
    assert code == 0
    code, out, _ = call("analyse", path, "--train", tmp_path / "event.train.toml", "--json")
    content = json.loads(out)
    assert code == 0
    assert content["remarks"] == []
    assert content["rows"] == 200
    assert content["damage_kj"] == pytest.approx(damage, rel=5e-3)  # torques jump between records
    assert len(content["axles"]) == 32


def test_tables_and_a_figure_are_printed_and_json_has_everything(call, log, tmp_path):
    code, out, _ = call(
        "analyse", log, "--train", "jp4209318-3car", "--figure", tmp_path / "log.png"
    )
    assert code == 0
    assert all(text in out for text in ("slips and slides", "Q [kJ]", "from [s]", "wheel damage Q"))
    assert (tmp_path / "log.png").read_bytes().startswith(b"\x89PNG")
    _, out, _ = call("analyse", log, "--train", "jp4209318-3car", "--json", "--slip-percent", 2)
    content = json.loads(out)
    assert content["criterion"] == {"slip_velocity_ms": pytest.approx(0.2), "slip_ratio": 0.02}
    assert {event["kind"] for event in content["events"]} == {"slide"}
    assert content["cars"] is None
    assert content["axles"][0]["slides"] >= 1


def test_remarks_of_one_kind_are_one_line(call, log, tmp_path):
    table = pd.read_csv(log)
    table.loc[::13, "axle1_speed_kmh"] = None
    spoilt = tmp_path / "spoilt.csv"
    table.drop(index=range(100, 150)).to_csv(spoilt, index=False)
    code, out, _ = call("analyse", spoilt, "--train", "jp4209318-3car")
    assert code == 0
    assert "gap of 0.51 s from 0.99 s to 1.5 s" in out
    assert "no value in 43 rows, the first 1, interpolated" in out
    _, out, _ = call("analyse", spoilt, "--train", "jp4209318-3car", "--json")
    assert len(json.loads(out)["remark_groups"]) <= MOST


def test_several_logs_give_a_report_each_and_a_list_of_slips(call, log, tmp_path):
    other = tmp_path / "other.csv.gz"
    pd.read_csv(log).to_csv(other, index=False)
    code, out, _ = call(
        "analyse", log, other, tmp_path / "none.csv", "--train", "jp4209318-3car",
        "--out", tmp_path / "reports", "--events", tmp_path / "slips.csv",
    )  # fmt: skip
    assert code == 0
    assert "failed" in out
    assert "none.csv" in out
    reports = sorted(path.name for path in (tmp_path / "reports").iterdir())
    assert reports == ["other.csv.gz.json", "slide.csv.json"]
    found = json.loads((tmp_path / "reports" / "slide.csv.json").read_text())
    slips = pd.read_csv(tmp_path / "slips.csv")
    assert len(slips) == 2 * (len(found["events"]) + len(found["small_events"]))
    assert set(slips["kind"]) == {"slide"}


def test_a_log_is_compared_with_a_run_of_the_same_train_alone(call, log):
    own = ("analyse", log, "--train", "jp4209318-3car")
    code, out, _ = call(*own, "--against", log, "--resistance", "--brakes", "--json")
    assert code == 0
    content = json.loads(out)
    assert content["comparison"]["log"] == content["comparison"]["simulated"]
    assert content["comparison"]["damage_differs"] is False
    assert set(content["resistance"]["weights"]) == {"W1", "W2", "W3", "A", "B"}
    assert content["brakes"] is None  # its couplers are not measured
    code, _, err = call(*own, "--against", "wet-stop")
    assert code == 2
    assert "give a run of the same train" in err


def test_a_log_is_compared_with_a_recorded_run(call, tmp_path):
    run = braked(readhering, duration=6.0)
    path, recorded = tmp_path / "slide.csv", tmp_path / "slide.nc"
    write_log(run, TRAIN, path)
    save(run, recorded)
    options = ("analyse", path, "--train", tmp_path / "slide.train.toml", "--json", "--against")
    code, out, _ = call(*options, recorded)
    content = json.loads(out)["comparison"]
    assert code == 0
    for name in ("duration_s", "damage_kj", "slides"):
        assert content["log"][name] == pytest.approx(content["simulated"][name], rel=2e-3)

    save(run.drop_vars("unit_gear"), tmp_path / "part.nc")
    (tmp_path / "text.nc").write_text("time_s;v")
    save(run.assign_attrs(train_mass=2e5), tmp_path / "light.nc")
    for name, words in (
        ("part.nc", "has no 'unit_gear'"),
        ("text.nc", "is no file of netCDF"),
        ("light.nc", "200.0 t, that of the log"),
        ("none.nc", "does not exist"),
    ):
        code, _, err = call(*options, tmp_path / name)
        assert code == 2
        assert words in " ".join(err.split())
