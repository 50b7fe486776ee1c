"""A train in which no two cars are alike, so that an index that is off by one shows."""

from dataclasses import replace

from alloc.plant.train import AirBrake, Car, Coupler, Motors, TorqueLimit, Train

AXLES, BOGIES = (2.5, 5.0, 15.0, 17.5), (0, 0, 1, 1)


def _car(k: int, group: str | None, brake: float | None) -> Car:
    limits = (
        TorqueLimit(900.0 + 90.0 * k, 120e3 + 9e3 * k),
        TorqueLimit(800.0 + 70.0 * k, 110e3 + 7e3 * k),
    )
    return Car(
        name=f"car {k}", length=20.0, empty_mass=30e3 + 1.5e3 * k, load=900.0 * (k + 1) % 3500.0,
        axle_positions=AXLES, bogie_of_axle=BOGIES, wheel_radius=0.43 - 0.004 * k,
        wheel_inertia=tuple((150.0 if group else 60.0) + 4.0 * k + i for i in range(4)),
        driven=(group is not None,) * 4,
        motors=Motors(group, 7.07 - 0.2 * k, *limits) if group else None,
        air_brake=AirBrake(420e3, brake, 1.2, 1.2, friction=(30.0, 90.0 + k, 0.6)) if brake else None,
    )  # fmt: skip


def uneven_train(coupled: bool = False, braked: bool = True) -> Train:
    """Trailer, three motor cars with groups of 4, 2 and 4 axles, trailer; air brakes on all but one motor car."""
    groups = (None, "1C4M", "1C2M", "1C4M", None)
    gains = (0.031, 0.033, None, 0.036, 0.038) if braked else (None,) * 5
    train = Train("uneven", tuple(map(_car, range(5), groups, gains)), (3000.0, 60.0, 6.0))
    return replace(train, couplers=(Coupler(),) * 4) if coupled else train
