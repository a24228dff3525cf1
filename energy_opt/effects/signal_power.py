"""Power that a logged signal switches: a brake, a gripper, a vacuum valve, a lamp."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import casadi as ca

from energy_opt.effects.base import Signals
from energy_opt.effects.kinks import Kinks
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import PowerEffect
from energy_opt.errors import BadInput

TOGETHER = 3  # signals that are sought at once
LOGGED = "signal."  # and the signal's name, among the signals that a recording has


class SignalPower(PowerEffect):
    """sum of power * s, s the logged signals named in `signal`: 0 or 1 of a digital output, or any number.

    In a model file `signal = "gripper"`, or several with commas between, "gripper,brake", and a power for each. A log
    offers them as columns `signal.<name>`; columns that hold nothing but 0 and 1 are taken too. Where signals are not
    known, as in a plan, they count as 0.
    """

    name = "signal_power"
    parameters = (Parameter("power", "W", 0.0, -1e5, 1e5, "signals"),)
    options = {"signal": ("signal",)}
    free_options = ("signal",)
    extents_by_default = {"signals": 1}
    follows = ("logged",)

    def __init__(self, **values: Any) -> None:
        if isinstance(values.get("signal"), (list, tuple)):
            values["signal"] = ",".join(map(str, values["signal"]))
        super().__init__(**values)
        names = self.choices["signal"].split(",")
        if len(names) != self.values["power"].size:
            raise BadInput(f"effect {self.name}: {len(names)} signals and {self.values['power'].size} powers")

    @classmethod
    def offered(cls, recorded: Collection[str]) -> list[dict[str, str]]:
        names = sorted(name.removeprefix(LOGGED) for name in recorded if name.startswith(LOGGED))
        several = [s for k in range(1, TOGETHER + 1) for s in combinations(names, k)]
        return [{"signal": ",".join(s), "signals": str(len(s))} for s in several]

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        if x.logged is None:
            return ca.SX(0)
        parts = [p.power[i] * x.logged[name] for i, name in enumerate(p.signal.split(",")) if name in x.logged]
        return sum(parts, ca.SX(0))
