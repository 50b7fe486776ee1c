"""Reference speed from axle speeds alone."""

from hypothesis import given
from hypothesis import strategies as st

from alloc.onboard.reference_speed import ACCELERATION_MARGIN, follow_reference


@given(st.floats(0, 80), st.floats(0, 80), st.floats(-1.5, 1.5))
def test_rate_is_bounded_by_what_a_train_can_do(reference, candidate, commanded):
    new = follow_reference(reference, candidate, commanded, 0.01)
    assert new - reference <= (max(commanded, 0) + ACCELERATION_MARGIN) * 0.01 + 1e-12
    assert reference - new <= (max(-commanded, 0) + ACCELERATION_MARGIN) * 0.01 + 1e-12


def test_plausible_candidate_is_taken():
    assert follow_reference(10.0, 10.005, 0.8, 0.01) == 10.005


def test_common_slip_cannot_run_away_with_the_reference():
    reference = 5.0
    for k in range(300):  # all wheels gain 5 m/s2 for 3 s
        reference = follow_reference(reference, 5.0 + 5.0 * 0.01 * k, 0.8, 0.01)
    assert reference < 5.0 + 3.0 * (0.8 + ACCELERATION_MARGIN) + 1e-9
