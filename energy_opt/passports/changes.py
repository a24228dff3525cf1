"""The differences between two models of one arm, and whether each difference is real."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from energy_opt.passports.sources import SHARES, Arm
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

LEVEL = 0.95  # joint confidence of all intervals of a comparison


@dataclass(frozen=True)
class Change:
    """One quantity in two models.

    Attributes:
        quantity: "standby", "r_over_kt2" or "friction". joint: its name, None for the whole arm. speed: rad/s, of
            friction.
        difference: after - before, in `unit`. ci95: its interval; all intervals of the comparison hold together.
        percent: of the earlier value; None if that is 0.
        real: True if 0 is outside of `ci95`; None if a model has no covariance.
    """

    before_label: str
    after_label: str
    quantity: str
    joint: str | None
    speed: float | None
    unit: str
    before: float
    after: float
    difference: float
    ci95: tuple[float, float] | None
    percent: float | None
    real: bool | None

    def __str__(self) -> str:
        where = f" of {self.joint}" if self.joint else ""
        speed = "m/s" if self.unit == "N" else "rad/s"
        at = f" at {self.speed:.3g} {speed}" if self.speed is not None else ""
        name = {"r_over_kt2": "R/Kt²"}.get(self.quantity, self.quantity)
        share = "" if self.percent is None else f" ({self.percent:+.0f} %)"
        spread = "" if self.ci95 is None else f", 95 % [{self.ci95[0]:+.3g}, {self.ci95[1]:+.3g}]"
        word = {True: "real", False: "within the intervals", None: "no interval is stated"}[self.real]
        return f"{name}{where}{at}: {self.before:.4g} → {self.after:.4g} {self.unit}{share}{spread}: {word}"


Key = tuple[str, str | None, float | None]  # quantity, joint and speed, as in `Change`


def changes(before: Arm, after: Arm) -> list[Change]:
    """The differences between two models of a robot; none if their joints differ.

    A change is real if 0 lies outside of its interval d +- c sd. All intervals hold together with probability 95 %: c
    is the 95 % quantile of the largest |d* - d| / sd over all quantities, from independent draws d* of both models'
    covariances (sup-t bands; Montiel Olea and Plagborg-Moller, Journal of Applied Econometrics 34(1), 2019).

    Args:
        before, after: the models with their draws.
    """
    if before.robot.joints != after.robot.joints:
        return []
    first, second = dict(_quantities(before)), dict(_quantities(after))
    keys = [key for key in second if key in first]
    spreads = []
    for key in keys:
        both = [values[key][1:] for values in (first, second)]
        count = min((len(draws) for _, draws in both if len(draws)), default=0)
        moved = [draws[:count] - value if len(draws) else np.zeros(count) for value, draws in both]
        spreads.append(moved[1][::-1] - moved[0])  # reversed, as equal seeds draw equal numbers
    width = [float(x.std()) if len(x) else 0.0 for x in spreads]
    scaled = [np.abs(x) / w for x, w in zip(spreads, width, strict=True) if w > 0]
    most = float(np.quantile(np.max(scaled, axis=0), LEVEL)) if scaled else 0.0
    out = []
    for key, w in zip(keys, width, strict=True):
        (unit, was, draws), (_, now, others) = first[key], second[key]
        d, known = now - was, draws.size > 0 and others.size > 0 and w > 0
        interval = (d - most * w, d + most * w) if known else None
        real = abs(d) > most * w if known else None
        share = 100 * d / abs(was) if was else None
        out.append(Change(before.label, after.label, *key, unit, was, now, d, interval, share, real))
    return out


def changes_since(last: PowerModel, now: PowerModel, robot: Robot) -> list[Change]:
    """Changes of a new calibration against the last one, real changes first.

    Args:
        last, now: both models. robot: whose models they are.
    """
    found = changes(Arm("last", robot, last, "", {}), Arm("now", robot, now, "", {}))
    return sorted((x for x in found if x.difference), key=lambda x: (not x.real, -abs(x.percent or 0.0)))


def _quantities(arm: Arm) -> Iterator[tuple[Key, tuple[str, float, np.ndarray]]]:
    """Standby, R/Kt^2 and friction of each joint: unit, value, and the values (D,) of all draws."""
    for effect, parameter in (("standby", "power"), ("copper_loss", "r_over_kt2")):
        held = arm.model.get(effect)
        if held is None:
            continue
        n = arm.robot.n if effect == "copper_loss" else 1
        p = held.parameters[0]
        drawn = np.array([_full(x, effect, n) for x in arm.draws]) if arm.measured(effect) else np.empty((0, n))
        for k, value in enumerate(_full(arm.model, effect, n)):
            joint = arm.robot.joints[k] if effect == "copper_loss" else None
            unit = arm.unit(p, k)
            yield (effect if joint is None else parameter, joint, None), (unit, float(value), drawn[:, k])
    if not arm.friction_effects:
        return
    sure = any(arm.measured(name) for name in arm.friction_effects)
    for j, joint in enumerate(arm.robot.joints):
        unit = arm.robot.unit("effort", joint)
        for k in range(1, len(SHARES)):
            draws = arm.friction_draws[:, j, k] if sure else np.empty(0)
            yield ("friction", joint, float(arm.speeds[j, k])), (unit, float(arm.friction[j, k]), draws)


def _full(model: PowerModel, effect: str, n: int) -> np.ndarray:
    """The first parameter of an effect, one value for each of n joints."""
    held = model.get(effect)
    assert held is not None
    return held.full(n)
