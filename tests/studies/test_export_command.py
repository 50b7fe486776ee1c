"""`readhesion export-controller` as a user meets it."""

import json
import re

from alloc.onboard.equipment import equipment
from alloc.onboard.host import unit_contexts
from alloc.sources import ROOT
from mpc.export import export_unit
from studies.scenario.loading import load_scenario
from tests.studies.conftest import SHORT


def test_the_files_are_those_of_the_unit_and_the_processor_that_are_named(call, tmp_path):
    event = load_scenario("uneven-load").event()
    contexts = unit_contexts(
        event.model, equipment(event.model, event.onboard), event.onboard, "mpc"
    )
    for unit, target in ((1, "x86-64"), (4, "aarch64")):
        named = () if unit == 1 else ("--target", target)
        code, out, err = call(
            "export-controller", "uneven-load", "--unit", unit, "--out", tmp_path, *named
        )
        assert (code, err) == (0, "")
        context = contexts[unit - 1]
        made = export_unit(context, context.settings, target, f"unit {unit} of uneven-load")
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == made.contents
        assert f"{made.memory} bytes" in " ".join(out.split())
        about = json.loads(made.contents["made-from.json"])
        assert about["unit"]["axle_load"] == context.axle_load


def test_settings_of_the_scenario_count(call, tmp_path):
    (tmp_path / "own.toml").write_text(f"{SHORT}\n[onboard.mpc]\nhorizon = 7\n")
    memory = {}
    for name in (tmp_path / "own.toml", "wet-patch"):
        code, _, err = call("export-controller", name, "--unit", 1, "--out", tmp_path / "c")
        assert (code, err) == (0, "")
        horizon = json.loads((tmp_path / "c" / "made-from.json").read_text())["settings"]["horizon"]
        memory[horizon] = re.search(r"MEMORY (\d+)", (tmp_path / "c" / "controller.h").read_text())
    assert int(memory[7].group(1)) < 0.5 * int(memory[20].group(1))


def test_a_processor_that_cannot_be_had_is_one_line(call, tmp_path):
    for target in ("armv7", "powerpc64", "x86-64-v9"):
        command = ("export-controller", "wet-patch", "--unit", 2, "--out", tmp_path / "c")
        code, _, err = call(*command, "--target", target)
        assert code == 2
        assert f"target = '{target}' must be one of x86-64" in " ".join(err.split())
        assert err.count("\n") == 1
        assert not (tmp_path / "c").exists()


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
