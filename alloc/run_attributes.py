"""Attributes of a recorded run, with their types: what is one value for the whole run."""

from typing import TypedDict, cast

import xarray as xr


class DrivenAttributes(TypedDict):
    """Attributes of every recorded run: train, and versions that it was made with."""

    event: str
    train: str
    train_mass: float
    """[kg]"""
    train_rotating_mass: float
    """[kg]"""
    version_readhesion: str
    version_numpy: str
    version_numba: str
    version_casadi: str
    version_osqp: str
    version_python: str
    git_revision: str


class RunAttributes(DrivenAttributes):
    """Attributes of a run of `alloc.simulation.simulate`: event, rule and controller, what was counted, and times taken."""

    event_hash: str
    seed: int
    rule: str
    controller: str
    target_speed: float
    """Speed to which time and distance are measured [m/s]; nan: neither is."""
    blended_brakes: int
    """1: every car brakes itself; 0: the motors brake the train."""
    detections: int
    """Slips detected by the foremost unit."""
    unit_detections: int
    """Slips detected by all units."""
    telegrams_sent: int
    telegrams_lost: int
    fallbacks: int
    """Units fallen back to the plan in silence."""
    blinded: int
    """Units that lost the speed of their last axle."""
    locks: int
    """Axles that slide protection found standing."""
    time_outs: int
    """Valves made to supply by their time-out."""
    rule_calls: int
    rule_failures: int
    rule_time_s: float
    controller_calls: int
    controller_failures: int
    controller_time_s: float
    controller_median_s: float
    controller_p99_s: float
    wall_time_s: float
    messages: str
    """JSON: message of rule or controller -> number of times that it came."""


def attributes_of(run: xr.Dataset) -> RunAttributes:
    """The attributes of a run of `simulate`, typed; they are those in `run.attrs`, which may hold more."""
    return cast(RunAttributes, run.attrs)
