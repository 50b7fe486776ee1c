"""What cannot be asked is refused with one error that names the field and the value."""

import numpy as np
import pytest

from alloc.rules import AllocationError, AllocationProblem

GOOD = {"cap": [0.1, 0.2], "expected": 0.15}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cap": [0.1, np.nan]}, r"cap\[1\] = nan"),
        ({"cap": [-0.1, 0.2]}, r"cap\[0\] = -0.1"),
        ({"cap": [0.1, np.inf]}, r"cap\[1\] = inf"),
        ({"cap": []}, r"cap has shape \(0,\)"),
        ({"cap": [[0.1, 0.2]]}, r"cap has shape \(1, 2\)"),
        ({"cap": "wet"}, r"cap = 'wet' must be an array of numbers"),
        ({"cap": 0.1}, r"cap has shape \(\)"),
        ({"expected": 0.0}, "expected = 0.0"),
        ({"expected": -0.1}, "expected = -0.1"),
        ({"expected": np.nan}, "expected = nan"),
        ({"expected": None}, "expected = None"),
        ({"expected": True}, "expected = True"),
        ({"expected": [0.1]}, r"expected = \[0.1\]"),
        ({"mass": [1.0, 0.0]}, r"mass\[1\] = 0.0 must be finite and greater than 0"),
        ({"mass": [1.0, -1.0]}, r"mass\[1\] = -1.0 must be finite and greater than 0"),
        ({"mass": [1.0]}, r"mass has shape \(1,\), must be \(2,\)"),
        ({"mass": [1.0, np.nan]}, r"mass\[1\] = nan"),
        ({"limit_max": [0.1, -1.0]}, r"limit_max\[1\] = -1.0 must be a number 0 or greater"),
        ({"limit_max": [0.1, np.nan]}, r"limit_max\[1\] = nan"),
        ({"previous": [0.1, np.inf]}, r"previous\[1\] = inf"),
        ({"rate": 0.1}, "give previous too"),
        ({"previous": [0.1, 0.1], "rate": -0.1}, r"rate\[0\] = -0.1"),
        ({"previous": [0.1, 0.1], "rate": [0.1, 0.1, 0.1]}, r"rate has shape \(3,\)"),
        ({"delivered": [np.nan, 0.1]}, r"delivered\[0\] = nan"),
        ({"truth": [0.1, -0.2]}, r"truth\[1\] = -0.2"),
        ({"deviation": [0.01, -0.01]}, r"deviation\[1\] = -0.01"),
        ({"deviation": [0.01, np.inf]}, r"deviation\[1\] = inf"),
        ({"deviation": 0.01}, r"deviation has shape \(\), must be \(2,\)"),
        ({"slip": "yes"}, "slip = 'yes' must be True or False"),
    ],
)
def test_is_refused_by_name_and_value(changes, message):
    with pytest.raises(AllocationError, match=message) as caught:
        AllocationProblem(**(GOOD | changes))
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)


def test_infinite_torque_limits_and_rates_are_no_limits():
    AllocationProblem(**GOOD, limit_max=[np.inf, np.inf], previous=[0.1, 0.1], rate=np.inf)


def test_the_problem_keeps_its_own_copy():
    cap = np.array([0.1, 0.2])
    problem = AllocationProblem(cap, 0.15)
    cap[0] = 9.0
    assert problem.cap.tolist() == [0.1, 0.2]
    with pytest.raises(ValueError, match="read-only"):
        problem.cap[0] = 1.0
