"""From a rail and a line to the arrays that the plant computes with."""

import math
from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from alloc.errors import PlantError
from alloc.plant.adhesion import AdhesionCurve
from alloc.plant.rail import Line, Rail, Receptivity, axle_values
from alloc.plant.structure import Floats, Layout, Structure, structure_of
from alloc.plant.train import Train


class Environment(NamedTuple):
    """Surroundings of the train: rail, line, receptivity, failures."""

    curve_kind: int
    curve: Floats  # parameters of the adhesion curve
    contact: Floats  # (axles,) creep stiffness over that among the parameters
    presliding: float
    law: Floats  # (3, axles)
    increment: Floats  # (axles,)
    patch: Floats  # (patches, 7): factor, start, end, edge, begin, until, fade
    noise: Floats  # (NOISE_KNOTS + 2,) a ring: its first knots again at the end
    noise_length: float
    noisy: bool
    conditioning: float  # gain
    conditioning_slip: float  # slip ratio
    conditioned: bool
    cleaning_spacing: float
    sandy: bool  # whether the train has sanders
    sanded: float  # coefficient of sanded rail
    sand_saturation: float  # [kg/m]
    sand_kept: float  # share that an axle leaves
    line_origin: float
    line_spacing: float
    line: Floats  # (3, points): grade, air factor, resistance of curves per weight
    receptivity: Floats  # (4,): mean, amplitude, period, phase
    failure_time: Floats  # (units,) [s]; inf: never


def axle_contacts(curve: AdhesionCurve, structure: Structure) -> Floats:
    """Creep stiffness of each axle's contacts over that in the parameters of `curve`, (axles,).

    A wheel carries half of its axle's load.
    """
    return curve.contact(0.5 * structure.static_load, structure.radius)


def level_for(curve: AdhesionCurve, adhesion: float, speed: float, train: Train) -> float:
    """Level of a rail whose `curve` offers `adhesion` to `train` at `speed` [m/s].

    The offered adhesion is the largest force of all axles over their weight: the curve's maximum, averaged with the static
    axle loads as weights. Heavy axles have the softer contacts.
    """
    level, s = adhesion, structure_of(train)[0]
    contact, share = axle_contacts(curve, s), s.static_load / s.static_load.sum()
    for _ in range(20):  # the maximum of Polach's curve grows a little less than in proportion
        limit = np.broadcast_to(curve.limit(level, speed, contact)[0], share.shape)
        before, level = level, level * adhesion / float(limit @ share)
        if level == before:
            break
    return level


def environment_of(
    structure: Structure,
    layout: Layout,
    train: Train,
    rail: Rail,
    line: Line,
    receptivity: Receptivity,
    failures: dict[int, float],
    span: tuple[float, float],
) -> Environment:
    """Surroundings of a train on `rail`; raises `PlantError` where train, rail and failures do not fit together."""
    failure = np.full(layout.units, np.inf)
    for unit, time in failures.items():
        if not 0 <= unit < layout.units:
            raise PlantError(
                f"failure: the train has no traction unit {unit + 1}; it has {layout.units}"
            )
        if math.isnan(time):
            raise PlantError(f"failure: time of traction unit {unit + 1} is not a number")
        failure[unit] = time
    length = sum(car.length for car in train.cars)
    origin, table = line.tabulate(span[0] - length - 50.0, span[1] + 50.0)
    noise = rail.noise_table()
    return Environment(
        curve_kind=rail.curve.kind,
        curve=rail.curve.q,
        contact=axle_contacts(rail.curve, structure),
        presliding=rail.presliding,
        law=rail.axle_laws(layout.axles),
        increment=axle_values(rail.increments, layout.axles, "rail increments"),
        patch=np.array([astuple(patch) for patch in rail.patches]).reshape(-1, 7),
        noise=np.append(noise, noise[:2]),
        noise_length=rail.scatter_length,
        noisy=rail.scatter > 0.0,
        conditioning=rail.conditioning,
        conditioning_slip=rail.conditioning_slip,
        conditioned=rail.conditioning > 0.0,
        cleaning_spacing=rail.cleaning_spacing,
        sandy=layout.sanders > 0,
        sanded=rail.sanded_coefficient,
        sand_saturation=rail.sand_saturation,
        sand_kept=1.0 - rail.sand_decay,
        line_origin=origin,
        line_spacing=line.spacing,
        line=table,
        receptivity=np.array(astuple(receptivity)),
        failure_time=failure,
    )
