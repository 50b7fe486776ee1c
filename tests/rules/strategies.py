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


@st.composite
def uneven_problems(draw, largest=8):
    """Problems of units whose masses differ by a factor up to 1000, with any of the fields that bound or inform a rule."""
    n = draw(integers(1, largest))

    def each(value):
        return np.array(draw(st.lists(value, min_size=n, max_size=n)))

    def maybe(name, value):
        if draw(st.booleans()):
            options[name] = each(value)

    # of integers every size is drawn alike, where numbers would mostly be plain ones
    coefficient = integers(0, 2048).map(lambda k: EXPECTED * k / 1024.0)
    options = {"mass": 10.0 ** each(integers(0, 3000).map(lambda k: k / 1000.0))}
    maybe("limit_max", st.one_of(coefficient, st.just(np.inf)))
    maybe("previous", coefficient)
    maybe("delivered", coefficient)
    maybe("truth", coefficient)
    if "previous" in options and draw(st.booleans()):
        rate = st.one_of(coefficient, coefficient.map(lambda x: 0.2 * x), st.just(np.inf))
        options["rate"] = draw(rate) if draw(st.booleans()) else each(rate)
    return AllocationProblem(each(coefficient), EXPECTED, **options)
