"""The array model on JAX: what NumPy's functions do to its operands is handed to `jax.numpy`.

JAX is no dependency; where it is not installed its benchmarks are skipped. `pip install --target <folder> jax`, and that
folder behind the project's in PYTHONPATH, brings it without a change to the installed packages. Double precision, on the
processor.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from tests.plant.numpy_plant import runge_kutta_step


def load_jax() -> Any:
    """The module, set to double precision; raises ModuleNotFoundError where it is not installed."""
    jax = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    return jax


def _bare(part: Any) -> Any:
    """Arguments as JAX takes them."""
    if isinstance(part, Operand):
        return part.value
    return type(part)(map(_bare, part)) if type(part) in (list, tuple) else part


class Operand(NDArrayOperatorsMixin):
    """A value of JAX in an expression of NumPy."""

    def __init__(self, value: Any) -> None:
        self.value = value

    @property
    def __class__(self) -> Any:
        """The array model has one branch for arrays and one for symbols; this belongs to the first."""
        return np.ndarray

    def __array_ufunc__(self, function: Any, method: str, *operands: Any) -> "Operand":
        return self.__array_function__(function, (), operands, {})

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> "Operand":
        known = getattr(import_module("jax.numpy"), function.__name__)
        return Operand(known(*_bare(args), **kwargs))

    def __getitem__(self, place: Any) -> "Operand":
        return Operand(self.value[_bare(place)])

    def __getattr__(self, name: str) -> Any:
        method: Callable[..., Any] = getattr(self.value, name)
        return lambda *args, **kwargs: Operand(method(*args, **kwargs))


def advance_with_jax(rate: Callable[..., Any], step: float, state: Any) -> Callable[[int], Any]:
    """A function of the number of steps that takes `state`, (rows,) or (states, rows), so far; RK4, compiled.

    `rate` is a right side of time and state, written for NumPy.
    """
    jax = load_jax()

    def once(k: Any, now: Any) -> Any:
        return runge_kutta_step(rate, Operand(k * step), step, Operand(now)).value

    def run(start: Any, steps: Any) -> Any:
        return jax.lax.fori_loop(0, steps, once, start)

    several = np.ndim(state) == 2
    compiled = jax.jit(jax.vmap(run, in_axes=(0, None)) if several else run)
    start = jax.numpy.asarray(state)
    return lambda steps: np.asarray(compiled(start, steps))
