"""A commented model file that works: what `--example model` prints."""

EXAMPLE = """\
# A power model: the effects that an arm has, with their values. `energy-opt effects` lists all there are.
# Mechanical power is always counted, negative included; SI units (N m, W, rad/s, ...).
format = "energy-opt/model/1"
robot = "panda"                   # whose joints a list means, in that robot's order

[[effect]]
name = "standby"                  # controller, fans, holding brakes
power = 88.04                     # W

[[effect]]
name = "copper_loss"              # heat of the current that makes torque
r_over_kt2 = 0.0036               # W/(N m)^2: one number for all joints, or one per joint

[[effect]]
name = "coulomb_friction"         # dry friction, against the motion
tau_c = [0.6, 0.5, 0.45, 0.5, 0.3, 0.25, 0.2]   # N m, one per joint

# [[effect]]
# name = "payload"
# mass = 1.5                      # kg
# com = [0.0, 0.0, 0.1]           # m, in the last joint's frame

# [[effect]]
# name = "regeneration"
# efficiency = 0.6                # share of braking power that is used again: 1 all, 0 none
# level = "bus"                   # or "joint"
"""
