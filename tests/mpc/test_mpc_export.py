"""The controller of a unit in C is the one that Numba compiles: every answer, its memory, and nothing beside it."""

import re
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.simulation import simulate
from mpc.export.unit_export import export_unit
from mpc.settings import MpcSettings, SlipSearch
from mpc.unit_step import STATUSES
from studies.scenario.loading import load_scenario
from tests.mpc.conftest import make_unit
from tests.mpc.exported import STRICT, InC, InNumba, needs_compiler, run_compiler, run_tool, write

RELATIVE = 1e-9
"""Of torques. Numba joins multiplications and additions into one rounding where the processor can, C99 does not."""
AMPLIFIED = 1e-8
"""The same in a closed loop: steps that are far from converged amplify rounding. Compiled twice, with such instructions and
without, the C differs from itself by 1.4e-9 in one of 1200 periods."""


def _same(context, settings, senses, folder, flags=("-O0",), relative=RELATIVE):
    """Ask both the same; returns status and number of SQP steps of each period."""
    in_c, in_numba = InC(context, settings, folder, *flags), InNumba(context, settings)
    statuses, steps = [], []
    step_time = (settings or MpcSettings()).step_time
    for sense in senses:
        found, wanted = in_c.decide(sense), in_numba.decide(sense)
        for name in ("status", "usable", "solve_time"):
            assert found[name] == wanted[name]
        assert found["torque"] == pytest.approx(wanted.torque, rel=relative, abs=1e-9)
        assert found["residual"] == pytest.approx(
            wanted.residual, rel=1e-6, abs=1e3 * relative, nan_ok=True
        )
        statuses.append(STATUSES[wanted.status])
        steps.append(wanted.solve_time / step_time)
    return statuses, steps


@pytest.fixture
def senses(make_sense):
    """Function (axles) -> readings with slips, changes of direction, no demand, and some that are no numbers."""

    def make(axles=4, seed=3):
        rng, torque, sign = np.random.default_rng(seed), 0.0, 1.0
        for tick in range(120):
            sign = -sign if tick in (50, 70) else sign
            target = 0.0 if tick in (30, 31, 90) else sign * rng.uniform(300.0, 1100.0)
            slip = sign * rng.choice([0.003, 0.02, 0.3]) * rng.uniform(0.5, 1.5)
            torque = 0.7 * torque + 0.3 * sign * rng.uniform(100.0, 700.0)
            estimate = rng.uniform(0.0, 0.15)
            sense = make_sense(
                10.0 + 0.01 * tick, slip, torque, target, axles, coefficient=estimate
            )
            if tick in (12, 76):
                sense = sense._replace(**{"torque" if tick == 12 else "drive_limit": np.nan})
            yield sense._replace(omega=np.full(axles, np.inf)) if tick == 75 else sense

    return make


SETTINGS = {
    "default": MpcSettings(),
    "short": MpcSettings(horizon=8),
    "delayed, longer steps": MpcSettings(computing_delay=1, step=0.025, horizon=10),
    "late and delayed": MpcSettings(computing_delay=1, step_time=0.02),
    "apart": MpcSettings(phases_apart=True),
}


@needs_compiler
@pytest.mark.parametrize("name", SETTINGS)
def test_every_answer_is_that_of_numba(context, senses, tmp_path, name):
    # nothing depends on how the compiler is asked to optimise
    level = {"default": "-O2", "short": "-O1"}.get(name, "-O0")
    statuses, _ = _same(context, SETTINGS[name], senses(), tmp_path, [level])
    late = {"late"} if SETTINGS[name].step_time > 0.01 else set()
    assert set(statuses) == {"reading not finite", "ok"} | late


@needs_compiler
def test_the_phases_one_by_one_are_a_step(context, senses, tmp_path):
    one = InC(context, MpcSettings(phases_apart=True), tmp_path, "-O0")
    whole = [one.decide(sense).tobytes() for sense in senses()]
    one.start()
    one.step = one.step_in_phases
    assert [one.decide(sense).tobytes() for sense in senses()] == whole
    header = export_unit(context).contents["controller.h"]
    assert "controller_feedback" not in header, "a step alone has no phases"


@needs_compiler
@pytest.mark.parametrize("axles", [1, 6])
def test_units_of_any_number_of_axles_are_exported(senses, tmp_path, axles):
    _same(make_unit(axles=axles), None, senses(axles), tmp_path)


