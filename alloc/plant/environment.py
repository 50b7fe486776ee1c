"""From rails and a line to the arrays that the plant computes with."""

import math
from collections.abc import Sequence
from dataclasses import astuple
from typing import Any, NamedTuple

import numpy as np

from alloc.errors import PlantError
from alloc.plant.rail import Line, Rail, Receptivity, axle_values
from alloc.plant.structure import Floats, Layout
from alloc.plant.train import Train


class Environment(NamedTuple):
    """What the train meets, per lane: rail, line, receptivity, failures."""

    curve_kind: int
    curve: Floats  # parameters of the adhesion curve
    law: Floats  # (3, axles, lanes)
    increment: Floats  # (axles, lanes)
    patch: Floats  # (patches, 7, lanes): factor, start, end, edge, begin, until, fade
    noise: Floats  # (lanes, knots)
    noise_length: Floats  # (lanes,)
    noisy: bool
    conditioning: Floats  # (2, lanes): gain, slip ratio
    conditioned: bool
    cleaning_spacing: float
    line_origin: float
    line_spacing: float
    line: Floats  # (2, points): grade, air factor
    receptivity: Floats  # (4, lanes): mean, amplitude, period, phase
    failure_time: Floats  # (units, lanes) [s]; inf: never


LANES_LAST = ("law", "increment", "patch", "conditioning", "receptivity", "failure_time")
LANES_FIRST = ("noise", "noise_length")
"""Fields of `Environment` by where the lane is among their dimensions; the others are common to all lanes."""


def environment_of_lanes(e: Environment, lanes: slice) -> Environment:
    """The same for these of its lanes."""
    own: dict[str, Any] = {name: getattr(e, name)[..., lanes].copy() for name in LANES_LAST}
    own |= {name: getattr(e, name)[lanes].copy() for name in LANES_FIRST}
    return e._replace(**own)


def environment_of(
    layout: Layout,
    train: Train,
    rails: Sequence[Rail],
    line: Line,
    receptivity: Sequence[Receptivity],
    failures: Sequence[dict[int, float]],
    span: tuple[float, float],
) -> Environment:
    """What a train on `rails` meets, per lane; raises `PlantError` where the lanes do not fit together."""
    kinds = {(rail.curve.kind, tuple(rail.curve.q), rail.cleaning_spacing) for rail in rails}
    if len(kinds) > 1:
        raise PlantError(
            "lanes: all rails advanced together need the same adhesion curve and cleaning_spacing; "
            "run different curves in separate batches"
        )
    lanes = len(rails)
    patches = max(len(rail.patches) for rail in rails)
    patch = np.empty((patches, 7, lanes))
    patch[:] = np.array([1.0, -1e6, 1e6, 5.0, -1e6, 1e6, 1.0])[None, :, None]
    law = np.empty((3, layout.axles, lanes))
    failure = np.full((layout.units, lanes), np.inf)
    for b, rail in enumerate(rails):
        law[:, :, b] = rail.axle_laws(layout.axles)
        for p, item in enumerate(rail.patches):
            patch[p, :, b] = astuple(item)
        for unit, time in failures[b].items():
            if not 0 <= unit < layout.units:
                raise PlantError(
                    f"failure: the train has no traction unit {unit + 1}; it has {layout.units}"
                )
            if math.isnan(time):
                raise PlantError(f"failure: time of traction unit {unit + 1} is not a number")
            failure[unit, b] = time
    rail = rails[0]
    length = sum(car.length for car in train.cars)
    origin, table = line.tabulate(span[0] - length - 50.0, span[1] + 50.0)
    return Environment(
        curve_kind=rail.curve.kind,
        curve=rail.curve.q,
        law=law,
        increment=np.stack(
            [axle_values(r.increments, layout.axles, "rail increments") for r in rails], axis=1
        ),
        patch=patch,
        noise=np.stack([r.noise_table() for r in rails]),
        noise_length=np.array([r.scatter_length for r in rails]),
        noisy=any(r.scatter > 0.0 for r in rails),
        conditioning=np.array([[r.conditioning, r.conditioning_slip] for r in rails]).T.copy(),
        conditioned=any(r.conditioning > 0.0 for r in rails),
        cleaning_spacing=rail.cleaning_spacing,
        line_origin=origin,
        line_spacing=line.spacing,
        line=table,
        receptivity=np.array([astuple(r) for r in receptivity]).T.copy(),
        failure_time=failure,
    )
