"""`readhesion export-controller` as a user meets it."""

import json

from alloc.onboard.equipment import equipment
from alloc.onboard.host import unit_contexts
from alloc.sources import ROOT
from mpc.export import unit_export
from mpc.export.c_kinds import TranslationError
from studies.scenario.loading import load_scenario
from tests.studies.conftest import SHORT


def test_the_files_are_those_of_the_unit_that_is_named(call, tmp_path):
    event = load_scenario("uneven-load").event()
    contexts = unit_contexts(
        event.model, equipment(event.model, event.onboard), event.onboard, "mpc"
    )
    for unit in (1, 4):
        code, out, err = call("export-controller", "uneven-load", "--unit", unit, "--out", tmp_path)
        assert (code, err) == (0, "")
        context = contexts[unit - 1]
        made = unit_export.export_unit(context, context.settings, f"unit {unit} of uneven-load")
        assert {path.name: path.read_text() for path in tmp_path.iterdir()} == made.contents
        assert f"{made.memory} bytes" in " ".join(out.split())
        about = json.loads(made.contents["made-from.json"])
        assert about["unit"]["axle_load"] == context.axle_load


def test_settings_of_the_scenario_count(call, tmp_path):
    (tmp_path / "own.toml").write_text(f"{SHORT}\n[onboard.mpc]\nhorizon = 7\n")
    code, _, err = call(
        "export-controller", tmp_path / "own.toml", "--unit", 1, "--out", tmp_path / "c"
    )
    assert (code, err) == (0, "")
    assert json.loads((tmp_path / "c" / "made-from.json").read_text())["settings"]["horizon"] == 7
    assert "double torques[7];" in (tmp_path / "c" / "controller.c").read_text()


def test_a_train_without_motors_has_no_controller(call, tmp_path):
    tram = (ROOT / "docs" / "plugins" / "tram.toml").read_text()
    (tmp_path / "car.toml").write_text(tram.replace('formation = "MTM"', 'formation = "TT"'))
    text = SHORT.replace("commuter-8car", "car.toml").replace("= 3.0", "= -3.0")
    text = text.replace("target_speed_kmh = 1.0", "initial_speed_kmh = 20.0")
    (tmp_path / "own.toml").write_text(text)
    code, _, err = call(
        "export-controller", tmp_path / "own.toml", "--unit", 1, "--out", tmp_path / "c"
    )
    assert code == 2
    assert "has no motors" in err
    assert not (tmp_path / "c").exists()


def test_a_translation_that_fails_is_one_line(call, tmp_path, monkeypatch):
    def refuse(*_):
        raise TranslationError("a.py, line 3: no translation to C for the statement try:")

    monkeypatch.setattr(unit_export, "export_unit", refuse)
    code, _, err = call("export-controller", "wet-patch", "--unit", 2, "--out", tmp_path / "c")
    assert code == 2
    assert "--unit 2: a.py, line 3: no translation to C" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "c").exists()
