"""A train with one wheelset under each car that does not drive, in place of all of them: for runs of hours."""

from dataclasses import replace

from alloc.plant.train import Car, Train


def lumped(train: Train) -> Train:
    """The same train for a line run, whose wheels do not slip: masses, inertias and brake forces of each car are kept.

    All wheelsets of a car that rolls have the same speed, so one wheelset represents them. Those of driving cars are
    unchanged.
    """
    cars = tuple(car if car.motors else _on_one_wheelset(car) for car in train.cars)
    return replace(train, cars=cars)


def _on_one_wheelset(car: Car) -> Car:
    brake, axles = car.air_brake, len(car.axle_positions)
    if brake is not None:
        brake = replace(brake, force_per_pascal=axles * brake.force_per_pascal, cut_out=())
    return replace(
        car,
        axle_positions=(0.5 * car.length,),
        bogie_of_axle=(0,),
        wheel_inertia=(sum(car.wheel_inertia),),
        driven=(False,),
        air_brake=brake,
        axle_load_share=None,
        sanders=(),
    )
