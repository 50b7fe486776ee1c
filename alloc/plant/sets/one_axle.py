"""One driven axle with its share of a train: readhesion paper (Univ. of Tokyo, Mitsubishi Electric), Tables 1, 2."""

from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import SETS
from alloc.plant.train import Car, Motors, TorqueLimit, Train

SOURCES = {
    "empty_mass": "readhesion paper, Table 1: 20 t of train per driven axle",
    "axle_load_share": "readhesion paper, Table 1: 10 t on the driven axle, the rest on trailers not modelled",
    "wheel_inertia": "readhesion paper, Table 1: 155.01 kg m2",
    "wheel_radius": "readhesion paper, Table 1: 0.43 m",
    "gear_ratio": "readhesion paper, Table 1: 7.07",
    "torque_lag": "readhesion paper, section 2.2: 5 ms",
    "group": "one motor on one inverter, readhesion paper, section 2.2",
    "resistance": "readhesion paper, Table 1: F_d = 0",
    "planned_acceleration": "readhesion paper, Table 2: 3.0 km/h/s, planned coefficient 0.17",
    "drive": "assumed: no limit is printed; twice the torque of the plan, so that it does not act",
    "brake": "assumed: as `drive`, the paper only drives",
    "length": "assumed: a quarter of a 20 m car; no effect on one axle",
}

PATCH_FADE = 0.02
"""Time [s] over which the rail changes. The paper steps; a smooth edge keeps the integrator's order. Assumed."""


def train() -> Train:
    """The train of the paper; the scenario's rail is `rail`."""
    limit = TorqueLimit(peak=2100.0, power=1.0e6)
    car = Car(
        name="one axle",
        length=5.0,
        empty_mass=20e3,
        load=0.0,
        axle_positions=(2.5,),
        bogie_of_axle=(0,),
        wheel_radius=0.43,
        wheel_inertia=(155.01,),
        driven=(True,),
        motors=Motors("1C1M", 7.07, limit, limit, torque_lag=5e-3),
        axle_load_share=(0.5,),
    )
    return Train(
        name="one-axle",
        cars=(car,),
        planned_acceleration=3.0 / 3.6,
        source="readhesion paper, Tables 1 and 2",
        sources=SOURCES,
    )


def rail(limit: float = 0.12) -> Rail:
    """Table 2: coefficient 0.18, `limit` (mu_lim) from 6 s to 14 s after the command at 0 s."""
    return Rail(0.18, patches=(Patch(limit / 0.18, begin=6.0, until=14.0, fade=PATCH_FADE),))


SETS.register("one-axle", train)
