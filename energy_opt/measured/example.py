"""A commented log.toml that works: what `--example log` prints."""

EXAMPLE = """\
# log.toml: what a folder of measured runs holds. `energy-opt check FOLDER` names every fault with file, row and column.
# A run is a CSV with columns time, <joint>.position for every joint, and power (W, whole robot).
# <joint>.velocity, .acceleration, .effort, .temperature (degC) and .current (A) are used where they are there.
format = "energy-opt/log/1"
robot = "z1"                      # a name (energy-opt robots) or a URDF beside this file

[[run]]
file = "run01.csv"
kind = "motion"                   # or "static": poses that are held
start = 0.0                       # s: the run's time 0 on a clock that all runs share; may be left out

[[run]]
file = "run02.csv"
kind = "static"
start = 60.0

# [[run]]
# file = "run03.csv"
# kind = "motion"
# power_file = "run03_power.csv"  # the meter's own file and clock: columns time, power
# power_start = 0.35              # s: that file's time 0 on the run's clock; estimated where left out

# [columns]                       # other headers and units than the above
# time = { column = "timestamp_ms", unit = "ms" }
# "joint1.position" = { column = "q1_deg", unit = "deg" }
# power = { product = ["voltage", "current"] }

# [meter]
# window = 0.1                    # s: a reading is the mean of so long, stamped at its end

# [segment]                       # one long recording: cut into runs where the arm is at rest
# at = "standstill"
"""
