"""How well a meter's readings fit a motion under a clock.

Power is a constant plus features of the motion, each with a coefficient of at least 0. Its log likelihood is relative
to that of a constant power. With M independent readings, F features and the share r of the readings' variance that is
left, it is -(M - 1 - F) / 2 log((r + MODEL) / (1 + MODEL)) - F. The features describe an arm roughly, so shares below
MODEL mean nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.measured.clock import APART, Activity, Clock, independent, thinned

MODEL = 0.02  # share of the readings' variance that the features leave unexplained even with the right clock
LAW_FEWEST = 4  # least independent readings to which a law is compared
DRIFT = 2e-3  # [s/s] largest drift of a clock
STEP, OFFSETS = 0.1, 6000  # [s] least step between offsets that are tried, and their largest number

# from an offset [s] and a drift [s/s] to the log likelihood and the share of the readings' variance explained
Score = Callable[[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Meter:
    """A meter's readings with its own stamps.

    Attributes:
        motion: of the run. stamps, power: (M,) [s], [W]. windows: one or two (M,) [s] that readings may average.
        given: the stamps claim to be on the joints' clock, but for `loose` [s]. dated: both clocks count from 1970.
    """

    motion: Activity
    stamps: np.ndarray
    power: np.ndarray
    windows: tuple[np.ndarray, ...]
    given: bool
    dated: bool
    loose: float = 0.0

    @property
    def span(self) -> float:
        """Time from the first to the last reading, s."""
        return float(self.stamps[-1] - self.stamps[0])

    @property
    def middle(self) -> float:
        """Stamp halfway, s."""
        return float(self.stamps[0] + self.stamps[-1]) / 2

    @property
    def kinds(self) -> range:
        """Numbers of the windows."""
        return range(len(self.windows))

    def thinned(self) -> Meter:
        """The meter with fewer readings."""
        stamps, power, *windows = thinned(self.stamps, self.power, *self.windows)
        return replace(self, stamps=stamps, power=power, windows=tuple(windows))

    def moved(self, offset: float, drift: float = 0.0) -> np.ndarray:
        """The stamps (M,) [s] on the joints' clock."""
        return self.stamps + offset + drift * (self.stamps - self.middle)

    def offsets(self) -> np.ndarray:
        """Offsets (K,) [s] at which readings and motion overlap by half of the shorter one."""
        t, step = self.motion.t, STEP
        share = 0.5 * min(float(t[-1] - t[0]), self.span)
        first, last = t[0] + share - self.stamps[-1], t[-1] - share - self.stamps[0]
        step = max(step, float(np.median(self.windows[0])) / 8, (last - first) / OFFSETS)
        out = np.arange(first, last + step, step)
        return np.append(out[np.abs(out) > step / 2], 0.0) if self.given else out


@dataclass(frozen=True)
class Part:
    """Readings within a motion: features (M, F), power (M,) [W], and how many count as independent."""

    features: np.ndarray
    power: np.ndarray
    count: float


def inside(meter: Meter, which: int, offset: float, drift: float, fewest: int) -> Part | None:
    """The readings within the motion; None if they are fewer than `fewest` independent ones."""
    stamps, window = meter.moved(offset, drift), meter.windows[which]
    there = meter.motion.knows(stamps, window)
    count = independent(stamps[there])
    if count < fewest:
        return None
    return Part(meter.motion.at(stamps[there], window[there]), meter.power[there], count)


def fitted(parts: Sequence[Part]) -> tuple[float, float]:
    """Log likelihood of a law that all parts share, relative to that of a constant power; and the share explained."""
    count = sum(part.count for part in parts)
    if not parts or count <= 1 + parts[0].features.shape[1]:
        return -np.inf, 0.0
    power = np.concatenate([part.power for part in parts])
    total = float(np.sum((power - power.mean()) ** 2))
    if total <= 0:
        return -np.inf, 0.0
    law = law_through(parts)
    left = power - law[0] - np.concatenate([part.features for part in parts]) @ law[1:]
    ratio = float(left @ left) / total
    free = len(law)
    return -(count - free) / 2 * float(np.log((ratio + MODEL) / (1 + MODEL))) - free + 1, 1 - ratio


def law_through(parts: Sequence[Part]) -> np.ndarray:
    """Coefficients (1 + F,) of 1 and the features by least squares; those of the features are at least 0.

    The features are parts of a power that an arm draws: with coefficients of both signs, the power of one motion would
    fit to many others.
    """
    from scipy.optimize import nnls

    x, y = np.concatenate([part.features for part in parts]), np.concatenate([part.power for part in parts])
    mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    z = (x - mean) / scale
    q, r = np.linalg.qr(z)
    own = nnls(r, q.T @ (y - y.mean()))[0] / scale
    return np.append(y.mean() - mean @ own, own)


def by_fit(meter: Meter, which: int) -> Score:
    """How well a law of its own gives a meter's readings."""

    def score(offset: float, drift: float) -> tuple[float, float]:
        part = inside(meter, which, offset, drift, LAW_FEWEST)
        return (-np.inf, 0.0) if part is None else fitted([part])

    return score


def by_law(meter: Meter, which: int, law: np.ndarray) -> Score:
    """How well the law of other runs, (1 + F,) coefficients of 1 and the features, gives a meter's readings."""

    follows = replace(meter, motion=replace(meter.motion, integrals=meter.motion.integrals @ law[1:, None]))

    def score(offset: float, drift: float) -> tuple[float, float]:
        part = inside(follows, which, offset, drift, LAW_FEWEST)
        if part is None:
            return -np.inf, 0.0
        left = part.power - law[0] - part.features[:, 0]
        ratio = float(left @ left) / max(float(np.sum((part.power - part.power.mean()) ** 2)), 1e-9)
        return -part.count / 2 * float(np.log((ratio + MODEL) / (1 + MODEL))), 1 - ratio

    return score


def refined(score: Score, best: float, span: float, middle: float) -> Clock:
    """The clock of the best fit near an offset [s].

    The drift is kept if it improves the log likelihood by more than 5 + log(span / APART) / 2 (the Bayesian information
    criterion with a margin).
    """
    from scipy.optimize import minimize

    half = max(span / 2, 1e-9)

    def loss(x: np.ndarray) -> float:
        """Less the log likelihood of an offset [s], and of the drift over half of the readings [s], if there is one."""
        offset, drift = (*x, 0.0)[:2]
        value = -np.inf if abs(drift) > DRIFT * half else score(offset, drift / half)[0]
        return -value if np.isfinite(value) else 1e9

    both = np.array([[best, 0.0], [best + STEP, 0.0], [best, min(0.05, DRIFT * half / 2)]])
    starts = (both, both[:2, :1]) if span > 0 else (both[:2, :1],)  # offset and drift, and the offset alone
    found = [minimize(loss, x[0], method="Nelder-Mead", options={"initial_simplex": x, "xatol": 1e-4}) for x in starts]
    drifts = found[-1].fun - found[0].fun > 5.0 + 0.5 * np.log(max(span / APART, 1.0))
    offset, drift = (*found[0 if drifts else -1].x.tolist(), 0.0)[:2]
    clock = Clock(offset, drift / half, middle, 0.0)
    return replace(clock, explained=score(clock.offset, clock.drift)[1])
