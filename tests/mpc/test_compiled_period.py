"""The compiled control period of a unit's MPC is the one in Python, and an exported one is the one that Numba compiles."""

import ctypes
import json
import platform
import re
import shutil
from dataclasses import replace
from functools import partial

import llvmlite.binding as llvm
import numpy as np
import pytest
from numba.core.runtime import _nrt_python

from alloc import object_file
from alloc.object_file import LINKED
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.simulation import simulate
from mpc.belief import with_predicted_curve
from mpc.export import export_unit
from mpc.hosted import MPC
from mpc.model import unit_model
from mpc.period import RealTimeIteration
from mpc.settings import MpcError, MpcSettings, PeakBelief, SlipSearch
from mpc.unit import STATUSES, MpcController
from studies.ladder import locomotive_study
from studies.scenario.scenario import load_scenario
from tests.benchmarks.peers import DaqpIteration, step_function
from tests.cases import looped
from tests.mpc.conftest import make_unit
from tests.mpc.exported import InNumba, asked, link, of_numba, packed, run_tool, write


def _readings(make_sense, seed):
    """Readings as they come, with slips, changes of direction, no demand, and some that are no numbers."""
    rng, torque, sign = np.random.default_rng(seed), 0.0, 1.0
    for tick in range(120):
        sign = -sign if tick in (50, 70) else sign
        target = 0.0 if tick in (30, 31, 90) else sign * rng.uniform(300.0, 1100.0)
        slip = sign * rng.choice([0.003, 0.02, 0.3]) * rng.uniform(0.5, 1.5)
        torque = 0.7 * torque + 0.3 * sign * rng.uniform(100.0, 700.0)
        bad = {12: "torque", 75: "omega", 76: "drive_limit"}.get(tick)
        sense = make_sense(
            10.0 + 0.01 * tick, slip, torque, target, coefficient=rng.uniform(0.0, 0.15)
        )
        if bad:
            sense = sense._replace(**{bad: np.full(4, np.inf) if bad == "omega" else np.nan})
        yield sense


@looped(
    "settings",
    [
        MpcSettings(),
        MpcSettings(step=0.02, horizon=10),
        MpcSettings(step_time=3e-3, headroom=0.3),
        MpcSettings(step_time=0.02),
        MpcSettings(computing_delay=1),
        MpcSettings(computing_delay=1, compensated=False),
        MpcSettings(computing_delay=1, step_time=0.02),
        MpcSettings(computing_delay=1, step=0.025, horizon=10),
    ],
)
def test_every_answer_is_that_in_python(context, make_sense, settings):
    one, other = InNumba(context, settings), MpcController(context, settings)
    statuses = set()
    for sense in _readings(make_sense, 3):
        found, wanted = one.decide(sense), other.decide(sense)
        assert (bool(found.usable), STATUSES[found.status]) == (wanted.ok, wanted.status)
        assert found.torque == pytest.approx(wanted.torque, rel=1e-9, abs=1e-9)
        assert found.solve_time == pytest.approx(wanted.solve_time, rel=1e-12)
        assert found.residual == pytest.approx(wanted.residual, rel=1e-6, abs=1e-9, nan_ok=True)
        statuses.add(wanted.status)
    assert statuses == {
        "reading not finite",
        "ok",
        *(["late"] if settings.step_time > 0.01 else []),
    }


@looped(
    ("name", "rule", "duration"), [("wet-patch", "alone", 9.0), ("wet-stop", "cooperative", 5.0)]
)
def test_the_closed_loop_is_the_references(name, rule, duration):
    event = replace(load_scenario(name).event(), duration=duration)
    own = simulate(event, rule, MPC)
    assert own.attrs["controller_failures"] == 0
    slip = np.abs(own["slip_velocity"].values)
    assert (slip > own["peak_slip"].values).any(), "without slip there is little to solve"
    command = own["torque_command"].values
    for kind in (RealTimeIteration, DaqpIteration):
        in_python = HostedController("mpc", "", each_unit(partial(MpcController, iteration=kind)))
        other = simulate(event, rule, in_python)
        for key in ("controller_calls", "controller_failures", "controller_time_s", "messages"):
            assert own.attrs[key] == other.attrs[key]
        np.testing.assert_allclose(
            command, other["torque_command"].values, atol=1e-8 * np.abs(command).max()
        )


