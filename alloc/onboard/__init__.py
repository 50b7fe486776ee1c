"""What the computers on board do in a control period, from the sensors to the torque and the brakes of each unit.

    sensing       readings, slip detector, disturbance observer, what a unit reports
    speed         the train's reference speed
    telegrams     which report and which order has arrived; orders become limits
    beliefs       what the leader believes that each unit can carry, and when it asks its rule
    targets       limits become torques; blended brakes
    slide         slide protection of the air brakes

All work on rows of `alloc.onboard.columns`. Torques, limits and slips count in the direction of the demand, `run.sign` says
which way that is. What a unit does with its target is its controller's, what the train does with its caps the rule's.
"""
