"""Words of headers, in the conventions of the field and some languages of meters' software."""

from __future__ import annotations


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Words that tell the signal of a joint, the most telling signals first ("joint" is in many a header).
SIGNALS: dict[str, frozenset[str]] = {
    "acceleration": _words("qdd ddq acc accel acceleration accelerations ddtheta beschleunigung"),
    "velocity": _words("qd dq vel velocity velocities speed speeds omega qdot dtheta rate geschwindigkeit"),
    "effort": _words("tau effort efforts torque torques moment moments drehmoment"),
    "current": _words("current currents cur strom ampere i"),
    "temperature": _words("temp temps temperature temperatures temperatur"),
    "position": _words(
        "q pos position positions angle angles theta encoder joint joints j axis axes a achse winkel jpos"
    ),
}
# What is measured is meant; these are commanded values.
COMMANDED = _words(
    "computed calculated calc model modelled modeled simulated sim estimated est theoretical feedforward predicted "
    "target desired des command commanded cmd ref reference setpoint goal d soll error err planned nominal"
)
STRANGE = _words(  # beside these words the others mean no joint's signal
    "tcp cartesian tool pose wrench force ext external hat output register registers bit bits mode digital analog "
    "voltage volt voltages limit limits max min seq covariance contact collision name names accelerometer gripper "
    "finger momentum factor fraction scaling time stamp"
)
MEASURED = _words("actual measured state states act ist real feedback fb meas joint")
TIME = ("time", "timestamp", "stamp", "t", "zeit", "datetime", "date", "clock", "elapsed", "secs", "seconds")
NOT_TIME = _words("execution frame nsecs nanosec control run cycle delta")
POWER = _words("power watt watts leistung puissance p pwr")
ENERGY = _words("energy joule joules wh kwh energie counter arbeit")
VOLT = _words("voltage volt volts u v spannung")
AMPERE = _words("current ampere amperes amps amp i a strom")
# One motor's, and not the robot's, unless the header says so.
SINGLE = _words(
    "joint motor axis axes achse actuator drive servo gripper tool finger elbow shoulder wrist antrieb j m link"
)
WHOLE = _words("robot arm total whole sum main gesamt")
ALTERNATING = _words("pf cos phi apparent reactive frequency hz va var")
NOT_POWER = _words("apparent reactive factor max min peak limit state mode on off status button")
