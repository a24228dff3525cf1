"""What the meter makes of the true power. These never belong to an energy: they explain a log, not an arm."""

from __future__ import annotations

from energy_opt.effects.base import Effect, Parameter


class MeterDelay(Effect):
    """The meter shows at time t the power of time t - delay."""

    name = "meter_delay"
    stage = "meter"
    parameters = (Parameter("delay", "s", 0.0, -5.0, 5.0),)


class MeterFilter(Effect):
    """First-order lag of the meter: time_constant * dy/dt + y = p."""

    name = "meter_filter"
    stage = "meter"
    parameters = (Parameter("time_constant", "s", 0.0, 0.0, 10.0),)


class MeterGain(Effect):
    """The meter reads gain times the truth."""

    name = "meter_gain"
    stage = "meter"
    parameters = (Parameter("gain", "1", 1.0, 0.1, 10.0),)
