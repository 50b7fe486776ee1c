"""The tables of the computers on board: what is known, believed, decided.

On board everything counts in the direction of the demand: torques, limits and slips are positive while wheels are driven or
braked as asked, and `RUN.sign` says which way that is. What computers believe of the train has columns of its own here; by
default it is the truth. Readings come, and commands go, over `alloc.run.wire`.

A column is a line, or a field of a setting.
"""

from alloc.onboard.settings import (
    Braking,
    Detector,
    Fuzzy,
    Observer,
    Onboard,
    Sensors,
    SlideProtection,
    Telegrams,
    Threshold,
)
from alloc.schema.tables import INF, NAN, ONE, Column, Table, columns_of

# fmt: off

NEVER = -1e9
"""An instant before every run [s]."""

AXLE = Table(
    "axle",
    # the train, as believed
    unit=Column(-1, ONE, "traction unit of the axle, 0 = foremost, -1: none"),
    brake=Column(-1, ONE, "air brake group of the axle, 0 = foremost, -1: none"),
    radius=Column(0.43, "m", "wheel radius"),
    inertia=Column(100.0, "kg m2", "inertia of the wheelset with what is geared to it, at the wheel"),
    gear=Column(0.0, ONE, "gear ratio; 0: not driven"),
    # as read
    seen=Column(1, ONE, "whether its speed is known: it has a sensor, whose signal is not lost"),
    was_seen=Column(1, ONE, "the same a period ago"),
    signal=Column(0.0, "m s-1", "rim speed that its sensor gives"),
    true_speed=Column(0.0, "m s-1", "true speed of its car, where the computers are given it"),
    # as sensed
    reading=Column(0.0, "m s-1", "rim speed as read"),
    ahead=Column(0.0, "m s-1", "how far it runs ahead of the reference speed, mean of the last tenth of a second"),
    pull=Column(0.0, ONE, "force of its motor at the rim over its load, without sign"),
    shoe=Column(0.0, ONE, "force of its shoes at the rim over its load"),
    slid=Column(0, ONE, "whether it was in a deep slide when the demand turned round, and has not returned since"),
    free=Column(0.0, "s", "time for which hardly any force acts on it, and it does not return from slip"),
    slide=Column(0.0, "m s-1", "its slide behind the filter of the slide protection"),
)