FIXED = MpcSettings(belief=PeakBelief(initial=0.12, floor=0.12 - 1e-12, ceiling=0.12))


"""A belief about the peaks that stays as it is."""


@looped("code", ["unit_step", "python"])
def test_with_a_perfect_model_a_delayed_command_is_found_from_the_state_it_acts_on(
    context, make_sense, code
):
    settings = replace(FIXED, computing_delay=1)
    if code == "python":
        controller = MpcController(context, settings)
        now = controller._solver.period.now
    else:
        controller = InNumba(context, settings)
        now = controller.controller.kept[1].period.now
    model = unit_model(with_predicted_curve(context))
    state, commands = np.array([10.0, *[10.1 / 0.43] * 4, 500.0]), []
    for _ in range(60):
        sense = make_sense(speed=state[0], torque=state[5])._replace(omega=state[1:5].copy())
        commands.append(float(controller.decide(sense).torque))
        step = step_function(model, context.period, int(now.substeps[0]))
        state = np.asarray(step(state, commands[-1], now.parameters)).ravel()
        np.testing.assert_allclose(now.state, state, rtol=1e-9)
    assert np.ptp(commands) > 100.0


def test_without_compensation_a_delayed_command_is_that_of_the_period_before(context, make_sense):
    at_once = InNumba(context, FIXED)
    delayed = InNumba(context, replace(FIXED, computing_delay=1, compensated=False))
    rng, found = np.random.default_rng(2), []
    for _ in range(40):
        sense = make_sense(slip=rng.uniform(0.0, 0.1), torque=rng.uniform(300.0, 600.0))
        found.append([float(one.decide(sense).torque) for one in (at_once, delayed)])
    own, late = np.array(found).T
    np.testing.assert_allclose(late[1:], own[:-1], rtol=1e-9)
    # what was commanded before stands until then; of what the driver no longer wants nothing does
    assert delayed.decide(make_sense(target=50.0)).torque == pytest.approx(50.0)
    assert delayed.decide(make_sense(target=0.0)).torque == 0.0


def test_a_delayed_failure_fails_when_its_command_would_act(context, make_sense):
    one = InNumba(context, replace(FIXED, computing_delay=1))
    senses = [make_sense(torque=300.0)] * 5
    senses[2] = senses[2]._replace(speed=np.nan)
    statuses = [STATUSES[one.decide(sense).status] for sense in senses]
    assert statuses == ["ok", "ok", "ok", "reading not finite", "ok"]


def test_a_period_allocates_nothing(context, make_sense):
    one = InNumba(context)
    senses = list(_readings(make_sense, 5))
    one.decide(senses[0])
    _nrt_python.memsys_enable_stats()
    before = _nrt_python.memsys_get_stats_alloc()
    for sense in senses[1:]:
        one.decide(sense)
    assert _nrt_python.memsys_get_stats_alloc() == before
    _nrt_python.memsys_disable_stats()


X86 = platform.machine() in ("x86_64", "AMD64")


HERE = "x86-64" if X86 else "aarch64"


needs_linker = pytest.mark.skipif(
    platform.system() != "Linux"
    or not (X86 or platform.machine() == HERE)
    or not shutil.which("cc"),
    reason="no compiler that links ELF objects of these processors",
)


AMPLIFIED = 1e-8


"""Of torques in a closed loop, beside a Numba that rounds multiplication and addition as one: steps that are far from
converged amplify rounding."""


@pytest.fixture(scope="module")
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

    return lambda *values: list(make(*values))


