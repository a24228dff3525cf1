"""Electrical values and friction of an arm without a calibrated model: published values, else values scaled from its
limits.

Scaled values, with effort and speed that the drives are rated for (`Robot.rated`):

- copper loss at the effort limit is 10 % of effort times full speed: r_j = 0.1 v_j / effort_j. A Panda gets 0.0025 to
0.022 W/(N m)^2, where 0.0036 was measured; a UR5e gets 0.0021 and 0.0112, where 0.0018 and 0.0155 were.
- standby is 3 sqrt(sum of effort v [W]) W, without fingers of a gripper. A Panda gets 87 W, where 88 W were measured.
- dry friction is 4 % of the effort limit, viscous friction at full speed 8 % of it. Measured friction is 1 % (a Panda)
to 5 % (UR arms) of the effort limit when creeping, and 2 to 15 % at full speed.

The power models that are known by name (`NAMED`) use these values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np

from energy_opt.arguments import expect
from energy_opt.effects import (
    CopperLoss,
    CoulombFriction,
    Effect,
    FrictionCurve,
    Regeneration,
    Standby,
    ViscousFriction,
)
from energy_opt.errors import BadInput, shown, suggest
from energy_opt.files import path_of, read_toml
from energy_opt.power.model import PowerModel, read_model
from energy_opt.power.variants import of_some_joints
from energy_opt.robot import Robot, load_robot
from energy_opt.robot.catalog import CATALOG, urdf_of

FILES = Path(__file__).parent / "published"
# arms with drives of one design: friction is assumed to be that of one of them, scaled by the effort limit
SERIES = {"ur3e": "ur5e", "ur10e": "ur5e", "ur16e": "ur5e"}
COPPER, STANDBY = 0.1, 3.0
DRY, VISCOUS = 0.04, 0.08  # usual friction, as shares of the effort limit
DRY_RANGE, VISCOUS_RANGE = (0.01, 0.06), (0.02, 0.12)
ALIKE = 1.5  # factor within which effort limits are those of one arm: a UR3e's and a UR5e's differ by 1.9 and more


@dataclass(frozen=True)
class Known:
    """An effect with the source of its values; `note` explains it in words."""

    effect: Effect
    source: Literal["published", "assumed"]
    note: str


def published_file(name: str) -> Path | None:
    """Model file with the published values of a robot, by name; None if nothing is published."""
    file = FILES / f"{name}.toml"
    return file if file.is_file() else None


@cache
def _file_of(name: str) -> tuple[PowerModel, dict[str, str], tuple[str, ...], np.ndarray]:
    """A published model, the sources of its effects, its joints, and their effort limits (n,) [N m]."""
    file = FILES / f"{name}.toml"
    sources = {row["name"]: str(row.get("source", "")) for row in read_toml(file)["effect"]}
    robot = load_robot(name)
    return read_model(file), sources, robot.joints, robot.rated.effort


def _published(robot: Robot, name: str) -> tuple[list[Known], np.ndarray | None]:
    """Published effects of `name` for the robot's joints, and these joints' effort limits; none if joints differ."""
    if published_file(name) is None:
        return [], None
    model, sources, joints, effort = _file_of(name)
    places = [next((k for k, known in enumerate(joints) if own.endswith(known)), -1) for own in robot.joints]
    if -1 in places:
        return [], None
    effects = (of_some_joints(effect, places, len(joints)) for effect in model.effects)
    called = "" if _in_catalogue(robot) else f"; used because the file is called {robot.urdf.name}"
    return [Known(effect, "published", f"{sources[effect.name]}{called}") for effect in effects], effort[places]


def _in_catalogue(robot: Robot) -> bool:
    """True if the robot is the catalogue's of its name; False if only its file is called so."""
    entry = CATALOG.get(robot.name)
    return entry is not None and robot.urdf == urdf_of(entry)


