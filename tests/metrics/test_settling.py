"""When a course of values has settled, by hand."""

import numpy as np

from alloc.metrics.search import settled_at


def test_a_course_has_settled_after_the_last_value_that_is_away():
    time = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    assert settled_at(time, np.array([5.0, 1.0, 0.2, 0.0, 0.0]), 0.5) == 1.0
    assert settled_at(time, np.array([0.0, 5.0, 0.0, 5.0, 0.0]), 0.5) == 2.0
    assert settled_at(time, np.array([0.5, -0.5, 0.0, 0.0, 0.0]), 0.5) == 0.0