def _recorded(scenario, duration, unit=0):
    """Context, settings and readings of a unit in a closed loop, one reading spoiled and a time of opposite demand."""
    made = []

    class Recorder(InNumba):
        def __init__(self, context):
            super().__init__(context, context.settings)
            self.context, self.senses = context, []
            made.append(self)

        def decide(self, sense):
            self.senses.append(sense._replace(omega=sense.omega.copy()))
            found = super().decide(sense)
            values = float(found.torque), bool(found.usable), STATUSES[found.status]
            return TorqueDecision(*values, float(found.solve_time))

    event = replace(scenario.event(), duration=duration)
    simulate(event, "alone", HostedController("mpc", "recorded", each_unit(Recorder)))
    context, senses = made[unit].context, made[unit].senses
    assert len(senses) == round(duration / context.period)
    bad = len(senses) // 2
    senses[bad] = senses[bad]._replace(speed=np.nan)
    for k in range(bad + 20, bad + 60):  # the driver changes his mind
        senses[k] = senses[k]._replace(target=-senses[k].target)
    return context, context.settings, senses


@pytest.fixture(scope="module")
def cases(senses):
    """(context, settings, senses) by name: units in closed loops, and settings that lead elsewhere."""
    held = MpcSettings(search=SlipSearch(seek=False))
    four, one_axle = make_unit(), load_scenario("wet-patch").changed(train="one-axle", case=None)
    return {
        "commuter train": _recorded(load_scenario("wet-patch"), 12.0),
        "blended stop": _recorded(load_scenario("wet-stop"), 5.0),
        "one axle": _recorded(one_axle, 8.0),
        "locomotive": _recorded(locomotive_study.scenario(38, 1), 8.0, unit=2),
        "six axles": (make_unit(axles=6), None, senses(6)),
        "delayed, longer steps": (
            four, MpcSettings(computing_delay=1, step=0.025, horizon=10), senses()
        ),
        "late and delayed": (four, MpcSettings(computing_delay=1, step_time=0.02), senses()),
        "Polach's slip held": (make_unit("polach"), held, senses()),
        "slip ratio held": (make_unit("slip-ratio"), held, senses()),
    }  # fmt: skip


@pytest.fixture(scope="module")
def folders(cases, tmp_path_factory):
    """Folder of each case's controller, exported for this machine."""
    made = {}
    for name, (context, settings, _) in cases.items():
        made[name] = write(export_unit(context, settings, HERE), tmp_path_factory.mktemp("case"))
    return made


@needs_linker
def test_every_answer_is_that_of_numba(cases, folders):
    wanted = of_numba(cases)
    for name, (context, _, senses) in cases.items():
        found, own = asked(link(folders[name]), packed(senses, context.axles)), wanted[name]
        if X86:
            assert found.tobytes() == own.tobytes(), name
        for field in ("status", "usable", "solve_time"):
            assert (found[field] == own[field]).all(), name
        # the slip of Polach's peak is searched for: at a maximum, rounding moves it by the root of itself
        relative = 1e-5 if name.startswith("Polach") else AMPLIFIED
        np.testing.assert_allclose(found["torque"], own["torque"], relative, 1e-9, err_msg=name)
        late = {"late"} if name.startswith("late") else set()
        assert {STATUSES[one] for one in own["status"]} == {"reading not finite", "ok"} | late, name
    steps = wanted["commuter train"]["solve_time"] / MpcSettings().step_time
    assert (steps > 1.5).sum() >= 30, "without slip there is little to solve"


@needs_linker
@pytest.mark.skipif(not X86, reason="one processor of this kind is known")
def test_newer_processors_answer_with_the_same_bits(cases, folders, tmp_path):
    have = llvm.get_host_cpu_features()
    needed = {"x86-64-v2": "popcnt", "x86-64-v3": "avx2", "x86-64-v4": "avx512vl"}
    context, settings, senses = cases["commuter train"]
    readings = packed(senses, context.axles)
    wanted = asked(link(folders["commuter train"]), readings)
    known = [one for one, feature in needed.items() if have.get(feature)]
    codes = {(folders["commuter train"] / "controller.o").read_bytes()}
    for target in known:
        folder = write(export_unit(context, settings, target), tmp_path / target)
        codes.add((folder / "controller.o").read_bytes())
        assert asked(link(folder), readings).tobytes() == wanted.tobytes(), target
    assert len(codes) == 1 + len(known)