def _fitting(robot: Robot, name: str) -> list[Known]:
    """Published effects of `name`; none if the robot's effort limits are another arm's: a file may have any name."""
    found, effort = _published(robot, name)
    if effort is None or _in_catalogue(robot):
        return found
    share = (robot.rated.effort / effort)[~robot.rated.estimated]
    return found if ((share < ALIKE) & (share > 1 / ALIKE)).all() else []


def name_hints(robot: Robot) -> list[str]:
    """Remarks on published values that are not used because of the name of the robot's file."""
    file, names = robot.urdf.name, sorted(path.stem for path in FILES.glob("*.toml"))
    if robot.name in names and not _fitting(robot, robot.name):
        return [f"{file}: its joints or effort limits are not those of {robot.name}; published values are not used"]
    shipped = any(robot.urdf.match(entry.file) for entry in CATALOG.values())
    like = [name for name in names if not shipped and robot.name not in CATALOG and _fitting(robot, name)]
    words = (
        "{0}: its joints and effort limits are like those of {1}; if it is a {1}, call it {1}.urdf for published values"
    )
    return [words.format(file, name) for name in like]


def electrical(robot: Robot) -> tuple[Known, Known]:
    """Standby and copper loss, published or scaled from the limits."""
    found = {known.effect.name: known for known in _fitting(robot, robot.name)}
    rated = robot.rated
    scaled = Known(Standby(power=STANDBY * np.sqrt(rated.power)), "assumed", "3 sqrt(sum of effort times speed [W])")
    heat = Known(
        CopperLoss(r_over_kt2=COPPER * rated.velocity / rated.effort), "assumed",
        "at the effort limit 10 % of effort times speed",
    )  # fmt: skip
    return found.get("standby", scaled), found.get("copper_loss", heat)


def friction(robot: Robot) -> tuple[Known, ...]:
    """Friction in the joints: published, of the arm's series, or the prior."""
    found = [known for known in _fitting(robot, robot.name) if known.effect.stage == "torque"]
    if found:
        return tuple(found)
    like = SERIES.get(robot.name, "")
    of_series, effort = _published(robot, like)
    for known in of_series:
        if isinstance(known.effect, FrictionCurve) and effort is not None:
            torque = known.effect.values["torque"] * (robot.rated.effort / effort)[:, None]
            note = f"{like}'s, scaled by the effort limit: {known.note}"
            return (Known(FrictionCurve(speed=known.effect.values["speed"], torque=torque), "assumed", note),)
    notes = [
        f"{what}, {100 * share:g} % of the effort limit{at} (between {100 * low:g} and {100 * high:g} %)"
        for what, share, at, (low, high) in (
            ("dry", DRY, "", DRY_RANGE), ("viscous", VISCOUS, " at full speed", VISCOUS_RANGE),
        )
    ]  # fmt: skip
    effects = prior(robot, DRY, VISCOUS)
    return tuple(Known(effect, "assumed", note) for effect, note in zip(effects, notes, strict=True))


def prior(robot: Robot, dry: float, viscous: float) -> tuple[CoulombFriction, ViscousFriction]:
    """Friction as shares of the effort limits: dry, and viscous at full speed."""
    rated = robot.rated
    return CoulombFriction(tau_c=dry * rated.effort), ViscousFriction(b=viscous * rated.effort / rated.velocity)


def friction_range(model: PowerModel, robot: Robot) -> tuple[tuple[str, PowerModel], ...]:
    """The model at the four corners of the prior's range, by name; none if its friction is not the prior's."""
    held = prior(robot, DRY, VISCOUS)
    if any(model.get(effect.name) != effect for effect in held):
        return ()
    out = []
    for dry in DRY_RANGE:
        for viscous in VISCOUS_RANGE:
            other = model
            for effect in prior(robot, dry, viscous):
                other = other.replaced(effect)
            name = f"friction {100 * dry:g} % dry, {100 * viscous:g} % viscous"
            out.append((name, replace(other, uncertainty=None)))
    return tuple(out)


