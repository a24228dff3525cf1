"""Causes where dry and viscous friction are declared, and the arm's friction differs from them in one way.

    python benchmarks/declared_friction.py [--arms panda ur5 ...] [--seed 0] [--out numbers.json]

The declared model is complete: standby, copper loss, dry and viscous friction as the arm has them, but for one change.
The arm (MuJoCo) has the change of a row of `CHANGES`. The meter has 0.6 W of noise. The laws are the package's own. A
verdict is right, open, missed or false as in `few_moves.py`. Exit code 1 if more than 5 % of the sets are false.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from few_moves import counted, kind_of
from virtual_arms import ARMS
from virtual_sets import base_model, make_set

from energy_opt.diagnosis import diagnose
from energy_opt.effects import AsymmetricFriction, CoulombFriction, Effect, ViscousFriction
from energy_opt.measured import read_set
from energy_opt.virtual_arm.simulate import Instruments

Draw = Callable[[np.random.Generator, np.ndarray], Effect]


def by_direction(joints: int) -> Draw:
    """Dry friction that differs by direction in so many joints; its mean is the declared one."""

    def draw(rng: np.random.Generator, dry: np.ndarray) -> Effect:
        apart = np.zeros(len(dry))
        chosen = rng.permutation(len(dry))[:joints]
        apart[chosen] = dry[chosen] * rng.uniform(0.5, 0.9, len(chosen)) * rng.choice([-1, 1], len(chosen))
        return AsymmetricFriction(tau_plus=dry + apart, tau_minus=dry - apart)

    return draw


def doubled(rng: np.random.Generator, dry: np.ndarray) -> Effect:
    """Twice the dry friction in one joint."""
    return CoulombFriction(tau_c=np.where(np.arange(len(dry)) == rng.integers(len(dry)), 2, 1) * dry)


CHANGES: dict[str, Draw] = {
    "one direction of one joint": by_direction(1),
    "one direction of three joints": by_direction(3),
    "dry friction of one joint": doubled,
}


def examine(arm: str, change: str, seed: int) -> dict[str, Any]:
    """The verdict on one set."""
    rng = np.random.default_rng([seed, *f"{arm} {change}".encode()])
    dry = np.array(ARMS[arm].friction) * rng.uniform(0.7, 1.3, len(ARMS[arm].friction))
    usual = ViscousFriction(b=dry * rng.uniform(0.5, 1.5, len(dry)))
    owned = base_model(arm).replaced(CoulombFriction(tau_c=dry)).replaced(usual)
    true = CHANGES[change](rng, dry)
    with tempfile.TemporaryDirectory() as folder:
        path, calm = Path(folder) / "set", Instruments(noise=0.6, power_resolution=0.05)
        made = make_set(path, arm, [true, usual], seed=seed, instruments=calm, declared=owned)
        said = diagnose(read_set(made.folder), owned).document()
    return {"arm": arm, "change": change, "verdict": said["verdict"], "named": [row["name"] for row in said["effects"]],
            "open": said["alternatives"], "kind": kind_of(said, [true.name])}  # fmt: skip


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where the bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    sets = []
    for arm in args.arms:
        for change in CHANGES:
            sets.append(examine(arm, change, args.seed))
            row = sets[-1]
            print(row["kind"], arm, f"{change}:", row["verdict"], *row["named"], row["open"], flush=True)
    return counted(sets, args.out)


if __name__ == "__main__":
    sys.exit(main())
