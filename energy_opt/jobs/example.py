"""A job that works, to begin from: a part of 2 kg is fetched, shown to a camera and put down."""

EXAMPLE = """\
# A cycle of moves and waits, repeated every cycle_time seconds. Units: rad, s, kg, m.
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 5.5           # the moves share what the waits leave of it
home = "home"              # where the cycle begins; the last step must return there
mode = "reshape"           # reshape (free paths) or retime (straight lines), also per step
brakes = false             # may brakes hold the arm while time is left over?

[poses]
home = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
above = [0.9, 0.1, 0.2, -1.9, 0.0, 2.0, 0.9]
part = [0.9, 0.35, 0.2, -1.9, 0.0, 2.2, 0.9]
camera = [-0.3, -0.4, 0.0, -2.0, 0.0, 1.7, 0.4]
tray = [-1.2, 0.3, 0.1, -1.8, 0.0, 2.1, 0.0]
clear = [-1.2, 0.0, 0.1, -1.9, 0.0, 1.9, 0.0]

[[step]]
name = "over the part"
to = "above"
stop = false               # passes without stopping

[[step]]
name = "to the part"
to = "part"

[[step]]
name = "grip"
wait = 0.4

[[step]]
name = "to the camera"
to = "camera"
payload = 2.0              # from this step on [kg], or [mass, x, y, z] in the last joint's frame

[[step]]
name = "look"
wait = 0.8
brakes = true              # without holding losses

[[step]]
name = "to the tray"
to = "tray"
max_duration = 4.0

[[step]]
name = "release"
wait = 0.3

[[step]]
name = "up from the tray"
to = "clear"
payload = 0.0

[[step]]
name = "back"
to = "home"
"""
