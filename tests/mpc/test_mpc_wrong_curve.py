"""The MPC on rails of every curve: it finds the best slip, and what curve the train was given counts for nothing."""

import numpy as np
import pytest

from alloc.simulation import simulate
from mpc.hosted import MPC
from mpc.settings import MpcSettings, SlipSearch
from tests.mpc.drop import BACK, DROP, between, driven, drop_event, run_mpc
from tests.mpc.estimates import CURVES, estimates

TRIED = ("piecewise", "polach", "slip-ratio")


def _used(run):
    """Mean share of the adhesion limit that driven axles have while adhesion is low."""
    low = between(run, DROP + 0.8, BACK)
    share = run["coefficient"].values / run["adhesion_limit"].values
    return float(share[low][:, driven(run)].mean())


@pytest.fixture(scope="module")
def runs():
    """Run by name of the true and of the given curve."""
    return {
        (true, given): simulate(drop_event(curve=CURVES[given], truth=CURVES[true]), "alone", MPC)
        for true in TRIED
        for given in TRIED
    }


@pytest.mark.parametrize("true", TRIED)
def test_adhesion_is_used_whatever_the_rails_curve(runs, true):
    run = runs[true, "piecewise"]
    assert run.attrs["controller_failures"] == 0
    assert _used(run) > 0.95


@pytest.mark.parametrize("true", TRIED)
@pytest.mark.parametrize("given", [name for name in TRIED if name != "piecewise"])
def test_the_given_curve_is_no_input(runs, true, given):
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(runs[true, given][name], runs[true, "piecewise"][name])


@pytest.mark.parametrize("true", ["polach", "slip-ratio"])
def test_no_slip_is_held_that_brings_nothing(runs, true):
    """On a wide peak the best slip is well below the peak's, and friction costs more than there."""
    run = runs[true, "piecewise"]
    low = between(run, DROP + 0.8, BACK)
    slip, top = (run[name].values[low][:, driven(run)] for name in ("slip_velocity", "peak_slip"))
    assert np.median(slip) < 1.1 * np.median(top) + 0.05


@pytest.mark.parametrize("true", TRIED)
def test_the_slip_of_the_peak_is_found_whatever_the_rails_curve(true):
    """Within the 30 % that docs/mpc.md states."""
    found = estimates(true)
    assert abs(found["slip_error"]) < 0.3
    assert found["used"] > 0.97


def test_held_at_the_slip_of_a_given_curve_a_wrong_one_costs_adhesion(runs):
    settings = MpcSettings(search=SlipSearch(seek=False))
    event = drop_event(curve=CURVES["piecewise"], truth=CURVES["slip-ratio"])
    run, controllers = run_mpc(event, settings)
    assert _used(run) < _used(runs["slip-ratio", "piecewise"]) - 0.1
    for controller in controllers:
        belief = controller.belief
        top = float(CURVES["piecewise"].limit(belief.peak.min())[1])
        assert belief.record.search.state[0].slip == pytest.approx(top, rel=0.05)


@pytest.mark.parametrize("initial", [0.7, 1.3])
def test_a_wrong_first_slip_is_mended_before_the_drop_ends(initial):
    first = MpcSettings().search.first * initial
    run, _ = run_mpc(drop_event(), MpcSettings(search=SlipSearch(first=first)))
    assert _used(run) > 0.95