UNIT = Table(
    "unit",
    # the train, as believed
    lag=Column(0.005, "s", "time constant of the torque", source="readhesion paper, section 2.2"),
    axles=Column(4, ONE, "number of its axles"),
    load=Column(1e5, "N", "mean load of its axles"),
    mass_share=Column(1.0, ONE, "load on its axles over the mean of all units"),
    radius=Column(0.43, "m", "wheel radius"),
    inertia=Column(100.0, "kg m2", "mean inertia of its wheelsets"),
    gear=Column(7.0, ONE, "gear ratio"),
    first=Column(0, ONE, "its foremost axle, 0 = foremost of the train"),
    last=Column(4, ONE, "its hindmost axle and one"),
    turning=Column(0.0, ONE, "torque that turns its wheelsets over what the rail receives, at the plan"),
    brake_turning=Column(0.0, ONE, "the same in blended braking"),
    increment=Column(0.0, ONE, "increment of adhesion over the foremost unit", source="JP5484215 (5)"),
    deviation=Column(0.0, ONE, "standard deviation of its cap about the truth"),
    # as read
    works=Column(1, ONE, "whether its motors work, as the train knows", True),
    motor_torque=Column(0.0, "N m", "torque of each motor", True),
    unseen=Column(0.0, "m s-1", "sum of the rim speeds of its other axles, by its motors' speed at the inverter"),
    # as sensed
    seen=Column(4, ONE, "number of its axles whose speed is known"),
    rim=Column(0.0, "m s-1", "mean rim speed of its axles whose speed is known"),
    runs_away=Column(0, ONE, "whether those are seen to run away", True),
    drive_limit=Column(0.0, "N m", "most that each motor can pull with at its rim speed"),
    brake_limit=Column(0.0, "N m", "most that each motor can brake with at its rim speed"),
    air=Column(0.0, "N", "air brake force per axle, by the pressure of its cylinders"),
    filtered=Column(NAN, "m s-1", "rim speed behind the filter of the differentiator"),
    computed_acceleration=Column(0.0, "m s-2", "acceleration of its axles as the slip detector computes it", True),
    observed=Column(NAN, "N m", "filter state of the disturbance observer", source="JP5484215 (3)"),
    observed_input=Column(0.0, "N m", "last input of that filter"),
    coefficient_estimate=Column(0.0, ONE, "observer's estimate of the coefficient", True, "JP5484215 (4), (18)"),
    worst_slip=Column(0.0, "m s-1", "slip of its worst axle against the reference speed", True),
    slipping=Column(0, ONE, "signal of the slip detector", True, "JP5484215 Fig. 5"),
    detected=Column(NEVER, "s", "instant of its last detection", True),
    slipped=Column(NEVER, "s", "last instant of slip", True),
    held=Column(0.0, ONE, "estimate held at the last detection", True, "JP5484215 (5)"),
    # as reported
    delivered=Column(0.0, ONE, "limit at which it would deliver what it delivers", True),
    limited=Column(NEVER, "s", "last instant at which adhesion, its motors or a failure limited it", True),
    # of the leader
    cap=Column(INF, ONE, "what the leader believes that it can carry", True, "JP5484215 (5)"),
    reported=Column(0.0, ONE, "what it delivers, by its newest report"),
    searching=Column(0, ONE, "whether it is limited, by its newest report"),
    mark=Column(INF, ONE, "what it has shown to carry"),
    counted=Column(NEVER, "s", "instant of its detection that its cap is from"),
    most=Column(INF, ONE, "largest limit that it may be given: motors, rates"),
    truth=Column(INF, ONE, "what the rail truly carries, for the oracle alone"),
    wanted=Column(INF, ONE, "limit that the leader orders; inf: none", True),
    # of its own computer
    limit=Column(0.0, ONE, "limit in force, as a coefficient", True),
    follows=Column(0, ONE, "whether that is an order of the leader"),
    fallen_back=Column(0, ONE, "whether it has heard nothing for too long and keeps the plan", True),
    pattern=Column(0.0, "N m", "torque of each motor that would follow the limit alone"),
    torque_target=Column(0.0, "N m", "torque wanted of each motor under the limit", True),
    torque_command=Column(0.0, "N m", "torque command to each motor", True),
    eased=Column(1.0, ONE, "share of it that is applied, less than 1 to let its wheels roll", True),
    applied=Column(0.0, "N m", "torque command to each motor, positive driving"),
    returns=Column(0, ONE, "whether one of its axles returns from slip"),
    clasped=Column(0, ONE, "whether shoes act on one of its axles"),
    foreseen=Column(0.0, "N m", "torque that its motors give if the line takes it"),
    taken=Column(INF, "N m", "braking torque that the line turns out to take"),
    kept=Column(1.0, ONE, "share of its part that the air brake keeps"),
    air_brake_force=Column(0.0, "N", "air brake force asked for per axle of the unit, at the rim", True),
    protected=Column(0, ONE, "whether valves of its air brakes hold or release"),
    faults=Column(0, ONE, "calls in which its controller's solver failed"),
)

BRAKE = Table(
    "brake_group",  # a pair of valves, one per bogie
    unit=Column(-1, ONE, "traction unit on whose axles it acts, -1: a trailer's"),
    axles=Column(2, ONE, "number of its axles"),
    most_pressure=Column(4e5, "Pa", "largest pressure"),
    friction_numerator=Column(0.0, "km h-1", "numerator of shoe friction over speed"),
    friction_offset=Column(1.0, "km h-1", "offset of shoe friction over speed"),
    friction_constant=Column(1.0, ONE, "constant of shoe friction over speed"),
    gain=Column(0.0, "N Pa-1", "shoe force of an axle over pressure, as believed"),
    load=Column(1e5, "N", "mean load of its axles, as believed"),
    turning=Column(0.0, ONE, "force that turns its wheelsets over what the rail receives, at the plan"),
    share=Column(1.0, ONE, "brake force asked of a trailer over its part of the plan"),
    most=Column(INF, "N", "force per axle that the oracle allows it"),
    pressure=Column(0.0, "Pa", "brake cylinder pressure, as read"),
    severity=Column(0.0, ONE, "what its worst axle asks of the valves: 0 supply, 1 hold, 2 release"),
    pressure_target=Column(0.0, "Pa", "pressure commanded"),
    valve=Column(0.0, ONE, "slide protection's valves: 0 supply, 1 hold, 2 release", source="JP4209318"),
)

