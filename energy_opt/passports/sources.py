"""Arms as their models describe them: each number with its interval, whether it was measured, and its source.

Also here: friction and power loss of a model's drives at a torque and a speed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np

from energy_opt.effects.parameter import Parameter
from energy_opt.errors import BadInput, suggest
from energy_opt.files import path_of, read_toml
from energy_opt.power import PowerModel, drive_function, load_model
from energy_opt.power.known import Known, careful, electrical, is_named, named_model, published_file
from energy_opt.power.known import friction as friction_of
from energy_opt.power.variants import draws_of
from energy_opt.robot import Robot, known_robots, load_robot
from energy_opt.robot.limits import sliding


def friction(models: Sequence[PowerModel], speed: np.ndarray) -> np.ndarray:
    """Friction torque of each joint, the mean of both directions, of models of one structure.

    f(s) = (tau_m(s) - tau_m(-s)) / 2 at no load, without acceleration, in a drive that has not warmed up.

    Args:
        models: that differ in their values only. speed: (n, S) rad/s, not negative.

    Returns:
        (len(models), n, S) N m.
    """
    n, count = speed.shape
    function, _ = drive_function(models[0], n)
    both, none = np.hstack([speed, -speed]), ca.DM.zeros(n, 2 * count)
    out = np.empty((len(models), n, count))
    for k, model in enumerate(models):
        torque = np.array(function(none, both, none, none, ca.DM.zeros(1, 2 * count), model.values(n))[0])
        out[k] = (torque[:, :count] - torque[:, count:]) / 2
    return out


def loss(model: PowerModel, joints: int, joint: int, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Power lost if one joint moves against a torque: at the meter, less mechanical power and standby.

    Args:
        joint: its index among the robot's `joints`. torque: (T,) N m at the joint. speed: (S,) rad/s.

    Returns:
        (T, S) W.
    """
    function, _ = drive_function(model, joints)
    loads, speeds = (x.ravel() for x in np.meshgrid(torque, speed, indexing="ij"))
    count = len(loads) + 1  # the last one is rest without load
    tau, v = np.zeros((joints, count)), np.zeros((joints, count))
    tau[joint, :-1], v[joint, :-1] = loads, speeds
    none = ca.DM.zeros(joints, count)
    power = np.array(function(none, v, none, tau, ca.DM.zeros(1, count), model.values(joints))[1]).ravel()
    return (power[:-1] - power[-1] - loads * speeds).reshape(len(torque), len(speed))


DRAWS = 600
UNLIMITED = 2.0  # [rad/s] largest speed shown for a joint without a velocity limit
SHARES = (0.01, 0.1, 0.5, 1.0)  # shares of the velocity limit at which friction is stated

Status = Literal["measured", "published", "declared", "assumed", "unknown"]


@dataclass(frozen=True)
class Number:
    """A value with its 95 % interval (None without data), unit, status and source.

    `status`: "measured" if the model's covariance has it, "published" if its source is named, "declared" if a model
    file only states it, "assumed" if it is taken from another robot, "unknown" if there is none.
    """

    value: float | None
    unit: str
    ci95: tuple[float, float] | None = None
    status: Status = "unknown"
    source: str = ""

    def document(self) -> dict[str, Any]:
        """As it is in passport.json."""
        return {**asdict(self), "source": self.source or None}


