"""A suite of virtual sets: every effect alone, pairs, clean sets, effects outside the library, too little excitation.

for case in suite(singles=2, clean=40):
    made = case.make(folder / case.name)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from energy_opt.virtual_arm.arms import SIZES, SPECIAL_SIZES
from energy_opt.virtual_arm.sets import EQUIVALENT, MadeSet, Weak, make_set

SUITE_ARMS = ("panda", "ur5", "ur5e", "xarm7", "z1")

# What poses alone cannot show; a set of poses must not be taken as proof of their absence.
NEEDS_MOTION = ("coulomb_friction", "viscous_friction", "armature", "regeneration", "load_friction")


@dataclass(frozen=True)
class Case:
    """One set of a suite, not made yet.

    Attributes:
        name: unique in the suite.
        category: clean, single, double, unlisted or weak.
        effects, specials: names of what the declared model lacks; sizes are drawn from the seed.
    """

    name: str
    category: str
    robot: str
    seed: int
    effects: tuple[str, ...] = ()
    specials: tuple[str, ...] = ()
    weak: Weak = ""

    def make(self, folder: Path) -> MadeSet:
        """Simulate and write it."""
        return make_set(
            folder,
            self.robot,
            self.effects,
            self.specials,
            seed=self.seed,
            category=self.category,
            weak=self.weak,
        )


def suite(
    *,
    singles: int = 1,
    doubles: int = 20,
    clean: int = 20,
    unlisted: int = 1,
    weak: int = 6,
    seed: int = 0,
    arms: tuple[str, ...] = SUITE_ARMS,
) -> Iterator[Case]:
    """The cases of a suite, in a fixed order.

    Args:
        singles: sets of every effect of the table; arms take turns.
        doubles: sets with two effects, drawn from all pairs that are not one and the same at the meter.
        clean: sets with nothing missing.
        unlisted: sets of every special.
        weak: sets with too little excitation, half of them poses only.
    """
    rng = np.random.default_rng(seed)
    names = [kind.name for kind in SIZES]
    turn = 0

    def case(
        category: str, label: str, effects: tuple[str, ...] = (), specials: tuple[str, ...] = (), weak: Weak = ""
    ) -> Case:
        nonlocal turn
        robot = arms[turn % len(arms)]
        turn += 1
        return Case(f"{turn:03d}_{label}_{robot}", category, robot, 1000 * seed + turn, effects, specials, weak)

    for k in range(singles):
        turn += k  # so that an effect meets another arm in the next round
        for name in names:
            yield case("single", name, effects=(name,))
    for _ in range(doubles):
        while True:
            one, two = (str(name) for name in rng.choice(names, 2, replace=False))
            if two not in EQUIVALENT.get(one, []):
                break
        yield case("double", f"{one}+{two}", effects=(one, two))
    for _ in range(clean):
        yield case("clean", "clean")
    for k in range(unlisted):
        turn += k
        for name in SPECIAL_SIZES:
            yield case("unlisted", name, specials=(name,))
    for k in range(weak):
        lack: Weak = "static_only" if k % 2 == 0 else "still_joint"
        name = NEEDS_MOTION[k // 2 % len(NEEDS_MOTION)]
        yield case("weak", f"{lack}_{name}", effects=(name,), weak=lack)
