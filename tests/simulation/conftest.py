"""A small multiple unit and events on it, shared by the closed-loop tests."""

from dataclasses import replace

import pytest

from alloc.old.onboard.parameters import Belief, Onboard
from alloc.old.plant.model import build
from alloc.old.plant.rail import Patch, Rail, logarithmic_increments
from alloc.old.plant.train import Car, Motors, TorqueLimit, Train
from alloc.old.simulation import DriverCommand, Event

AXLES = (2.5, 5.0, 15.0, 17.5)
MOTORS = Motors("1C4M", 7.07, TorqueLimit(2000.0, 250e3), TorqueLimit(2000.0, 250e3))


def _car(name: str, driven: bool) -> Car:
    return Car(
        name, 20.0, 36e3 if driven else 28e3, 2e3, AXLES, (0, 0, 1, 1), 0.43,
        ((155.0 if driven else 60.0),) * 4, (driven,) * 4, MOTORS if driven else None,
    )  # fmt: skip


@pytest.fixture(scope="session")
def train() -> Train:
    """Trailer, three motor cars, trailer."""
    cars = [_car(f"car {k + 1}", k in (1, 2, 3)) for k in range(5)]
    return Train("test unit", tuple(cars), (3000.0, 60.0, 6.0))


@pytest.fixture(scope="session")
def make_event(train):
    """Event on the test unit: adhesion `level`, `increments` times those of (15), everything else at choice."""

    def make(level=0.13, *, increments=1.0, patches=(), failures=None, scatter=0.0, seed=0,
             train=train, onboard=None, command=None, **options):  # fmt: skip
        growth = (
            tuple(increments * logarithmic_increments(train.axle_count)) if increments else None
        )
        rail = Rail(level, increments=growth, patches=tuple(patches), scatter=scatter, seed=seed)
        model = build(train, rail, failures=failures)
        onboard = onboard or Onboard()
        if onboard.belief.increments is None and increments:
            onboard = replace(onboard, belief=Belief(increments=growth))
        options = {"duration": 8.0} | options
        return Event(
            "test", model, command or DriverCommand((0.2,), (0.75,)), onboard, seed=seed, **options
        )

    return make


@pytest.fixture(scope="session")
def dip():
    """A patch in time: adhesion falls to 70 % for two seconds."""
    return Patch(0.7, begin=3.0, until=5.0)
