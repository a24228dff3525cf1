"""A commented suite that works: what `--example suite` prints."""

EXAMPLE = """\
# A suite: every combination of the lists below is one move. `energy-opt bench FILE --jobs 2` runs it, --resume goes on.
format = "energy-opt/suite/1"
name = "example"
robots = ["panda"]                # names, or URDF files beside this one
modes = ["retime"]                # and "reshape"
durations = ["1.5x"]              # of the minimum time; or seconds, or "free"
models = ["source_method_2"]      # and model files; "mean" of source_method_2 and careful where left out
# payloads = ["0", "2.0"]         # MASS or MASS,CX,CY,CZ
# objectives = ["energy"]         # and torque, power_squared, path_length, time
random = { count = 2, seed = 1, range = 0.6 }   # moves within this share of the joints' ranges

[[moves]]
name = "to the shelf"
start = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]      # rad, in the robot's order
goal = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
durations = [2.0, 3.0]            # this move's own

# [[groups]]                      # more of them, each with lists of its own; what it leaves out is taken from above
# robots = ["ur5", "ur5e"]
# random = { count = 5 }
"""
