"""Sharing a cycle's time among its legs for least energy: equal slopes, by a price of time.

A leg's least energy E(T) over the timing of its path is convex in T (if the model keeps retiming convex), and remaining
time costs the power of waiting. So the best shares solve, for one price [W] of a second,

    minimise  E(T) - price T   for every leg,   sum of T = the cycle less its waits,   price <= power of waiting

(if the price reaches that power, the arm waits for the remaining time). Each solve of a leg at a price is one convex
program. By weak duality, the sum of their bounds plus price times the shared time is a bound of the job's energy.

The search ends once a bound shows that no other shares can save more than a small part of the energy. The first price
between one that is too high and one that is too low is found on a model of each leg: slowing down by a little saves
k / T^4 (losses of a motion are proportional to T^-3) and costs its holding power h, E'(T) = h - k / T^4. So T^-4 is
linear in the price, and is interpolated. Legs with dry friction hardly save by slowing: E is nearly a line, and the
model fails. Then the next price is the slope of the line between the energies at both prices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

ROUNDS = 9  # most prices to try; three are usual
SLOW = 5.0  # times the shortest duration: longer durations are not used to fit k
INSIDE = 0.02  # share of the distance between two prices that a new price keeps from both
ENOUGH = 1e-5  # share of the energy: ends once no other shares can save more
NEAR = 1e-3  # relative: durations whose sum is this close to the shared time are scaled to it
# [W] least distance of a price from a leg's holding power: nearer to it the leg's duration would be infinite
FLAT = 1e-3
TINY = 1e-12  # [W] least such distance where the durations are bounded anyway


@dataclass(frozen=True)
class Solved:
    """A leg's solution at a price: duration [s], energy [J], and a proven bound of E - price T [J] if any."""

    duration: float
    energy: float
    bound: float | None


@dataclass
class Front:
    """The data of a leg: its shortest and longest duration [s], holding power [W], and its solver at a price."""

    shortest: float
    longest: float
    holding: float
    at_price: Callable[[float], Solved]


@dataclass(frozen=True)
class Shares:
    """The shares of the time.

    Attributes:
        durations: (L,) s of the legs; left: s to wait.
        bound: J, a lower bound of the energy of the legs and that wait; None if not proven.
        saved, holding: (L,) k [J s^3] and h [W] of the legs' models; energies: (L,) J, of the nearest solves.
    """

    durations: np.ndarray
    left: float
    bound: float | None
    saved: np.ndarray
    holding: np.ndarray
    energies: np.ndarray


@dataclass(frozen=True)
class _Seen:
    """The solution at a price [W]: durations (L,) [s] and energies (L,) [J]."""

    price: float
    durations: np.ndarray
    energies: np.ndarray

    @property
    def total(self) -> float:
        """Sum of the durations [s]."""
        return float(self.durations.sum())


def allocate(fronts: Sequence[Front], time: float, waiting: float, guess: float | None = None) -> Shares:
    """Share `time` s among the legs and a wait of `waiting` W; the legs' shortest durations must fit into it.

    Args:
        guess: a first price [W] that may be near.
    """
    if not fronts:
        none = np.zeros(0)
        return Shares(none, time, waiting * time, none, none, none)
    low, high = (np.array([getattr(front, name) for front in fronts]) for name in ("shortest", "longest"))
    holding = np.maximum([front.holding for front in fronts], waiting + FLAT)
    price, bound = waiting if guess is None else min(guess, waiting), -np.inf
    seen: list[_Seen] = []
    for _ in range(ROUNDS):
        solved = [front.at_price(price) for front in fronts]
        durations = np.clip([s.duration for s in solved], low, high)
        seen.append(_Seen(price, durations, np.array([s.energy for s in solved])))
        bounds = [s.bound for s in solved if s.bound is not None]
        if len(bounds) == len(solved):  # the wait contributes at least zero, because the price is at most its power
            bound = max(bound, sum(bounds) + price * time)
        total = durations.sum()
        if (price == waiting and total <= time) or abs(total / time - 1) < NEAR:
            break
        mixed = _mixed(seen, time)
        if mixed is not None:  # by duality, every price gives a bound of the least energy
            least = max(s.energies.sum() + s.price * (time - s.total) for s in seen)
            if mixed.energies.sum() - least < ENOUGH * abs(mixed.energies.sum()):
                break
        price = _next(seen, holding, low, high, time, waiting)
    best = min(seen, key=lambda s: abs(s.total / time - 1))
    best = best if abs(best.total / time - 1) < NEAR else _mixed(seen, time) or best
    ended = next((s for s in seen if s.price == waiting and s.total <= time), None)
    best = ended or best
    left = time - best.total if ended is not None else 0.0
    durations = best.durations if left else _scaled(best.durations, low, high, time)
    saved, holding = _fitted(seen, best, holding)
    return Shares(durations, left, None if np.isinf(bound) else bound, saved, holding, best.energies)


