"""Jobs whose steps end at poses of the tool: the joint positions of all of them are chosen over the whole cycle.

choose     the cheapest ring through the branches of every pose, by estimates of moves that share the cycle's time; if
           one of its straight moves touches something, also the cheapest ring whose straight moves are clear
improve    if poses leave freedom, each end in turn is moved along it, by the same estimates
settle     rough cycles, bent, show where ends cost less; they are settled again there

`run_posed` then solves the cycle in full with the ends whose rough cycle costs least.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.jobs.cycle import Plan, Scorers
from energy_opt.jobs.file import Job
from energy_opt.jobs.legs import pose_in_base
from energy_opt.jobs.solve_job import RoughCycles
from energy_opt.jobs.work import Cells
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.move import Settings
from energy_opt.poses.distance import nearer_words
from energy_opt.poses.estimate import curves, holding, quickest
from energy_opt.poses.freedom import Bent, has_freedom, improved
from energy_opt.poses.inverse import ToolKinematics, turned_near
from energy_opt.poses.pose import Pose
from energy_opt.poses.sets import (
    BLOCKED,
    DETOUR,
    KNOWN,
    Layer,
    Ring,
    as_reached,
    positions_near,
    positions_of,
    straight_is_free,
    thinned,
)
from energy_opt.poses.turns import turned, unwound
from energy_opt.power import PowerModel

SWEEPS = 3  # sweeps over all ends, by estimates
WORTH = 1e-3  # share of the losses: ends are not optimized again if bent motions promise to save less
SETTLED = 5  # most rough cycles
RINGS = 24  # most rings through the branches to estimate for alternatives
SAME = 0.1  # [rad, m] largest difference of positions that are `same`
Ends = dict[int, np.ndarray]  # positions (n,) of steps


def same(one: Ends, other: Ends) -> bool:
    """True if positions are so near each other that they settle at the same optimum."""
    return all(np.abs(q - other[k]).max() <= SAME for k, q in one.items())


class Posed:
    """The choice of positions for one job.

    Args:
        cell: as for `run_job`; poses may be in the frames of its scene.
        starts: positions (K, n) of steps near which positions are searched, quickly and without contact checks; by
            default all branches are searched.

    Raises:
        Infeasible: a pose is out of reach, or reached only with contact.
    """

    def __init__(
        self,
        job: Job,
        model: PowerModel,
        settings: Settings,
        cell: CellRequest,
        starts: Mapping[int, np.ndarray] | None = None,
    ) -> None:
        self.job, self.scorers = job, Scorers(job.robot, model)
        self.cells = Cells(job, cell)
        self.tool = ToolKinematics(job.robot, cell.tool)
        self.moving = [k for k, step in enumerate(job.steps) if step.wait is None]
        self._turning = [k in job.open for k in self.moving]
        self.asked = {k: pose_in_base(job.steps[k], job.robot, cell) for k in job.open}
        self.poses = {k: as_reached(self.tool, pose, (starts or {}).get(k)) for k, pose in self.asked.items()}
        known: dict[Any, np.ndarray] = {}
        self.sets: dict[int, np.ndarray] = {}
        for k in self.moving:
            step = job.steps[k]
            target = self.poses.get(k, step.goal)
            zero, held = job.robot.limits.near_zero, job.given_before(k)
            near = zero if held is None else np.where(self.tool.moving, zero, held)
            key = (str(target.document()), step.scene, near.tobytes()) if isinstance(target, Pose) else k
            if starts is not None and k in starts and isinstance(target, Pose):
                known[key] = positions_near(self.tool, target, starts[k])
            elif key not in known:
                cell_of = None if starts is not None else self.cells.of(step)
                known[key] = positions_of(self.tool, target, cell_of, near=near, seed=settings.seed)
            self.sets[k] = known[key]

    def estimate(self) -> float:
        """The likely energy [J] of the cycle, before its ends are improved."""
        return self._cheapest(self._first_ring())[1]

    def choices(self) -> list[Ends]:
        """Positions of all moving steps' ends that are likely to be cheapest.

        If a straight move between them touches something, those come first whose straight moves are all clear.
        """
        ring = self._first_ring()
        out = [self._improved(self._ends(ring, self._cheapest(ring)[0]))]
        if not self._is_clear(out[0]):
            clear = self._improved(self._ends(ring, self._cheapest(ring, BLOCKED)[0]), BLOCKED)
            out = out if same(clear, out[0]) else [clear, *out]
        return out

    def likely(self, rough: RoughCycles, settle: bool = False) -> list[Ends]:
        """The choices, settled, those with the cheapest rough cycle first; without `settle` a single one as it is."""
        found = self.choices()
        if len(found) > 1 or settle:
            settled = [self.settled(rough, ends) for ends in found]
            found = [ends for ends, _, _ in sorted(settled, key=lambda item: item[2])]
        return found

    def alternatives(self, count: int) -> list[Ends]:
        """At most `count` different choices of positions at the ends of all moving steps, the likely cheapest first."""
        found: list[tuple[float, Ends]] = []
        for ends in islice(self._rings(), RINGS):
            ends = self._improved(ends)
            if not any(same(ends, other) for _, other in found):
                ring = self._ring([self._layer(k, q[None]) for k, q in ends.items()])
                found.append((self._cheapest(ring)[1], ends))
        return [ends for _, ends in sorted(found, key=lambda item: item[0])[:count]]

    def _rings(self) -> Iterator[Ends]:
        """Positions of all moving steps' ends: each differs in every move from those before."""
        ring, costly = self._first_ring(), np.inf
        while True:
            chosen, energy = self._cheapest(ring)
            if energy > costly:
                return
            yield self._ends(ring, chosen)
            costly = min(costly, energy + KNOWN / 2)
            ring.avoid(chosen)

    def _first_ring(self) -> Ring:
        """The ring through all branches; of a pose with very many, through some that are far from each other."""
        nearest = self.greedy()
        costs = {k: holding(self._models(k), q) for k, q in self.sets.items()}
        sets = [np.vstack([nearest[k], thinned(self.sets[k], costs[k])]) for k in self.moving]
        return self._ring(list(map(self._layer, self.moving, sets, self._turning)))

    def _ends(self, ring: Ring, chosen: Sequence[int]) -> Ends:
        """The positions that a ring passes."""
        chain = [at.positions[c] for at, c in zip(ring.layers, chosen, strict=True)]
        return self._by_step(unwound(self.tool, chain, self._turning, True))

    def _ring(self, layers: Sequence[Layer]) -> Ring:
        """The ring through positions at the ends of all moving steps."""
        order = [*self.moving[1:], self.moving[0]]  # the move from one layer ends the next moving step
        bounds = [(self.job.steps[k].least, self.job.steps[k].most) for k in order]
        return Ring(self.tool, layers, [self._models(k) for k in order], bounds)

    def _cheapest(self, ring: Ring, detour: float = DETOUR) -> tuple[list[int], float]:
        """The cheapest ring in the cycle's time without its waits; see `Ring.cheapest`."""
        waiting = min(float(layer.standing.min()) for layer in ring.layers)
        order = [*self.moving[1:], self.moving[0]]
        free = lambda k, a, b: self._straight_is_free(order[k], a, b)  # noqa: E731
        return ring.cheapest(self.job.cycle_time - self.job.waiting, waiting, free, detour)

    def _straight_is_free(self, k: int, start: np.ndarray, goal: np.ndarray) -> bool:
        """True if a straight move (n,) of a moving step touches nothing."""
        return straight_is_free(self.cells.of(self.job.steps[k]), start, goal)

    def _is_clear(self, ends: Ends) -> bool:
        """True if the straight moves between these ends touch nothing."""
        return all(self._straight_is_free(k, ends[self._around(k)[0]], q) for k, q in ends.items())

    def _turned(self, ends: Ends, detour: float) -> Ends:
        """The ends, with joints turned by whole turns to where the cycle is likely to be cheaper."""

        def cheapest(sets: Sequence[np.ndarray]) -> list[int]:
            return self._cheapest(self._ring(list(map(self._layer, self.moving, sets))), detour)[0]

        return self._by_step(turned(self.tool, [ends[k] for k in self.moving], self._turning, cheapest))

    def _by_step(self, chain: Sequence[np.ndarray]) -> Ends:
        return dict(zip(self.moving, chain, strict=True))

    def _layer(self, k: int, q: np.ndarray, turning: bool = False) -> Layer:
        """Positions q (K, n) at which a moving step may end, and the power of the waits after it."""
        return Layer(q, self._held(k), holding(self._models(k), q), turning)

    def _held(self, k: int) -> float:
        """Seconds that the motors hold the arm at the end of a moving step, by the job's waits."""
        steps, after = self.job.steps, self.moving[(self.moving.index(k) + 1) % len(self.moving)]
        places = range(k + 1, after if after > k else after + len(steps))
        waits = [steps[m % len(steps)] for m in places]
        return sum(step.wait or 0.0 for step in waits if not step.brakes)

    def _improved(self, ends: Ends, detour: float = DETOUR) -> Ends:
        """The ends, turned; each with freedom moved along it, the others held, at durations that share the time."""
        ends = self._turned(ends, detour)
        for _ in range(SWEEPS):
            price = self._price(ends)
            before = {k: q.copy() for k, q in ends.items()}
            for k, pose in self.poses.items():
                if has_freedom(self.tool, pose):
                    cell = self.cells.of(self.job.steps[k])
                    ends[k] = improved(self.tool, pose, ends[k], self._cost(k, ends, price), cell)
            if max((np.abs(ends[k] - before[k]).max() for k in ends), default=0.0) < 1e-2:
                break
        return ends

    def _around(self, k: int) -> tuple[int, int]:
        """The moving steps before and after a moving step."""
        place = self.moving.index(k)
        return self.moving[place - 1], self.moving[(place + 1) % len(self.moving)]

    def _models(self, k: int) -> list[Scorer]:
        return [self.scorers.of(self.job.steps[k])]

    def _price(self, ends: Ends) -> float:
        """Value of a second [W] if straight moves between these ends share the cycle's time."""
        pairs = [(self._around(k)[0], k) for k in self.moving]
        known = [curves(self._models(k), ends[a][None], ends[k][None]) for a, k in pairs]
        time = self.job.cycle_time - self.job.waiting
        high = min(float(holding(self._models(k), ends[k][None])[0]) for k in self.moving)
        low = high - 1e6
        for _ in range(60):
            price = (low + high) / 2
            used = sum(float(c.cheapest(price)[1][0]) for c in known)
            low, high = (price, high) if used <= time else (low, price)
        return low

    def _cost(self, k: int, ends: Ends, price: float) -> Callable[[np.ndarray], np.ndarray]:
        """Cost (M,) [J] of positions (M, n) at the end of step k: both moves and the wait there, less the price of
        time.
        """
        before, after = self._around(k)
        wait = self._held(k)
        here, there = self.job.steps[k], self.job.steps[after]

        def cost(q: np.ndarray) -> np.ndarray:
            first, last = (np.broadcast_to(ends[j], q.shape) for j in (before, after))
            out = curves(self._models(k), first, q).cheapest(price, here.most, here.least)[0]
            out = out + curves(self._models(after), q, last).cheapest(price, there.most, there.least)[0]
            return np.asarray(out + wait * holding(self._models(k), q))

        return cost

    def greedy(self) -> Ends:
        """At every pose the positions that are quickest to reach from the previous ones."""
        robot, out = self.job.robot, Ends()
        first = self._turning.index(False) if False in self._turning else -1
        q = robot.limits.near_zero
        for k in [*self.moving[first:], *self.moving[:first]]:
            q = out[k] = quickest(
                robot, q, turned_near(self.sets[k], q, self.tool) if k in self.poses else self.sets[k]
            )
        return out

    def near(self, ends: Ends) -> tuple[str, ...]:
        """A warning for each pose whose position is nearer to a body than the clearance."""
        return nearer_words((pose.name, ends[k], self.cells.of(self.job.steps[k])) for k, pose in self.poses.items())

    def _bent_legs(self, plan: Plan) -> dict[int, Bent]:
        """The solved motions by the step that they end."""
        pairs = zip(plan.legs, plan.answers, strict=True)
        return {leg.steps[-1]: Bent(self._models(leg.steps[-1]), a.trajectory, True) for leg, a in pairs}

    def bending(self, plan: Plan) -> Callable[[Ends], float]:
        """A function for the cost [J] of the solved motions, with waits, when they are bent to other ends."""
        of = self._bent_legs(plan)
        places = sorted(of)

        def cost(ends: Ends) -> float:
            total = 0.0
            for k, before in zip(places, [places[-1], *places[:-1]], strict=True):
                total += float(of[k](ends[before][None], ends[k][None])[0])
                total += self._held(k) * float(holding(self._models(k), ends[k][None])[0])
            return total

        return cost

    def bent(self, plan: Plan, ends: Ends) -> tuple[Ends, float]:
        """Ends at which the solved motions, bent, cost less, and the promised saving [J]."""
        of = self._bent_legs(plan)
        places = sorted(of)
        ends, gain = dict(ends), 0.0
        for k, pose in self.poses.items():
            if k not in of or not has_freedom(self.tool, pose):
                continue
            after = places[(places.index(k) + 1) % len(places)]
            inward, outward, models, wait = of[k], of[after], self._models(k), self._held(k)

            def cost(
                q: np.ndarray, inward: Bent = inward, outward: Bent = outward, models: list[Scorer] = models,
                wait: float = wait,
            ) -> np.ndarray:  # fmt: skip
                return np.asarray(inward(None, q) + outward(q, None) + wait * holding(models, q))

            q = improved(self.tool, pose, ends[k], cost, self.cells.of(self.job.steps[k]))
            values = cost(np.vstack([ends[k], q]))
            gain, ends[k] = gain + float(values[0] - values[1]), q
        return ends, gain

    def settled(self, rough: RoughCycles, ends: Ends, near: Plan | None = None) -> tuple[Ends, Plan | None, float]:
        """Ends moved along their freedom to where the rough cycle costs least, that cycle, and its energy [J].

        The derivative with respect to an end is that of both its motions, bent (envelope theorem). Without a rough
        cycle, returns the given ends and infinite energy.

        Args:
            near: a cycle with other ends, from whose motions the first begins.
        """
        plan, energy = None, np.inf
        moved, gain = ends, np.inf
        for _ in range(SETTLED):
            try:
                there, cost = rough.cycle(self.job.at(moved), self.cells, plan or near)
            except Infeasible:
                break
            if cost >= energy:
                break
            ends, plan, energy = moved, there, cost
            moved, gain = self.bent(plan, ends)
            if gain <= WORTH * sum(answer.energy.loss for answer in plan.answers):
                break
        return ends, plan, energy
