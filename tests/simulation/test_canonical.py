"""What is printed is short; what is hashed holds everything."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from alloc.event import canonical
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail, logarithmic_increments
from alloc.plant.sets import SETS, find_set
from alloc.simulation import DriverCommand, Event


@pytest.mark.parametrize("name", SETS)
def test_event_train_and_model_fit_a_line_or_three(name):
    train = find_set(name)
    rail = Rail(0.1, increments=tuple(logarithmic_increments(train.axle_count)))
    model = build(train, rail)
    event = Event("start", model, DriverCommand((0.0,), (0.7,)))
    for thing in (train, rail, model, event):
        assert len(repr(thing)) < 300
    assert repr(name) in repr(train)
    assert repr(name) in repr(event)
    assert "level 0.1" in repr(rail)


def test_canonical_text_holds_what_repr_leaves_out():
    rail = Rail(0.1, patches=(Patch(0.5, start=1.0),))
    other = replace(rail, patches=(Patch(0.5, start=2.0),))
    assert repr(rail) == repr(other)
    assert canonical(rail) != canonical(other)
    assert canonical(rail) == canonical(replace(rail))
    long = np.zeros(5000)
    one = long.copy()
    one[2500] = 1e-15
    assert canonical({"a": [long]}) != canonical({"a": [one]})


def test_canonical_text_of_plain_records_is_their_repr():
    @dataclass
    class Record:
        a: tuple[float, ...]
        b: list[object]

    record = Record((1.0,), [{"x": None}, (), "s"])
    assert canonical(record) == repr(record)