@dataclass(frozen=True)
class Arm:
    """One model of a robot.

    Attributes:
        label: its name in a comparison. file: the model file, "" if there is none.
        sources: where effects' values come from, by the effect's name.
        modes: levels of power at rest [{power (W), seconds, standstills}] that the diagnosis found, highest first.
    """

    label: str
    robot: Robot
    model: PowerModel
    file: str
    sources: dict[str, str]
    modes: tuple[dict[str, Any], ...] = ()

    @cached_property
    def speeds(self) -> np.ndarray:
        """Speeds (n, 4) rad/s at which friction is stated."""
        fastest = self.robot.limits.velocity
        return np.outer(np.where(np.isfinite(fastest), fastest, UNLIMITED), SHARES)

    @cached_property
    def draws(self) -> list[PowerModel]:
        """Models drawn from the covariance; none if the model has none."""
        return draws_of(self.model, DRAWS)

    @property
    def friction_effects(self) -> list[str]:
        """The effects that are friction: torque against the motion, at the cost of energy."""
        return [e.name for e in self.model.effects if e.stage == "torque" and e.dissipates]

    @cached_property
    def friction(self) -> np.ndarray:
        """Friction torque (n, 4) N m at `speeds`."""
        return friction([self.model], self.speeds)[0]

    @cached_property
    def friction_draws(self) -> np.ndarray:
        """`friction` of every draw, (D, n, 4)."""
        return friction(self.draws, self.speeds) if self.draws else np.empty((0, *self.speeds.shape))

    def measured(self, effect: str) -> bool:
        """True if the model has a variance for the effect's values."""
        known = self.model.uncertainty
        if known is None:
            return False
        spread = zip(known.names, np.diag(known.matrix), strict=True)
        return any(name.split(".")[0] == effect and v > 0 for name, v in spread)

    def status(self, effect: str) -> Status:
        """Origin of the values of one of the model's effects."""
        if self.model.get(effect) is None:
            return "unknown"
        if self.measured(effect):
            return "measured"
        given = self._known(effect)
        if given is not None:
            return given.source
        return "published" if effect in self.sources else "declared"

    def source(self, effect: str) -> str:
        """Where the values of an effect come from, in words; "" if that is not known."""
        given = None if self.measured(effect) else self._known(effect)
        return self.sources.get(effect, "" if given is None else given.note)

    def _known(self, effect: str) -> Known | None:
        """The published or assumed values of an effect, if the model has these."""
        held = (*electrical(self.robot), *friction_of(self.robot))
        given = next((known for known in held if known.effect == self.model.get(effect)), None)
        stated = bool(self.file) and effect not in self.sources  # by a file that names no source for it
        return None if given is not None and stated and given.source == "published" else given

    def number(self, effect: str, parameter: str, index: int = 0) -> Number:
        """One value of the model with its interval and source; without a value if the model lacks the effect.

        Args:
            effect, parameter: by name. index: of the joint.
        """
        held = self.model.get(effect)
        if held is None:
            return Number(None, "")
        p = next(p for p in held.parameters if p.name == parameter)
        values = np.ravel(p.full(effect, held.values[parameter], self.robot.n, held.extents))
        own = held.values[parameter].size
        low_high, known = None, self.model.uncertainty
        place = f"{effect}.{parameter}.{index if own > 1 else 0}"
        if known is not None and place in known.names:
            k = known.names.index(place)
            width = 1.96 * float(np.sqrt(known.matrix[k, k]))
            if width > 0:
                low_high = (max(float(values[index]) - width, p.lower), min(float(values[index]) + width, p.upper))
        status = self.status(effect)
        if status == "measured" and low_high is None:
            status = "declared"
        return Number(float(values[index]), self.unit(p, index), low_high, status, self.source(effect))

    def unit(self, p: Parameter, index: int) -> str:
        """Unit of a parameter's value; that of a joint which slides has N and m."""
        slides = p.dimensions == ("joint",) and self.robot.slides[index]
        return sliding(p.unit) if slides else p.unit

    def friction_at(self, joint: int, k: int) -> Number:
        """Friction of a joint at the k-th of its speeds."""
        unit = self.robot.unit("effort", self.robot.joints[joint])
        if not self.friction_effects:
            return Number(None, unit)
        order: tuple[Status, ...] = ("assumed", "declared", "published", "measured")
        status = min((self.status(name) for name in self.friction_effects), key=order.index)
        source = "; ".join(filter(None, dict.fromkeys(map(self.source, self.friction_effects))))
        spread = self.friction_draws[:, joint, k]
        interval = None
        if len(spread) and np.ptp(spread) > 0:
            low, high = np.quantile(spread, [0.025, 0.975])
            interval, status = (float(low), float(high)), "measured"
        return Number(float(self.friction[joint, k]), unit, interval, status, source)

    def numbers(self) -> list[dict[str, Any]]:
        """Every value of the model, one record each."""
        records = []
        for effect in self.model.effects:
            for p in effect.parameters:
                per_joint = p.dimensions == ("joint",)
                for k in range(self.robot.n if per_joint else effect.values[p.name].size):
                    if not per_joint and effect.values[p.name].size > 1:
                        continue  # tables of values, e.g. of a curve, are shown as curves
                    joint = self.robot.joints[k] if per_joint else None
                    own = self.number(effect.name, p.name, k).document()
                    records.append({"effect": effect.name, "parameter": p.name, "joint": joint, **own})
        return records


def read_arm(
    word: str, robot: Robot | None = None, limits: Path | None = None, lock: Mapping[str, float] | None = None
) -> Arm:
    """The arm of a model file, of a model's name, or of a robot's name or URDF: its values, published or assumed.

    Args:
        word: a file or a name. robot: if loaded already. limits: a joint_limits.yaml. lock: positions of joints that do
            not move, by name.

    Raises:
        BadInput: none of these; the file is at fault; its robot is not known and none was given; or its lists do not
            fit the robot.
    """
    file = path_of(word, "MODEL")
    if is_named(word):
        if robot is None:
            raise BadInput(f"{word}: which robot's? give --robot")
        return Arm(word, robot, named_model(word, robot), "", {})
    if file.is_file() and file.suffix.lower() == ".urdf":
        arm = load_robot(word, limits=limits, lock=lock)
        return Arm(word, arm, careful(arm), "", {})
    if not file.is_file():
        if file.suffix or word not in known_robots():
            raise BadInput(f"{word}: neither a model file nor a robot's name{suggest(word, known_robots())}")
        found = published_file(word)
        if found is None:
            return Arm(word, robot or load_robot(word, limits=limits, lock=lock), careful(word), "", {})
        file = found
    model, label = load_model(file), word
    if robot is None:
        if not model.robot:
            raise BadInput(f"{file}: robot is not named; give --robot")
        if model.robot not in known_robots():
            raise BadInput(f"{file}: robot {model.robot!r} is not known by name; give its URDF as --robot")
        robot = load_robot(model.robot, limits=limits, lock=lock)
    try:
        model.check(robot.n)
    except BadInput as error:
        raise BadInput(f"{file}: {error}") from None
    records = read_toml(file).get("effect", [])
    sources = {row["name"]: row["source"] for row in records if row.get("source")}
    return Arm(label, robot, model, str(word), sources, _modes(file, robot))


def _modes(file: Path, robot: Robot) -> tuple[dict[str, Any], ...]:
    """The levels of power at rest that the diagnosis beside a model file found; none without one of the same robot."""
    try:
        document = json.loads(file.with_name("diagnosis.json").read_text(encoding="utf-8"))
        records = document["modes"] if document["robot"] == robot.name else []
        return tuple({key: float(row[key]) for key in ("power", "seconds", "standstills")} for row in records)
    except (OSError, ValueError, TypeError, KeyError):
        return ()