def _nearest(seen: Sequence[_Seen], time: float) -> tuple[_Seen | None, _Seen | None]:
    """The solutions of the highest price that leaves time, and of the lowest that takes all of it; None if unknown."""
    short = max((s for s in seen if s.total < time), key=lambda s: s.price, default=None)
    return short, min((s for s in seen if s.total >= time), key=lambda s: s.price, default=None)


def _mixed(seen: Sequence[_Seen], time: float) -> _Seen | None:
    """Durations between those of both prices whose sum is `time`; as E is convex, energies are at most these."""
    short, long = _nearest(seen, time)
    if short is None or long is None:
        return None
    share = (time - short.total) / (long.total - short.total)
    durations = short.durations + share * (long.durations - short.durations)
    energies = short.energies + share * (long.energies - short.energies)
    return _Seen((long.energies.sum() - short.energies.sum()) / (long.total - short.total), durations, energies)


def _next(
    seen: Sequence[_Seen], holding: np.ndarray, low: np.ndarray, high: np.ndarray, time: float, waiting: float
) -> float:
    """The next price to try."""
    short, long = _nearest(seen, time)
    if short is None or long is None:
        only = short or long
        assert only is not None
        # durations of legs that would rather stand still do not determine k
        durations = np.minimum(only.durations, SLOW * low)
        k = np.maximum(holding - only.price, FLAT) * durations**4
        price = _price(k, holding, low, high, time, waiting)
        if short is not None:
            return waiting if price >= waiting - FLAT else max(price, (only.price + waiting) / 2)
        return min(price, only.price - FLAT)
    mixed = _mixed(seen, time)
    # the model has been tried between two prices: the price at which both cost the same
    if mixed is not None and _mixed(seen[:-1], time) is not None:
        return float(np.clip(mixed.price, min(short.price, long.price), max(short.price, long.price)))
    a, b = short.durations**-4.0, long.durations**-4.0
    share = brentq(lambda x: float((((1 - x) * a + x * b) ** -0.25).sum()) - time, 0.0, 1.0)
    return short.price + float(np.clip(share, INSIDE, 1 - INSIDE)) * (long.price - short.price)


def _fitted(seen: Sequence[_Seen], best: _Seen, holding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k [J s^3] and h [W] (L,) of the legs: fitted to the best price and the next if possible, else from `holding`."""
    k, h = (holding - best.price) * best.durations**4, holding.copy()
    others = [s for s in seen if s is not best]
    if others:
        other = min(others, key=lambda s: abs(s.total / best.total - 1))
        change = other.durations**-4.0 - best.durations**-4.0
        tells = np.abs(np.log(other.durations / best.durations)) > NEAR
        tells &= (best.price - other.price) * change > 0
        k = np.where(tells, (best.price - other.price) / np.where(tells, change, 1.0), k)
        h = np.where(tells, best.price + k * best.durations**-4.0, h)
    return np.maximum(k, 0.0), h


def modelled(
    fronts: Sequence[Front], saved: np.ndarray, holding: np.ndarray, time: float, waiting: float
) -> np.ndarray:
    """Durations (L,) [s] by the legs' models alone.

    Args:
        fronts: of the legs, for their shortest and longest durations.
        saved: (L,) k [J s^3]. holding: (L,) h [W]. time: [s] of all legs together. waiting: [W] during time left over.
    """
    low, high = (np.array([getattr(front, name) for front in fronts]) for name in ("shortest", "longest"))
    durations = _durations(saved, holding, low, high, waiting)
    if durations.sum() <= time:
        return durations
    price = _price(saved, holding, low, high, time, waiting)
    return _scaled(_durations(saved, holding, low, high, price), low, high, time)


def _durations(k: np.ndarray, holding: np.ndarray, low: np.ndarray, high: np.ndarray, price: float) -> np.ndarray:
    """Durations (L,) [s] at which h - k / T^4 is the price [W] of a second, within the legs' bounds."""
    return np.clip((k / np.maximum(holding - price, TINY)) ** 0.25, low, high)


def _price(k: np.ndarray, holding: np.ndarray, low: np.ndarray, high: np.ndarray, time: float, waiting: float) -> float:
    """The price at which the sum of the model's durations is `time`, by bisection."""
    below, above = waiting - 1.0, waiting
    while _durations(k, holding, low, high, below).sum() > time and waiting - below < 1e12:
        below = waiting - 4 * (waiting - below)
    for _ in range(80):
        middle = (below + above) / 2
        if _durations(k, holding, low, high, middle).sum() > time:
            above = middle
        else:
            below = middle
    return below


def _scaled(durations: np.ndarray, low: np.ndarray, high: np.ndarray, time: float) -> np.ndarray:
    """The durations moved slightly, within their bounds, so that their sum is `time`."""
    out = durations
    for _ in range(50):
        missing = time - out.sum()
        free = (out < high) if missing > 0 else (out > low)
        if abs(missing) <= 1e-13 * time or not free.any():
            break
        out = np.clip(out + missing * np.where(free, out, 0) / out[free].sum(), low, high)
    return out