ONBOARD = Table(
    "onboard",  # one row: numbers of the train's computers
    planned=Column(0.2, "s2 m-1", "coefficient that each m/s2 asked for needs, as believed", source="JP5484215 (6)"),
    brake_planned=Column(0.1, "s2 m-1", "the same in blended braking"),
    blended=Column(1, ONE, "whether every car brakes itself"),
    **columns_of(Onboard, "inertia_in_limit"),
    **columns_of(Braking, "blend_time", "release_speed", "inertia_in_estimate"),
    air_commanded=Column(0, ONE, "whether (18) takes the air brake force commanded", source="JP5484215 (18)"),
    **columns_of(Sensors, "speed_quantum"),
    **columns_of(Detector, prefix="detector_"),
    **columns_of(Observer, prefix="observer_"),
    **columns_of(Telegrams, "silence"),
    true_speed=Column(0, ONE, "whether the computers are given the true speed"),
    # reference speed
    reading=Column(0.01, "m s-1", "deviation of a reading beside noise"),
    creep=Column(0.003, ONE, "deviation of a rolling wheel's slip ratio"),
    repeats=Column(30.0, ONE, "periods over which that is the same"),
    unknown_most=Column(0.1, "m s-2", "deviation of the specific force that nothing explains, at most"),
    walk=Column(0.002, "m s-2", "deviation by which the unknown force changes in a second"),
    gate=Column(2.0, ONE, "deviations ahead beyond which an axle slips"),
    doubt=Column(0.1, "m s-1", "deviation of the reference speed at which a unit is eased"),
    train_mass=Column(2.4e5, "kg", "mass of the train, as believed"),
    resistance=Column(0.0, "N", "running resistance at rest, as believed"),
    resistance_linear=Column(0.0, "N s m-1", "its linear part, as believed"),
    resistance_quadratic=Column(0.0, "N s2 m-2", "its quadratic part, as believed"),
)

SLIDE = Table(
    "slide",  # one row: numbers of the slide protection
    protection=Column(1, ONE, "its law: 0 none, 1 threshold, 2 fuzzy"),
    every=Column(1, ONE, "control periods from one decision to the next"),
    **columns_of(SlideProtection, "cut_out_speed"),
    **columns_of(Threshold, prefix="threshold_"),
    **columns_of(Fuzzy, prefix="fuzzy_"),
)

RUN = Table(
    "run",  # one row: the train at an instant, as its computers have it
    period=Column(0.01, "s", "control period"),
    telegram=Column(0.1, "s", "period of the telegrams"),
    rise=Column(1.0, "s", "time in which torque rises to the plan"),
    hold=Column(5.0, "s", "time for which a detection counts", source="JP5484215 S216"),
    limit_rate=Column(INF, ONE, "largest change of a limit per answer, for rules that bound rates"),
    noise=Column(0.0, "m s-1", "standard deviation of a speed reading's noise"),
    time=Column(0.0, "s", "time", True),
    driver_command=Column(0.0, "m s-2", "acceleration asked for on level track", True),
    sign=Column(1.0, ONE, "direction of the demand: 1 pulling, -1 braking"),
    braking=Column(0, ONE, "whether brakes are blended now"),
    plan=Column(0.0, ONE, "coefficient that the plan needs, as the train computes it", True, "JP5484215 (6)"),
    needed=Column(0.0, ONE, "the plan, and what trailers' brakes lack of theirs", True),
    leader=Column(0, ONE, "foremost unit that works"),
    true_speed=Column(0.0, "m s-1", "true speed of the train, where the computers are given it"),
    reference_speed=Column(0.0, "m s-1", "reference speed of the train", True),
    reference_deviation=Column(0.01, "m s-1", "standard deviation of the reference speed by its estimate", True),
    unknown=Column(0.0, "m s-2", "specific force that nothing explains"),
    p_vv=Column(1e-4, "m2 s-2", "variance of the reference speed"),
    p_vd=Column(0.0, "m2 s-3", "covariance of speed and unknown force"),
    p_dd=Column(0.01, "m2 s-4", "variance of the unknown force"),
    eased=Column(0, ONE, "unit that was eased last, to let its wheels roll"),
    easing=Column(1e3, "s", "time since that began, and its air had gone"),
    emptying=Column(0.0, "s", "time for which its air has been waited for"),
    turned=Column(NEVER, "s", "last instant at which the demand has turned round"),
    verge=Column(NEVER, "s", "last instant at which readhesion control or slide protection held back an axle"),
    gained=Column(0.0, "m s-2", "acceleration of the reference speed, filtered"),
    before=Column(0.0, "m s-1", "reference speed a period ago"),
    braked=Column(0.0, ONE, "share of the plan to which trailers' brakes have risen"),
    level=Column(NAN, ONE, "level of the last allocation", True),
    case=Column(0, ONE, "case of the last allocation: 0 none, 1 A, 2 B", True),
    answered=Column(NAN, ONE, "plan to which the last allocation answers"),
    asked=Column(0, ONE, "how often the rule was asked"),
    rule_faults=Column(0, ONE, "calls in which the rule's solver failed"),
    stopped=Column(0, ONE, "whether a part in plain Python has raised an error"),
    rule_gap=Column(NAN, ONE, "largest distance of its answers from the certified ones, over the plan; nan: none"),
)

TABLES = (AXLE, UNIT, BRAKE, ONBOARD, SLIDE, RUN)