@needs_linker
@pytest.mark.skipif(not shutil.which("nm") or not shutil.which("size"), reason="no GNU binutils")
def test_it_calls_mathematics_alone_and_its_memory_is_as_stated(folders):
    for name, folder in folders.items():
        printed = run_tool(folder, "nm", "controller.o").decode().splitlines()
        symbols = [line.split()[-2:] for line in printed]
        called = {one for kind, one in symbols if kind == "U"}
        defined = {one for kind, one in symbols if kind.isupper()} - called
        assert called <= set(LINKED), name
        assert defined == {"controller_init", "controller_step"}, name
        printed = run_tool(folder, "size", "-A", "controller.o").decode()
        written = sum(int(size) for size in re.findall(r"^\.(?:bss|data)\s+(\d+)", printed, re.M))
        header = (folder / "controller.h").read_text()
        assert written == int(re.search(r"#define CONTROLLER_MEMORY (\d+)", header).group(1)), name
        assert 1e4 < written < 2e5


@needs_linker
@pytest.mark.skipif(not shutil.which("objcopy"), reason="no GNU binutils")
def test_two_units_in_one_program_share_nothing(folders, senses, tmp_path):
    units = {"first": "delayed, longer steps", "second": "late and delayed"}
    objects, alone, readings = [], {}, packed(senses(), 4)
    for name, case in units.items():
        folder = shutil.copytree(folders[case], tmp_path / name)
        alone[name] = asked(link(folder), readings)
        renamed = [f"--redefine-sym=controller_{one}={name}_{one}" for one in ("init", "step")]
        run_tool(folder, "objcopy", *renamed, "controller.o", "renamed.o")
        objects.append(folder / "renamed.o")
    run_tool(tmp_path, "cc", "-shared", *objects, "-lm", "-o", "both.so")
    both = ctypes.CDLL(str(tmp_path / "both.so"))
    found = {name: np.zeros_like(answers) for name, answers in alone.items()}
    for name in units:
        getattr(both, f"{name}_init")()
    for k in range(len(readings)):
        for name in units:
            places = [values[k : k + 1].ctypes.data for values in (readings, found[name])]
            getattr(both, f"{name}_step")(*map(ctypes.c_void_p, places))
    for name in units:
        assert found[name].tobytes() == alone[name].tobytes()
    assert alone["first"].tobytes() != alone["second"].tobytes()


def test_what_is_exported_is_that_unit_with_these_settings_for_this_processor(monkeypatch):
    unit = make_unit(axles=1)
    first, again = (export_unit(unit, MpcSettings(), name="unit 1").contents for _ in range(2))
    assert first == again
    other = {
        "settings": export_unit(unit, MpcSettings(headroom=0.2)),
        "unit": export_unit(make_unit(axles=1, axle_load=79e3)),
        "aarch64": export_unit(unit, target="aarch64"),
    }
    codes = {name: one.contents["controller.o"] for name, one in other.items()}
    assert len({*codes.values(), first["controller.o"]}) == len(other) + 1
    about = json.loads(other["settings"].contents["made-from.json"])
    assert about["settings"]["headroom"] == 0.2
    for name, code in codes.items():
        assert code[:6] == b"\x7fELF\x02\x01", "64 bits, the lowest byte first"
        assert code[18:20] == (b"\xb7\x00" if name == "aarch64" else b"\x3e\x00")
    # whatever else it would have to call, such as Numba's ways of raising, is refused
    monkeypatch.setattr(object_file, "LINKED", [one for one in LINKED if one != "exp"])
    with pytest.raises(RuntimeError, match="calls exp"):
        export_unit(unit)


def test_other_processors_are_refused():
    for target in ("armv7", "i686", "powerpc64", "s390x", "x86_64", "x86-64-v5", ""):
        with pytest.raises(MpcError, match=f"target = '{target}' must be one of x86-64, .*aarch64"):
            export_unit(make_unit(), target=target)
