"""A commented joint_limits.yaml that works: what `--example limits` prints."""

EXAMPLE = """\
# Joint limits with the keys of MoveIt's joint_limits.yaml; what is here overrides what is known of the robot.
# Units: rad, rad/s, rad/s^2, rad/s^3, N m. Joints that are left out keep theirs.
joint_limits:
  panda_joint1:
    has_position_limits: true
    min_position: -2.0
    max_position: 2.0
    has_velocity_limits: true
    max_velocity: 1.5
    has_acceleration_limits: true
    max_acceleration: 7.5
    has_jerk_limits: true
    max_jerk: 3750.0
    has_effort_limits: true
    max_effort: 60.0
  panda_joint4:
    has_velocity_limits: true
    max_velocity: 1.2
"""
