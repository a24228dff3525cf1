"""The judge: a trajectory's limits on a dense grid, from its samples, Pinocchio's torque and the exact laws alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.cell.cell import Clearance
from energy_opt.motion.dense import Dense
from energy_opt.motion.judge.energy import DENSER, Energy, Scorer, blocks
from energy_opt.motion.judge.proven import proven
from energy_opt.motion.limits.base import Limit, Violation
from energy_opt.motion.trajectory import Filled, Trajectory
from energy_opt.robot.limits import TURNING as OF_JOINTS

PEAKS, FINER = 64, 64  # highest peaks of a limit to check again, and parts into which a place is divided for this
ALLOWED = 1e-6  # share of a bound: a larger excess is a violation
BINDS = 0.01  # share of a bound within which it is called binding: the fastest motions leave less of it


@dataclass(frozen=True)
class Certificate:
    """The certificate of a trajectory under its limits.

    `found` is the worst place under each limit, in the order of the limits; `peak_power` [W] of the whole arm;
    `clearance` from all bodies, None if not asked for; `proven`: `found` holds between the samples too.
    """

    samples: int
    found: tuple[Violation, ...]
    peak_power: float
    clearance: Clearance | None = None
    proven: bool = False

    @property
    def max_violation(self) -> dict[str, float | None]:
        """Per limit, as a fraction of the bound (of the range for position): <= 0 is inside, -1 unlimited or unused.

        None if it is unknown.
        """
        return {found.limit: found.excess for found in self.found}

    @property
    def worst(self) -> dict[str, object]:
        """The limit that is used most: its name, joint (or other limited part), time [s], value and bound."""
        return _document(max(self.found, key=_size))

    @property
    def tightest(self) -> str:
        """The limit that is used most, in words."""
        worst = self.worst
        return f"the tightest limit is the {worst['limit']} of {worst['joint']} at {worst['time']:.4g} s"

    @property
    def binding(self) -> dict[str, object]:
        """As `worst`, among the limits that more time would relax: all but the position's, if there are others.

        A condition of the move comes before the arm's own limits: some of those always bind in the fastest motion.
        """

        def order(found: Violation) -> tuple[bool, bool, float]:
            size = _size(found)
            return found.limit != "position", found.limit not in OF_JOINTS and size > -BINDS, size

        return _document(max(self.found, key=order))

    @property
    def within_limits(self) -> bool:
        """No limit is violated by more than 1e-6 of its bound."""
        return self.violation <= ALLOWED

    @property
    def valid(self) -> bool:
        """Within limits, and proven clear of all bodies."""
        return self.within_limits and self.clear

    @property
    def clear(self) -> bool:
        """Proven clear of all bodies, if that was asked for."""
        return self.clearance is None or self.clearance.proven

    @property
    def violation(self) -> float:
        """The largest excess of all limits; infinite if one is unknown."""
        return max(_size(found) for found in self.found)

    def document(self) -> dict[str, object]:
        """As result.json has it."""
        clearance = None if self.clearance is None else self.clearance.document()
        how = "proven" if self.proven else "sampled"
        limits = {"limits": how, "max_violation": self.max_violation, "worst": self.worst}
        return {"samples": self.samples, **limits, "clearance": clearance}

    def tightened(self, limits: Sequence[Limit]) -> tuple[Limit, ...]:
        """The judged limits, each broken one reduced by slightly more than its excess."""
        shares = [1 / (1 + 1.5 * size + 2 * ALLOWED) if (size := _size(found)) > 0.1 * ALLOWED else 1.0
                  for found in self.found]  # fmt: skip
        return tuple(limit.scaled(share) for limit, share in zip(limits, shares, strict=True))


def _document(found: Violation) -> dict[str, object]:
    return {
        "limit": found.limit,
        "joint": found.where,
        "time": found.time,
        "value": found.value,
        "bound": found.bound,
    }


def _size(found: Violation) -> float:
    return np.inf if found.excess is None else found.excess


def certify(
    trajectory: Trajectory,
    scorer: Scorer,
    limits: Sequence[Limit],
    samples: int | None = None,
    samples_only: bool = False,
) -> Certificate:
    """Check a trajectory against limits on a grid at least ten times denser than its samples.

    Long trajectories are checked block by block, in bounded memory; laws with memory start anew in each block.

    Args:
        scorer: gives torque and power under the model.
        samples: least number of the grid's places; None for ten times the samples.
        samples_only: check at the samples alone, and prove nothing between them.
    """
    factor = DENSER if samples is None else DENSER * max(1, -(-samples // (DENSER * (len(trajectory.time) - 1))))
    factor = 1 if samples_only else factor
    return _pieces(trajectory, scorer, limits, factor, lambda dense: None)


def certify_and_score(
    trajectory: Trajectory, scorer: Scorer, limits: Sequence[Limit]
) -> tuple[Certificate, Energy, Filled]:
    """Certificate under `limits`, energy, and the trajectory with effort and power, in one pass with bounded memory."""
    spent: list[tuple[float, dict[str, float]]] = []
    effort: list[np.ndarray] = []
    power: list[np.ndarray] = []

    def look(dense: Dense) -> None:
        own = slice(DENSER if spent else 0, None, DENSER)  # pieces share their ends
        spent.append(scorer.energy_of_piece(dense))
        effort.append(dense.effort[own].copy())
        power.append(dense.power[own].copy())

    certificate = _pieces(trajectory, scorer, limits, DENSER, look)
    filled = trajectory.filled(np.concatenate(effort), np.concatenate(power))
    return certificate, scorer.energy_of_pieces(trajectory, spent), filled


def _pieces(
    trajectory: Trajectory, scorer: Scorer, limits: Sequence[Limit], factor: int, look: Callable[[Dense], None]
) -> Certificate:
    """The certificate, piece by piece; each piece is passed to `look`. Via points are searched among all."""
    parts = blocks(trajectory, factor)
    if len(parts) == 1:
        dense = scorer.dense(trajectory, factor)
        look(dense)
        return certificate_of(dense, limits, scorer)
    found = []
    for part in parts:
        dense = scorer.dense(trajectory, factor, part)
        look(dense)
        found.append(certificate_of(dense, [limit for limit in limits if not limit.via.size], scorer))
    worst = iter([max(places, key=_size) for places in zip(*(c.found for c in found), strict=True)])
    samples = scorer.dense(trajectory, 1) if any(limit.via.size for limit in limits) else None
    whole = tuple(limit.worst(samples) if samples is not None and limit.via.size else next(worst) for limit in limits)
    sure = all(c.proven for c in found) and samples is None
    return Certificate((len(trajectory.time) - 1) * factor + 1, whole, max(c.peak_power for c in found), proven=sure)


def certificate_of(dense: Dense, limits: Sequence[Limit], scorer: Scorer) -> Certificate:
    """The certificate of a trajectory that is already on a dense grid, by the scorer's model; without clearance."""
    found, most = [limit.worst(dense) for limit in limits], float(dense.power.max())
    peaked = [(k, use) for k, limit in enumerate(limits) if (use := limit.peaked(dense)) is not None]
    times = [_times_of_peaks(dense.time, use) for _, use in peaked]
    times.append(_times_of_peaks(dense.time, dense.power[:, None] / most) if most > 0 else np.zeros(0))
    time = np.unique(np.concatenate(times))
    if len(time):  # peaks may be narrower than the spacing of the grid
        there = scorer.between(dense, time)
        most = max(most, float(there.power.max()))
        for k in (k for (k, _), near in zip(peaked, times, strict=False) if len(near)):
            found[k] = max(found[k], limits[k].worst(there), key=_size)
    places, sure = proven(dense, scorer, limits, found) if dense.factor > 1 else (tuple(found), False)
    return Certificate(len(dense.time), places, most, proven=sure)


def _times_of_peaks(time: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Times around the places (M,) where the used share of a limit (M, m) may exceed 1 between two of them.

    A peak of three places u- < u > u+ reaches at most (2 u - u- - u+) / 2 above u if both its sides are straight, and a
    quarter of that if it is a parabola.
    """
    if len(use) < 3:
        return np.zeros(0)
    low, middle, high = use[:-2], use[1:-1], use[2:]
    reach = np.where((middle >= low) & (middle >= high), middle + (2 * middle - low - high) / 2, 0.0).max(axis=1)
    near = np.flatnonzero(reach > 1)
    near = np.sort(near[np.argsort(-reach[near])[:PEAKS]]) + 1
    return (np.linspace(time[near - 1], time[near + 1], 2 * FINER + 1)).T.ravel()