def has_friction(model: PowerModel) -> bool:
    """True if an effect of the model takes energy from motion at the joints."""
    return any(effect.dissipates and effect.stage == "torque" for effect in model.effects)


@cache
def by_name(name: str) -> Robot:
    """The robot of a name in the catalogue, loaded once."""
    return load_robot(name)


MEAN_OVERHEAD = 92.3  # [W] mean overhead of the eight static poses of Method 1, on a Panda


def source_method_1(robot: Robot | str = "panda") -> PowerModel:
    """Method 1 of Petrichenko et al. 2024 (arXiv 2411.03194): R = 0, the mean overhead of eight static poses.

    For arms other than the Panda, the overhead is the standby of `known.electrical`.
    """
    arm = _robot_of(robot)
    own = arm.name == "panda" and _fitting(arm, "panda")
    standby = Standby(power=MEAN_OVERHEAD) if own else electrical(arm)[0].effect
    return PowerModel(arm.name, (standby,))


def source_method_2(robot: Robot | str = "panda") -> PowerModel:
    """Method 2 of the same paper: least squares of static power over |gravity torque|^2, Franka Panda.

    For other arms, standby and copper loss are those of `known.electrical`.
    """
    arm = _robot_of(robot)
    return PowerModel(arm.name, tuple(known.effect for known in electrical(arm)))


def careful(robot: Robot | str) -> PowerModel:
    """The source paper's Method 2 with friction, published or assumed, and no regeneration."""
    arm = _robot_of(robot)
    model = source_method_2(arm).replaced(Regeneration(efficiency=0.0))
    for known in friction(arm):
        model = model.replaced(known.effect)
    return model


def assumes_no_regeneration(model: PowerModel, robot: Robot) -> bool:
    """True if it is `careful`, perhaps with a payload or a tilt: nothing is known of regeneration."""
    return set(careful(robot).effects) <= set(model.effects)


def _robot_of(robot: Robot | str) -> Robot:
    """The robot itself, or the one of a name in the catalogue."""
    expect(robot, Robot | str, "--robot")
    return by_name(robot) if isinstance(robot, str) else robot


# Models by name, each a function of the robot.
NAMED: dict[str, Callable[[Robot | str], PowerModel]] = {
    "source-method-1": source_method_1,
    "source-method-2": source_method_2,
    "careful": careful,
}


def is_named(word: str) -> bool:
    """True if there is a model of that name; underscores count as dashes."""
    return word.replace("_", "-") in NAMED


def named_model(word: str, robot: Robot | str) -> PowerModel:
    """The model of that name for a robot, or the robot of a name; check with `is_named` first."""
    return NAMED[word.replace("_", "-")](robot)


def load_model(word: str | PathLike[str], robot: Robot | str | None = None) -> PowerModel:
    """A model from a file or by a name.

    A file is TOML of the format energy-opt/model/1 (`energy-opt --example model` prints one). Its values are in SI
    units: W, N m, W/(N m)^2. A list has one value for each joint, in the robot's order.

    Args:
        word: the file; or "source-method-1", "source-method-2" or "careful".
        robot: the arm of a named model, or its name in the catalogue; a file needs none.

    Raises:
        BadInput: neither a file nor a name, a named model without a robot, or a fault in the file: names the effect and
            the parameter.
    """
    if not isinstance(word, (str, PathLike)):
        raise BadInput(f"--model {shown(word)}: expected a name, a file, a PowerModel or its document")
    if is_named(str(word)):
        if robot is None:
            raise BadInput(f"model {word}: depends on the robot; expected load_model({str(word)!r}, robot)")
        return named_model(str(word), robot)
    if not path_of(word, "--model").is_file() and not Path(word).suffix:
        hint = suggest(str(word).replace("_", "-"), NAMED)
        raise BadInput(f"--model {word}: neither a model file nor a name ({', '.join(NAMED)}){hint}")
    return read_model(Path(word))
