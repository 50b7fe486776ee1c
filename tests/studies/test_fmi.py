"""Units of FMI: FMPy accepts them, and what they compute is what this project computes."""

import shutil

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from alloc.driving import drive
from alloc.onboard.host import READING, UnitSense, unit_contexts
from studies.files.study_error import StudyError
from studies.peers import fmi
from studies.peers.fmi import controller_of, plant_of, write_fmu
from studies.scenario.scenario import load_scenario
from tests.mpc.exported import COMPILER, InNumba

pytestmark = pytest.mark.skipif(not COMPILER, reason="no C compiler")

PERIOD, SECONDS = 0.01, 4.0


class InFmpy:
    """A unit as a master has it."""

    def __init__(self, made, folder):
        self.path, folder = folder / "unit.fmu", folder / "unit"
        write_fmu(made, self.path)
        assert validate_fmu(str(self.path)) == []
        described = fmpy.read_model_description(str(self.path))
        self.number = {one.name: one.valueReference for one in described.modelVariables}
        self.given = {
            "unzipDirectory": fmpy.extract(str(self.path), str(folder)),
            "modelIdentifier": described.coSimulation.modelIdentifier,
            "instanceName": "one",
        }
        self.token, self.said = described.instantiationToken, []
        self.unit = FMU3Slave(guid=self.token, **self.given)
        self.unit.instantiate(logMessage=self.log)
        self.begin()

    def log(self, environment, status, category, message):
        self.said.append(message.decode())

    def begin(self):
        self.unit.enterInitializationMode(startTime=0.0)
        self.unit.exitInitializationMode()

    def set(self, **values):
        for name, some in values.items():
            places = self.places(name)
            self.unit.setFloat64(places, np.broadcast_to(some, len(places)).tolist())

    def get(self, name):
        return self.unit.getFloat64(self.places(name))

    def places(self, name):
        """Numbers of a variable, or of all elements of one."""
        if name in self.number:
            return [self.number[name]]
        return [k for one, k in self.number.items() if one.startswith(f"{name}[")]

    def end(self):
        self.unit.terminate()
        self.unit.freeInstance()


def commands(layout, seed):
    """Torques and brakes at random, of every period."""
    generator = np.random.default_rng(seed)
    hold = lambda rows: np.repeat(rows, 50, axis=0)[: round(SECONDS / PERIOD)]  # noqa: E731
    drawn = hold(generator.random((9, layout.units)))
    torque = 3000.0 * drawn if seed % 2 else -2500.0 * drawn
    pressure = 4e5 * hold(generator.random((9, layout.groups))) * (1 - seed % 2)
    valve = hold(generator.integers(0, 3, (9, layout.groups))).astype(float)
    sand = hold(generator.integers(0, 2, (9, layout.sanders))) * 0.02
    return torque, pressure, valve, sand


CHANGES = {
    "wet-patch": {"motors": {"rotor_inertia_kgm2": 1.0}},  # drives that twist
    "freight-start": {},  # cars that move apart
    "wet-stop": {"train": "gb-unit-8car"},  # sanders, and no motors
    "scattered-rail": {
        "rail": {"conditioning": 0.3},
        "initial_speed_kmh": 40.0,
    },  # what a rail remembers
    "wet-start": {"train": "one-axle", "load_t": None},  # and no brakes
}


@pytest.mark.parametrize(
    ("name", "seed"),
    [("wet-patch", 1), ("freight-start", 3), ("wet-stop", 2), ("scattered-rail", 5), ("wet-start", 7)],
)  # fmt: skip
def test_a_driven_plant_is_the_projects_own(name, seed, tmp_path):
    """The same numbers to 1e-9, at the start, at every period, and again after a reset."""
    scenario, changes = load_scenario(name), CHANGES[name]
    rail = scenario.rail.model_dump() | changes.get("rail", {})
    scenario = scenario.changed(**changes | {"rail": rail})
    event, names = scenario.event(seed), ("torque_command", "pressure_target", "valve", "sand_rate")
    given = commands(event.model.layout, seed)

    def driver(sense, controls):
        for values, wanted in zip(controls, given, strict=True):
            values[:] = wanted[min(round(sense.time / PERIOD), len(wanted) - 1)]
        return True

    run = drive(
        event.model, driver, SECONDS - PERIOD, period=PERIOD, step=event.longest_step,
        initial_speed=event.initial_speed, initial_position=event.initial_position,
    )  # fmt: skip
    unit = InFmpy(plant_of(scenario, seed), tmp_path)
    outputs = ["speed", "acceleration", "coupler_force"]
    outputs += [
        "position",
        "rim_speed",
        "rail_force",
        "axle_load",
        "motor_torque",
        "cylinder_pressure",
    ]
    outputs = [one for one in outputs if unit.places(one)]
    found = {one: [] for one in outputs}
    for again in (False, True):
        for k in range(len(given[0])):
            for name_, values in zip(names, given, strict=True):
                if values.shape[1]:
                    unit.set(**{name_: values[k]})
            if not again:
                for one in outputs:
                    found[one].append(unit.get(one))
            reached = unit.unit.doStep(k * PERIOD, PERIOD)[3]
            assert reached == pytest.approx((k + 1) * PERIOD)
        last = [unit.get(one) for one in outputs]
        if not again:
            first = last
            unit.unit.reset()
            unit.begin()
    assert first == last
    unit.end()
    for one, values in found.items():
        own = run[one].values.reshape(len(run["time"]), -1)
        size = np.abs(own).max()
        np.testing.assert_allclose(np.array(values), own, 1e-9, 1e-9 * size, err_msg=one)
    assert np.abs(run["slip_velocity"].values).max() > 0.1, "nothing slips"


