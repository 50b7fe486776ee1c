"""`readhesion export-controller` as a user meets it."""

import json
import re

from alloc.onboard.equipment import equipment
from alloc.onboard.host import unit_contexts
from alloc.sources import ROOT
from mpc.export import export_unit
from studies.scenario.loading import load_scenario
from tests.studies.conftest import SHORT


def contexts_of(scenario):
    event = load_scenario(scenario).event()
    return unit_contexts(event.model, equipment(event.model, event.onboard), event.onboard, "mpc")


def memory_in(files):
    return int(re.search(r"MEMORY (\d+)", files["controller.h"].decode()).group(1))


def test_unit_processor_and_settings_of_the_scenario_count(call, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(f"{SHORT}\n[onboard.mpc]\nhorizon = 7\n")

    def exported(*arguments):
        out = tmp_path / f"unit {arguments[2]}"
        code, printed, err = call("export-controller", *arguments, "--out", out)
        assert (code, err) == (0, "")
        files = {path.name: path.read_bytes() for path in out.iterdir()}
        return files, " ".join(printed.split()), json.loads(files["made-from.json"])

    files, printed, _ = exported("uneven-load", "--unit", 1)
    context = contexts_of("uneven-load")[0]
    made = export_unit(context, context.settings, "x86-64", "unit 1 of uneven-load")
    assert files == made.contents
    assert f"{made.memory} bytes" in printed
    short, _, about = exported(own, "--unit", 4, "--target", "aarch64")
    assert about["unit"]["axle_load"] == contexts_of(own)[3].axle_load
    assert about["settings"]["horizon"] == 7
    assert "aarch64" in short["made-from.json"].decode()
    assert memory_in(short) < 0.5 * memory_in(files)


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
