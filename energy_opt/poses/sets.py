"""The joint positions that a pose allows, as a layer of a shortest path: all branches, free of contact, well spread.

A cycle passes one position of each layer. With estimated costs of the moves between neighbouring layers, the cheapest
choice is a shortest closed path. A price on time, found by bisection, makes the moves fit into the cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.cell import Cell, Contact
from energy_opt.errors import Infeasible
from energy_opt.motion.judge.energy import Scorer
from energy_opt.poses.distance import is_free, kept_by
from energy_opt.poses.estimate import Curves, curves, holding
from energy_opt.poses.inverse import SMALL, Reached, ToolKinematics, reach, solve
from energy_opt.poses.pose import Pose, numbers_of
from energy_opt.poses.turns import nearest_pairs

Target = Pose | np.ndarray  # the end of a move: a pose of the tool, or joint positions (n,)
MOST = 24  # most positions of a layer inside a cycle
FURTHER = 60  # further starts if none of the given ones reaches a pose
AVOIDED = 12  # most rings to check for moves in contact
# Assumed cost of going around what a straight move touches, as a share of its loss. In four slow ur5e moves it was 0.25
# to 1.5; with 0.3, moves whose detours are short are missed. BLOCKED: the share with which moves in contact come last.
DETOUR, BLOCKED = 0.1, 1e4
KNOWN = 1e6  # [J] assumed cost of the moves of rings that are known, so that others come first
TOO_SLOW = 1e12  # [J] the same of a move that takes longer than it may
HIGHEST = 1e12  # [W] largest change of the price of time to try
LOOKS = 12  # places of a straight move to check
CLOSE = 0.02  # [m, rad] so near a pose, a message names the tolerance that allows it
PRICES = 40  # most prices of time to try


@dataclass(frozen=True)
class Layer:
    """Joint positions, of which a ring passes one.

    Attributes:
        positions: (K, n) [rad, m].
        wait: seconds that the arm waits there; standing: (K,) [W] power of this.
        turning: whether each (K,) or all stand for all their turns within the limits; else only for themselves.
    """

    positions: np.ndarray
    wait: float
    standing: np.ndarray
    turning: bool | np.ndarray = False


def unreachable_error(tool: ToolKinematics, pose: Pose, found: Reached) -> Infeasible:
    """The error of a pose that no joint positions reach; `about` has the nearest one that can be reached."""
    joint, beyond = found.beyond
    at = np.eye(4)
    at[:3, :3], at[:3, 3] = (x[0] for x in tool(found.nearest[None]))
    nearest = numbers_of(at)
    words = ",".join(map(str, (np.round(nearest, 7) + 0.0).tolist()))
    length, angle = _above(1e3 * found.distance), _above(np.degrees(found.angle))
    close = found.distance < CLOSE and found.angle < CLOSE
    hint = f"; --pose-tolerance {length:g}mm,{angle:g}deg allows it" if close else ""
    error = Infeasible(
        f"{pose.name}: no joint positions reach it; the nearest that can be reached is {length:g} mm and {angle:g} deg "
        f"away: {words} in the base frame{hint}{beyond and '; ' + beyond}; choose another pose, a free direction "
        "(--free), or for a pose of the scene another --base",
        joint=joint or None,
        limit="position" if joint else "pose",
    )
    error.about["nearest_pose"] = nearest
    return error


def as_reached(tool: ToolKinematics, pose: Pose, starts: np.ndarray | None = None) -> Pose:
    """The pose; one that is reached within its tolerance only becomes the reached one, with the tolerance left.

    Args:
        tool: its kinematics. pose: as asked for. starts: (K, n) positions that may be near it.
    """
    if starts is not None and (solve(tool, pose, starts)[1] < SMALL).any():
        return pose
    found = reach(tool, pose, starts=FURTHER)
    left = pose.tolerance[0] - found.distance, pose.tolerance[1] - found.angle
    if len(found.positions) or min(left) < 0:
        return pose
    at, q = pose.matrix.copy(), found.nearest[None]
    for _ in range(4):  # shifts in free directions turn with the pose
        shift, turn = np.split(tool.pose_error(replace(pose, matrix=at), q)[0], 2)
        turned = at[:3, :3].T @ tool(q)[0][0]  # the free turn, followed by the error
        at[:3, 3] += at[:3, :3] @ shift
        at[:3, :3] = at[:3, :3] @ turned @ Rotation.from_rotvec(turn).as_matrix() @ turned.T
    return replace(pose, matrix=at, tolerance=left)


def _above(value: float) -> float:
    """A distance [mm] or angle [deg], rounded up to three digits or to 0.001."""
    unit = 10.0 ** np.floor(np.log10(max(value, 0.1)) - 2)
    return float(np.ceil(value / unit) * unit)


def positions_of(
    tool: ToolKinematics, target: Target, cell: Cell | None, *, near: np.ndarray | None = None, seed: int = 0
) -> np.ndarray:
    """All positions (K, n) found that reach a target and keep the clearance; the least near ones if none does.

    Args:
        tool: its kinematics. target: a pose, or positions (n,). cell: bodies to keep clear of; None: none.
        near: (n,) positions at which the search begins, too. seed: of its random starts.

    Raises:
        Infeasible: none reaches it, or each of them touches something.
    """
    if not isinstance(target, Pose):
        return target[None]
    found = reach(tool, target, seed=seed, near=near)
    if not len(found.positions):
        raise unreachable_error(tool, target, found)
    free = found.positions[kept_by(found.positions, cell)]
    if not len(free):
        assert cell is not None
        raise touching_error(target.name, found.positions, cell)
    return free


def touching_error(name: str, positions: np.ndarray, cell: Cell) -> Infeasible:
    """The error of a pose that every position (K, n) reaches in contact; it names the contact that is least deep."""
    found = [contact for q in positions if (contact := cell.touching(q)) is not None]
    return contact_error(
        f"{name}: every joint position that reaches it touches something", min(found, key=lambda at: at.depth), cell
    )


def contact_error(text: str, contact: Contact, cell: Cell) -> Infeasible:
    """The error of a pose that cannot be reached without contact, with advice."""
    tool = "" if cell.request.tool else "; it is a pose of the last joint's frame, unless --tool names the tool's"
    return Infeasible(f"{text}; {contact}; {contact.remedy}{tool}", limit="clearance")


def left_out(
    tool: ToolKinematics, goals: Sequence[Target], cell: Cell | None, near: np.ndarray, seed: int
) -> tuple[tuple[Target, ...], tuple[str, ...]]:
    """The goals of which any positions are found, see `positions_of`, and what is said of the others.

    Raises:
        Infeasible: none is left.
    """
    kept: list[Target] = []
    errors: dict[int, Infeasible] = {}
    for k, goal in enumerate(goals, start=1):
        try:
            positions_of(tool, goal, cell, near=near, seed=seed)
            kept.append(goal)
        except Infeasible as error:
            errors[k] = error
    if goals and not kept:
        raise errors[1]
    return tuple(kept), tuple(f"goal {k} of {len(goals)} is left out: {error}" for k, error in errors.items())


def positions_near(tool: ToolKinematics, pose: Pose, starts: np.ndarray) -> np.ndarray:
    """Positions (K, n) that reach a pose, each from one of the starts (M, n), in their order.

    Raises:
        Infeasible: none is reached, even from further starts.
    """
    q, error = solve(tool, pose, starts)
    if (error < SMALL).any():
        return q[error < SMALL]
    found = reach(tool, pose, near=starts[0], starts=FURTHER)
    if not len(found.positions):
        raise unreachable_error(tool, pose, found)
    return found.positions


def straight_is_free(cell: Cell | None, start: np.ndarray, goal: np.ndarray) -> bool:
    """True if nothing touches at LOOKS places of a straight line.

    Args:
        cell: None: nothing is checked. start, goal: (n,) [rad, m].
    """
    return all(is_free(cell, start + x * (goal - start)) for x in np.linspace(0, 1, LOOKS + 2)[1:-1])


def thinned(q: np.ndarray, cost: np.ndarray, most: int = MOST) -> np.ndarray:
    """Some of given positions, far from each other; the cheapest first.

    Args:
        q: (K, n) [rad, m]. cost: (K,). most: how many remain.
    """
    if len(q) <= most:
        return q
    kept = [int(np.argmin(cost))]
    distance = np.abs(q - q[kept[0]]).sum(axis=1)
    while len(kept) < most:
        kept.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.abs(q - q[kept[-1]]).sum(axis=1))
    return q[kept]


def layer(scorers: Sequence[Scorer], positions: np.ndarray, turning: bool | np.ndarray = False) -> Layer:
    """A layer without a wait, with the power of standing at its positions (K, n)."""
    return Layer(positions, 0.0, holding(scorers, positions), turning)


class Ring:
    """Layers in a ring, and the likely costs of the moves between neighbours.

    Args:
        tool: its joints turn. layers: L of them; move k goes from layer k to layer k + 1, the last back to the first.
        scorers: of the models, for each move; if one less is given, there is no last move back, and it costs nothing.
        bounds: shortest and longest duration [s] of each move.
    """

    def __init__(
        self,
        tool: ToolKinematics,
        layers: Sequence[Layer],
        scorers: Sequence[Sequence[Scorer]],
        bounds: Sequence[tuple[float, float]],
    ) -> None:
        self.layers, self.bounds = list(layers), list(bounds)
        self._curves: list[Curves | None] = [None] * len(layers)
        self._pairs: list[tuple[np.ndarray, np.ndarray]] = []  # (A, B, n) ends of each move
        for k, models in enumerate(scorers):
            here, there = self.layers[k], self.layers[(k + 1) % len(layers)]
            shape = len(here.positions), len(there.positions), -1
            i, j = np.indices(shape[:2]).reshape(2, -1)
            may = [np.broadcast_to(at.turning, len(at.positions))[pick] for at, pick in ((here, i), (there, j))]
            ends = nearest_pairs(tool, here.positions[i], there.positions[j], *may)
            self._curves[k] = curves(models, *ends)
            self._pairs.append((ends[0].reshape(shape), ends[1].reshape(shape)))
        self._looked: set[tuple[int, int, int]] = set()  # moves that were checked for contact
        sizes = [len(layer.positions) for layer in layers]
        self._known = [np.zeros((a, b)) for a, b in zip(sizes, [*sizes[1:], sizes[0]], strict=True)]  # [J]
        self._touching = [np.zeros(at.shape) for at in self._known]  # 1 for a move in contact
        self._detour = DETOUR

    def cheapest(
        self,
        time: float,
        waiting: float,
        free: Callable[[int, np.ndarray, np.ndarray], bool] | None = None,
        detour: float = DETOUR,
    ) -> tuple[list[int], float]:
        """The position of every layer in the cheapest ring of `time` s without waits, and its estimate [J].

        Args:
            waiting: power [W] during remaining time: the price of a second is at most this.
            free: whether straight move k between two positions (n,) touches nothing.
            detour: cost of a move in contact, as a share of its own; with BLOCKED such moves come last.
        """
        self._detour = detour
        for _ in range(AVOIDED):
            chosen, energy, price = self._priced(time, waiting)
            if free is None or not self._price_contacts(chosen, price, free):
                break
        return chosen, energy

    def avoid(self, chosen: Sequence[int]) -> None:
        """Make every move of a ring costly, so that others come first."""
        for k, known in enumerate(self._known):
            known[chosen[k], chosen[(k + 1) % len(chosen)]] += KNOWN

    def _price_contacts(
        self, chosen: list[int], price: float, free: Callable[[int, np.ndarray, np.ndarray], bool]
    ) -> bool:
        """Make moves in contact costly until the cheapest ring at a price has none; True if any was found."""
        any_found, count = False, len(self.layers)
        for _ in range(AVOIDED):
            pairs = [(k, chosen[k], chosen[(k + 1) % count]) for k in range(count) if self._curves[k] is not None]
            ends = ((self._pairs[k][0][i, j], self._pairs[k][1][i, j]) for k, i, j in pairs)
            found = [pair for pair, (a, b) in zip(pairs, ends, strict=True)
                     if pair not in self._looked and not self._looked.add(pair) and not free(pair[0], a, b)]  # type: ignore[func-returns-value]  # fmt: skip
            if not found:
                break
            any_found = True
            for k, i, j in found:
                self._touching[k][i, j] = 1.0
            chosen = self._ring_at_price(price)[0]
        return any_found

    def _priced(self, time: float, waiting: float) -> tuple[list[int], float, float]:
        """The cheapest ring of `time` s, its estimate [J], and the price [W] of a second at which it was found."""
        low, high, best = None, waiting, self._ring_at_price(waiting)
        step = 1.0 + abs(waiting)
        for _ in range(PRICES):
            if best[2] <= time and low is None and high == waiting:
                break  # time remains
            price = high - step if low is None else (low + high) / 2
            found = self._ring_at_price(price)
            if found[2] > time:
                high, step = price, 2 * step
            else:
                low, best = price, found
            if low is not None and high - low < 1e-3 * (1 + abs(high)):
                break
            if step > HIGHEST:
                return found[0], found[1], price
        chosen, energy, used = best
        return chosen, energy + waiting * max(time - used, 0.0), high if low is None else low

    def _ring_at_price(self, price: float) -> tuple[list[int], float, float]:
        """Choice, energy [J] and duration [s] of the ring of least cost at a price of time [W]."""
        costs, times = [], []
        for k, (of, (least, most)) in enumerate(zip(self._curves, self.bounds, strict=True)):
            a, b = self.layers[k], self.layers[(k + 1) % len(self.layers)]
            shape = len(a.positions), len(b.positions)
            if of is None:
                costs.append(np.zeros(shape))
                times.append(np.zeros(shape))
                continue
            cost, time = of.cheapest(price, most, least)
            too_slow = of.shortest > most
            cost = np.where(too_slow, TOO_SLOW * (1 + abs(price)), cost)  # above all others at any price of time
            cost = cost.reshape(shape)
            detour = self._detour * self._touching[k] * np.abs(cost)
            costs.append(cost + b.wait * b.standing + detour + self._known[k])
            times.append(np.where(too_slow, 0.0, time).reshape(shape))
        # the ring is cut at its smallest layer: one shortest path from each of its positions back to itself
        count = len(self.layers)
        cut = int(np.argmin([len(layer.positions) for layer in self.layers]))
        order = [(cut + k) % count for k in range(count)]
        best, chosen = np.inf, [0] * count
        for first in range(len(self.layers[cut].positions)):
            total, back = costs[order[0]][first], []
            for k in order[1:]:
                whole = total[:, None] + costs[k]
                back.append(np.argmin(whole, axis=0))
                total = whole[back[-1], np.arange(whole.shape[1])]
            if total[first] < best:
                best, at = total[first], first
                chosen[cut] = first
                for k, step in zip(order[:0:-1], back[::-1], strict=True):
                    at = int(step[at])
                    chosen[k] = at
        used = sum(float(t[chosen[k], chosen[(k + 1) % count]]) for k, t in enumerate(times))
        return chosen, best + price * used, used
