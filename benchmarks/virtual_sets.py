"""Seeded measured sets with known causes, for tests and benchmarks.

    from virtual_arms import draw_effect, draw_special
    from virtual_sets import make_set

    # an undeclared effect of a realistic size; declared.toml lacks it
    make_set(folder, robot="panda", effects=[draw_effect(CoulombFriction, "panda", rng)], seed=3)
    make_set(folder, robot="ur5", effects=["payload", "viscous_friction"], seed=4)      # sizes drawn from the seed
    make_set(folder, robot="z1", specials=["cogging"], seed=5)                          # outside the library
    make_set(folder, robot="xarm7", seed=6)                                             # clean
    make_set(folder, robot="panda", effects=["armature"], weak="static_only", seed=7)   # too little excitation
    make_set(folder, robot="panda", effects=["coulomb_friction"], weak="still_joint", seed=8)

The folder then holds log.toml and the runs (CONTRACT.md), declared.toml (the owner's model: true standby and copper
loss, unless `declared` says otherwise) and truth.toml. `MadeSet.model` is the true model, `fresh_motions` makes
further runs of the same arm that no fit has seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from virtual_arms import ARMS, draw_effect, draw_special
from virtual_motions import excitation

from energy_opt.effects import BY_NAME, CopperLoss, Effect, Standby
from energy_opt.errors import BadInput
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot
from energy_opt.virtual_arm.plant import Plant, Special
from energy_opt.virtual_arm.simulate import Instruments, Reference, Run, simulate

Weak = Literal["", "static_only", "still_joint"]

# Effects that are one and the same at the meter, each with what it may be taken for.
EQUIVALENT = {"supply_efficiency": ["meter_gain"], "meter_gain": ["supply_efficiency"]}


@dataclass(frozen=True)
class MadeSet:
    """A set and what is true of it.

    Attributes:
        folder: where it lies.
        robot: the arm.
        plant: its true effects and specials.
        declared: the model that its owner hands in.
        instruments: how it was measured.
        runs: the runs as they truly were.
        seed: what it was drawn from.
    """

    folder: Path
    robot: Robot
    plant: Plant
    declared: PowerModel
    instruments: Instruments
    runs: list[Run]
    seed: int

    @property
    def model(self) -> PowerModel:
        """The true model, less what no model knows."""
        return self.plant.model


@lru_cache(maxsize=16)
def arm(name: str) -> Robot:
    """The robot of that name, loaded once."""
    return load_robot(name)


def base_model(robot: str) -> PowerModel:
    """Standby and copper loss of the arm `robot`, the model that its owner knows."""
    data = ARMS[robot]
    return PowerModel(robot, (Standby(power=data.standby), CopperLoss(r_over_kt2=data.r_over_kt2)))


def draw_instruments(robot: str, rng: np.random.Generator) -> Instruments:
    """Instruments as found: 125 Hz, one set in three with a meter of its own.

    Noise from 0.3 W to 2 % of the arm's standby, at most 2 W, evenly spread on a logarithmic scale.
    """
    loudest = min(2.0, 0.02 * ARMS[robot].standby)
    return Instruments(
        noise=float(np.round(np.exp(rng.uniform(np.log(0.3), np.log(loudest))), 2)),
        power_resolution=float(rng.choice([0.02, 0.05, 0.1])),
        position_resolution=float(rng.choice([5e-6, 2e-5])),
        meter_rate=float(rng.choice([50.0, 100.0])) if rng.random() < 1 / 3 else None,
        jitter=4e-4 if rng.random() < 1 / 3 else 0.0,
    )


def make_set(
    folder: Path,
    robot: str = "panda",
    effects: Sequence[Effect | str] = (),
    specials: Sequence[Special | str] = (),
    *,
    seed: int = 0,
    category: str | None = None,
    declared: PowerModel | None = None,
    instruments: Instruments | None = None,
    weak: Weak = "",
    motions: int = 9,
    poses: int = 6,
) -> MadeSet:
    """Simulate and write a measured set.

    Args:
        robot: one of `ARMS`.
        effects: what the declared model lacks: effects, or names, whose sizes are then drawn. A standby or copper loss
            given here takes the place of the arm's own in the plant (the declared model keeps the arm's own).
        specials: effects outside the library, or their names.
        category: what truth.toml calls it; by default clean, single, double, unlisted or weak.
        declared: the owner's model, if not the arm's own standby and copper loss.
        instruments: how it is measured; drawn from the seed by default.
        weak: "static_only": poses and no motion; "still_joint": one joint, drawn, never moves.
        motions, poses: how many runs of each.

    Raises:
        BadInput: the robot is not one of `ARMS`, or MuJoCo is absent.
    """
    if robot not in ARMS:
        raise BadInput(f"no virtual sets of {robot!r}; arms: {', '.join(ARMS)}")
    rng = np.random.default_rng([seed, sum(map(ord, robot))])
    body = arm(robot)
    true = base_model(robot)
    given = [draw_effect(BY_NAME[x], robot, rng) if isinstance(x, str) else x for x in effects]
    for effect in given:
        true = true.replaced(effect)
    odd = tuple(draw_special(x, robot, rng) if isinstance(x, str) else x for x in specials)
    seen = instruments or draw_instruments(robot, rng)
    still = (int(rng.integers(body.n)),) if weak == "still_joint" else ()
    references = excitation(body, rng, 0 if weak == "static_only" else motions, poses, still)
    plant, owned = Plant(true, odd), declared or base_model(robot)
    names = [effect.name for effect in given]
    truth: dict[str, Any] = {
        "set": Path(folder).name,
        "category": category or _category(names, odd, weak),
        "weak": weak,
        "names": names,
        "equivalent": [other for name in names for other in EQUIVALENT.get(name, [])],
        "seed": seed,
    }
    runs = simulate(
        references, plant, body, folder, seed=seed, instruments=seen, starts=_starts(references, seen, rng), truth=truth
    )
    owned.save(folder / "declared.toml")
    return MadeSet(folder, body, plant, owned, seen, runs, seed)


def fresh_motions(made: MadeSet, folder: Path, count: int = 4) -> MadeSet:
    """Further motions of the same arm under the same instruments, in a set of their own."""
    rng = np.random.default_rng([made.seed, 77])
    references = excitation(made.robot, rng, count, 0)
    starts = made.runs[-1].start + 20.0 + _starts(references, made.instruments, rng)
    seed = made.seed + 7919
    runs = simulate(references, made.plant, made.robot, folder, seed=seed, instruments=made.instruments, starts=starts)
    made.declared.save(folder / "declared.toml")
    return MadeSet(folder, made.robot, made.plant, made.declared, made.instruments, runs, seed)


def _starts(references: Sequence[Reference], seen: Instruments, rng: np.random.Generator) -> np.ndarray:
    """Set times of the runs' beginnings: 8 to 20 s between one's end and the next."""
    lengths = np.array([r.duration + 2 * seen.rest for r in references])
    gaps = rng.uniform(8.0, 20.0, len(references))
    return np.round(np.concatenate([[0.0], np.cumsum((lengths + gaps)[:-1])]), 2)


def _category(names: Sequence[str], specials: Sequence[Special], weak: str) -> str:
    if weak:
        return "weak"
    if specials:
        return "unlisted"
    return ("clean", "single", "double")[min(len(names), 2)]
