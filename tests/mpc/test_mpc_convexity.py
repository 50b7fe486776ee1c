"""The quadratic model of a step is made convex by reflection: curvature keeps its size and loses its sign."""

from types import SimpleNamespace

import numpy as np
import pytest

from mpc import real_time
from mpc.real_time import LEAST_CURVATURE, RealTimeIteration


@pytest.mark.parametrize(
    ("curvature", "convex"),
    [
        ([-3.0, -0.05, 0.02, 5.0], [3.0, 0.4, 0.4, 5.0]),  # 0.4: least that is kept, 2 x 0.1 x 2
        ([0.5, 1.0, 2.0, 3.0], [0.5, 1.0, 2.0, 3.0]),
    ],
)
def test_negative_curvature_is_reflected_and_little_is_raised(monkeypatch, curvature, convex):
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    for part in (
        "second_order",
        "add_second_order",
    ):  # the model's second derivatives are there already
        monkeypatch.setattr(real_time, part, lambda *_: None)
    solver = object.__new__(RealTimeIteration)
    for name in (
        "_terms",
        "_now",
        "_hessians",
        "_second",
        "_wide",
        "_small_step",
        "_substeps",
        "torques",
    ):
        setattr(solver, name, None)
    solver._model = SimpleNamespace(curvature=None, nonzeros=None)
    solver._settings = SimpleNamespace(weights=SimpleNamespace(tracking=2.0))
    hessian = axes @ np.diag(curvature) @ axes.T
    solver._quadratic = SimpleNamespace(hessian=hessian, adjoint=None)
    solver._make_exact(SimpleNamespace(parameters=None))
    np.testing.assert_allclose(hessian, axes @ np.diag(convex) @ axes.T, atol=1e-12)
    assert LEAST_CURVATURE == 0.1