def test_the_controller_is_the_one_that_numba_compiles(tmp_path):
    """Answers to the readings of a slipping unit; readings that are no number lead to no usable answer."""
    scenario = load_scenario("wet-patch")
    event = scenario.event()
    context = unit_contexts(event.model, event.equipment, event.onboard, "mpc")[0]
    numba, generator = InNumba(context), np.random.default_rng(4)
    unit = InFmpy(controller_of(scenario, 1), tmp_path)
    usable = set()
    for k in range(300):
        speed = 5.0 + 0.005 * k
        slip = np.abs(generator.normal(0.0, 0.3 if k > 150 else 0.02, context.axles))
        sense = UnitSense(
            k * PERIOD, np.nan if k == 250 else speed, (speed + slip) / context.radius,
            min(2000.0, 20.0 * k), 2500.0, 3000.0, 3000.0, 0.1, False,
        )  # fmt: skip
        wanted = numba.decide(sense)
        unit.set(**{name: float(getattr(sense, name)) for name in READING.names if name != "time"})
        unit.set(omega=sense.omega)
        unit.unit.doStep(k * PERIOD, PERIOD)
        assert unit.get("torque_command") == pytest.approx([wanted.torque], rel=1e-9)
        assert unit.get("status") == [wanted.status]
        assert unit.get("usable") == [wanted.usable]
        usable.add(wanted.usable)
    assert usable == {0, 1}
    unit.end()


def test_what_a_unit_cannot_do_it_says(short, tmp_path):
    unit = InFmpy(plant_of(short), tmp_path)
    second = FMU3Slave(guid=unit.token, **unit.given)
    refused = {
        "whole multiple": lambda: unit.unit.doStep(0.0, 0.3 * fmi_step(short)),
        "only inputs": lambda: unit.set(position=1.0),
        "no variable": lambda: unit.unit.getFloat64([9999]),
        "one instance": lambda: second.instantiate(logMessage=unit.log),
    }
    for words, ask in refused.items():
        with pytest.raises(Exception, match=r"fmi3\w+|instantiate"):
            ask()
        assert words in unit.said[-1]
    with pytest.raises(FMICallException):  # as the standard asks for what is not offered
        unit.unit.getFMUState()
    unit.end()
    stranger = FMU3Slave(guid="another", **unit.given)
    with pytest.raises(Exception, match="instantiate"):
        stranger.instantiate(logMessage=unit.log)
    assert "do not belong together" in unit.said[-1]


def fmi_step(scenario):
    return plant_of(scenario).step


def test_what_a_machine_cannot_make_is_one_line(call, short_file, tmp_path, monkeypatch):
    out = tmp_path / "unit.fmu"
    monkeypatch.setattr(shutil, "which", lambda _: None)
    code, _, err = call("export-fmu", short_file, "--out", out)
    assert (code, "needs a C compiler" in err, out.exists()) == (2, True, False)
    monkeypatch.undo()
    monkeypatch.setattr(fmi, "find_spec", lambda _: None)
    code, _, err = call("export-fmu", short_file, "--out", out)
    assert (code, ".[fmi]" in err, out.exists()) == (2, True, False)
    monkeypatch.undo()
    monkeypatch.setattr(fmi.platform, "system", lambda: "Darwin")
    with pytest.raises(StudyError, match="are made on Linux"):
        plant_of(load_scenario(short_file))
