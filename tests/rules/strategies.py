"""Random allocation problems. Coefficients are multiples of 2^-13, so that sums of them are exact in floating point."""

import numpy as np
from hypothesis import strategies as st

from alloc.rules import AllocationProblem

GRID = 2.0**-13
EXPECTED = 1400 * GRID  # 0.171, near the plan of 3.0 km/h/s
LARGEST = 64

integers = st.integers


@st.composite
def caps(draw, monotone=None, largest=LARGEST):
    """Caps (n,), n = 1..largest: any, growing, tied, at the plan, all below or above it, zero."""
    n = draw(integers(1, largest))
    plan = round(EXPECTED / GRID)
    values = draw(
        st.one_of(
            st.lists(integers(0, 2 * plan), min_size=n, max_size=n),
            st.lists(integers(plan - 200, plan + 200), min_size=n, max_size=n),
            st.lists(
                st.sampled_from((plan - 64, plan, plan + 32, plan + 64)), min_size=n, max_size=n
            ),
            st.lists(integers(0, plan), min_size=n, max_size=n),
            st.lists(integers(plan, 2 * plan), min_size=n, max_size=n),
            st.just([plan] * n),
            st.just([0] * n),
        )
    )
    grows = draw(st.booleans()) if monotone is None else monotone
    return GRID * np.array(sorted(values) if grows else values, dtype=float)


@st.composite
def problems(draw, bounded=False, largest=LARGEST):
    """Problems with equal masses; `bounded`: also with masses, torque limits and rates of change."""
    cap = draw(caps(largest=largest))
    options = {}
    if bounded:
        n = cap.size

        def some(low, high):
            return np.array(draw(st.lists(st.floats(low, high), min_size=n, max_size=n)))

        if draw(st.booleans()):
            options["mass"] = some(20e3, 60e3)
        if draw(st.booleans()):
            options["limit_max"] = some(0.5 * EXPECTED, 2 * EXPECTED)
        if draw(st.booleans()):
            options["previous"] = some(0.0, 1.5 * EXPECTED)
            options["rate"] = draw(st.floats(0.0, EXPECTED))
    return AllocationProblem(cap, EXPECTED, **options)
