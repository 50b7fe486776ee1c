"""Measured slip beside the plant: what the numbers of the study must be, whatever the sources say."""

import numpy as np
import pandas as pd
import pytest

from studies import measured


def test_the_measured_creep_curve_is_one():
    creepage, force = measured.CREEP.to_numpy().T
    assert np.all(np.diff(creepage) > 0.0)
    assert np.all(np.diff(force) > -219.0)  # the residuals of its points


def test_a_fit_of_the_rigs_curve_is_nearer_than_either_set():
    *_, dry, wet, fitted = measured.fit_curve(5.0, 9600.0)
    assert fitted < 0.02 < dry < wet


@pytest.mark.parametrize("law", ["fuzzy", "threshold"])
def test_only_growth_along_the_train_makes_the_rear_car_use_more(law):
    even, *_ = measured.measure_slide(law, 20.0, False)
    grown, lowest, released = measured.measure_slide(law, 20.0, True)
    assert even == pytest.approx(1.0, abs=0.01)
    assert grown > 1.1
    assert 0.0 < lowest <= 1.0
    assert released > 0.0


def test_its_table_has_every_number_beside_the_measured_one():
    rows = pd.DataFrame([dict.fromkeys(measured.MEASURED, one) for one in (1.0, 2.0, 6.0)])
    table = measured.table(rows).set_index("number")
    assert list(table.index) == list(measured.MEASURED)
    assert (table["median"] == 2.0).all()
    assert (table["max"] == 6.0).all()