@needs_compiler
# the slip of Polach's peak is searched for: at a maximum, rounding moves it by the root of itself
@pytest.mark.parametrize(("curve", "relative"), [("polach", 1e-5), ("slip-ratio", 1e-9)])
def test_slip_may_be_held_at_that_of_a_given_curve(senses, tmp_path, curve, relative):
    settings = MpcSettings(search=SlipSearch(seek=False))
    _same(make_unit(curve), settings, senses(), tmp_path, relative=relative)


def _recorded(name, duration, rule="alone", unit=0):
    """Context, settings and readings of a unit in a closed loop."""
    made = []

    class Recorder(InNumba):
        def __init__(self, context):
            super().__init__(context, context.settings)
            self.context, self.senses = context, []
            made.append(self)

        def decide(self, sense):
            self.senses.append(sense._replace(omega=sense.omega.copy()))
            found = super().decide(sense)
            return TorqueDecision(
                float(found.torque),
                bool(found.usable),
                STATUSES[found.status],
                float(found.solve_time),
            )

    event = replace(load_scenario(name).event(), duration=duration)
    simulate(event, rule, HostedController("mpc", "recorded", each_unit(Recorder)))
    return made[unit].context, made[unit].senses


@needs_compiler
@pytest.mark.parametrize(
    ("name", "duration", "busy"), [("wet-patch", 12.0, 30), ("wet-stop", 5.0, 0)]
)
def test_the_closed_loop_is_the_same(tmp_path, name, duration, busy):
    context, senses = _recorded(name, duration)
    assert len(senses) == round(duration / context.period)
    bad = 200
    senses[bad] = senses[bad]._replace(speed=np.nan)
    for k in range(bad + 20, bad + 60):  # the driver changes his mind
        senses[k] = senses[k]._replace(target=-senses[k].target)
    statuses, steps = _same(context, context.settings, senses, tmp_path, relative=AMPLIFIED)
    assert [k for k, one in enumerate(statuses) if one != "ok"] == [bad]
    assert sum(one > 1.5 for one in steps) >= busy, "without slip there is little to solve"


@needs_compiler
def test_a_start_forgets_all(context, senses, tmp_path):
    one = InC(context, None, tmp_path, "-O0")
    first = [one.decide(sense).copy() for sense in senses()]
    one.start()
    for sense, before in zip(senses(), first, strict=True):
        np.testing.assert_array_equal(one.decide(sense)["torque"], before["torque"])


def test_it_includes_and_calls_nothing_but_mathematics(context):
    for settings in SETTINGS.values():
        contents = export_unit(context, settings).contents
        code = contents["controller.h"] + contents["controller.c"]
        assert set(re.findall(r"#\s*include\s*(\S+)", code)) == {
            '"controller.h"', "<math.h>", "<stdint.h>", "<stdbool.h>",
        }  # fmt: skip
        assert not re.search(
            r"\b(malloc|calloc|realloc|free\s*\(|printf|mem(cpy|set)|alloca)\b", code
        )


@needs_compiler
@pytest.mark.skipif(
    sys.platform != "linux" or not shutil.which("size"), reason="no GNU binutils on this machine"
)
def test_only_mathematics_is_linked(context, tmp_path):
    folder = write(export_unit(context), tmp_path)
    run_compiler(folder, *STRICT, "-ffreestanding", "-c", "controller.c")
    symbols = run_compiler(folder, "-print-prog-name=nm").strip()
    needed = run_tool(symbols, "-u", folder / "controller.o").split()[1::2]
    # a compiler may copy and fill by these two, whatever the source says
    assert {*needed} - {"memcpy", "memset"} <= {
        "sin",
        "cos",
        "exp",
        "log",
        "fmod",
        "sqrt",
        "ceil",
        "fabs",
    }
    sections = run_tool("size", "-A", folder / "controller.o")
    found = {line.split()[0]: int(line.split()[1]) for line in sections.splitlines()[2:] if line}
    stated = re.search(r"#define CONTROLLER_MEMORY (\d+)", (folder / "controller.h").read_text())
    assert found.get(".data", 0) + found[".bss"] == int(stated.group(1))


def test_the_output_depends_on_unit_and_settings_alone(context):
    first, again = (export_unit(context, MpcSettings(), "unit 1").contents for _ in range(2))
    assert first == again
    assert first["README"].count("\n") == 5
    assert export_unit(context, MpcSettings(headroom=0.2)).contents != first
