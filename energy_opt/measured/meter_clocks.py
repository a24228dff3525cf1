"""The clocks of all meters of a set.

A short run does not show its meter's clock: the power of one motion looks like that of another. So runs decide
together.

    dated    meters and joints with dates have two clocks in the whole set: one offset is fitted to all of these runs
    alone    another meter's offset is that with the best fit to its own run, if no other one fits about as well
    common   where that is open, the meter has the offset of the other runs if these agree on one and it fits
    by law   where that is open, too, power follows the motion by the law of the runs whose clocks are known, or by one
             that short runs show together
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.measured.clock import DELAYS, Clock, delays_of, evidence
from energy_opt.measured.meter_fits import (
    LAW_FEWEST,
    STEP,
    Meter,
    Score,
    by_fit,
    by_law,
    fitted,
    inside,
    law_through,
    refined,
)

LEAST = 0.25  # [s] a smaller offset is attributed to the meter's own delay, which the fit determines
SURE = 15.0  # gain of log likelihood from which a moved clock replaces the given one
MARGIN = 4.0  # log likelihood by which an offset must be ahead of all others
SAME = 1.0  # [s] offsets that differ by less are not told apart
GOOD = 0.3  # least share of the readings' variance that the motion must explain
FOLLOWS = 0.85  # the same, if the law of other runs must explain it
NEARBY = 3.0  # [s] largest offset of dated clocks, unless none explains even the share GOOD
CLEAR = 0.7  # share of the readings' variance that a law of several runs must explain
FEWER = 2000  # most offsets that are tried for many runs together
SHORT, TURNS = 3, 8  # least short runs that show a law together; most turns


@dataclass(frozen=True)
class Found:
    """What is known of a meter's clock.

    Attributes:
        clock: None for the given one. window: which of the windows fits better.
        shown: the motion shows the clock. common: it is that of other runs.
        by_law: it is that under which power follows the law of other runs. lost: other runs' meters have other clocks
            than the joints, and this one's is not known.
        scores: (windows, DELAYS) log likelihoods, see `clock.shows_means`.
    """

    clock: Clock | None
    window: int
    shown: bool
    scores: np.ndarray
    common: bool = False
    by_law: bool = False
    lost: bool = False

    def remark(self, file: str, stamps: np.ndarray, own: np.ndarray, together: bool) -> str:
        """What a report says of the clock; empty where it is that of the joints.

        Args:
            file: of the joints. stamps, own: (M,) [s] of the readings, on the run's clock as given, and from the
                meter's time 0. together: the clocks are of different kinds, so both are taken to begin together.
        """
        if self.clock is None:
            taken = (
                "its first reading is taken to be at the first row of the joints"
                if together
                else ("its stamps are taken to be on the joints' clock")
            )
            taken = f"the motion does not show the meter's clock: {taken}"
            if self.lost:
                taken = "the motion does not show the meter's clock, which differs from the joints' in other runs: its "
                return f"{taken}readings are left out; state power_start in log.toml to use them"
            return "" if self.shown else f"{taken}; if they are not, state power_start in log.toml"
        if self.common:
            return f"its clock is moved by {self.clock.offset:.3f} s, as in other runs (power_start overrides this)"
        first = float(self.clock.moved(stamps[:1])[0])
        drift = f", drifting by {1e6 * self.clock.drift:.0f} ppm" if self.clock.drift else ""
        return (
            f"the meter's clock was found by correlation with the motion: its first reading is at {first:.3f} s of "
            f"{file}, power_start = {first - own[0]:.3f}{drift} (the motion explains "
            f"{100 * self.clock.explained:.0f} % of the readings' variance; power_start in log.toml overrides this)"
        )


def clocks_of(meters: Sequence[Meter]) -> list[Found]:
    """What is known of the clock of every meter."""
    meters = [meter.thinned() for meter in meters]
    dated = [k for k, meter in enumerate(meters) if meter.dated]
    found = dict(zip(dated, _dated([meters[k] for k in dated]), strict=True))
    found |= {k: _alone(meter) for k, meter in enumerate(meters) if k not in found}
    ordered = _with_common_offset(meters, [found[k] for k in range(len(meters))])
    for _ in range(2):  # the runs that the law places make it more accurate
        known = [(meter, one) for meter, one in zip(meters, ordered, strict=True) if one.shown]
        law = _law_of(known)
        if law is None:
            law = _law_of_short([m for m, one in zip(meters, ordered, strict=True) if not (one.shown or m.dated)])
        if law is None:
            break
        moved = [one.clock is not None for meter, one in known if not meter.dated]
        other = sum(moved) > len(moved) / 2  # the meters' clocks are not those of the joints
        for k, (meter, one) in enumerate(zip(meters, ordered, strict=True)):
            if not (meter.dated or (one.shown and not one.by_law)):
                meter = replace(meter, given=meter.given and not other)
                otherwise = Found(None, 0, False, _scores(meter, None), lost=other)
                scores = [by_law(meter, which, law) for which in meter.kinds]
                ordered[k] = replace(_best(meter, scores, otherwise, FOLLOWS), by_law=True)
    return ordered


def _dated(meters: Sequence[Meter]) -> list[Found]:
    """One offset for all meters with dates."""
    if len(meters) < 2:
        return [_alone(meter) for meter in meters]

    def score(offset: float, which: int) -> tuple[float, float]:
        parts = [inside(meter, meter.kinds[min(which, len(meter.kinds) - 1)], offset, 0.0, 2) for meter in meters]
        return fitted([part for part in parts if part is not None])

    kinds = range(max(len(meter.windows) for meter in meters))

    def highest(tried: np.ndarray) -> tuple[float, float, float, int]:
        """Log likelihood, share explained, offset and window of the best of some offsets."""
        return max((*score(float(x), w), float(x), w) for w in kinds for x in tried)

    best = highest(np.arange(-NEARBY, NEARBY + STEP / 2, STEP))
    if best[1] < GOOD and (farther := highest(_common_offsets(meters)))[1] >= CLEAR:
        best = farther
    given = max(score(0.0, w)[0] for w in kinds)
    clock = refined(lambda x, drift: score(x, best[3]) if drift == 0 else (-np.inf, 0.0), best[2], 0.0, 0.0)
    loose = any(meter.loose for meter in meters)
    least, sure = (0.0, MARGIN) if loose else (LEAST, SURE)
    moved = clock if abs(clock.offset) >= least and best[0] - given >= sure else None
    shown = moved is not None or clock.explained >= GOOD
    return [Found(moved, min(best[3], len(m.windows) - 1), shown, _scores(m, moved)) for m in meters]


def _common_offsets(meters: Sequence[Meter]) -> np.ndarray:
    """Offsets (K,) [s] at which the readings of most meters overlap with their motions by half."""
    own = [meter.offsets() for meter in meters]
    first, last = (float(np.median([end(x) for x in own if len(x)] or [0.0])) for end in (np.min, np.max))
    return np.arange(first, last + STEP, max(STEP, (last - first) / FEWER))


def _alone(meter: Meter) -> Found:
    """The offset of a meter by its own run."""
    return _best(meter, [by_fit(meter, w) for w in meter.kinds], Found(None, 0, False, _scores(meter, None)))


def _best(meter: Meter, scores: Sequence[Score], otherwise: Found, least: float = GOOD) -> Found:
    """The clock of the best fit, by one score for each of the meter's windows, if it is ahead of all others.

    A clock that the stamps claim to be on is left only for a much better fit, but for what the stamps leave open.

    Args:
        otherwise: what is known if it is not ahead. least: share of the readings' variance that must be explained.
    """
    offsets = meter.offsets()
    rated = np.array([[score(float(x), 0.0)[0] for x in offsets] for score in scores])
    if not np.isfinite(rated).any():
        return otherwise
    which, at = (int(k) for k in np.unravel_index(int(np.argmax(rated)), rated.shape))
    best, most = float(offsets[at]), float(rated[which, at])
    if meter.given:
        most_off = max(LEAST, meter.loose)
        tried = [
            (*score(float(x), 0.0), x, w)
            for x in np.linspace(-most_off, most_off, 11)
            for w, score in enumerate(scores)
        ]
        near, explained, at, w = max(tried)
        if most - near < SURE:
            if meter.loose and explained >= least and near - max(score(0.0, 0.0)[0] for score in scores) >= MARGIN:
                phase = refined(scores[w], at, 0.0, meter.middle)
                return Found(phase, w, True, _scores(meter, phase))
            return replace(otherwise, shown=explained >= least and most - near < MARGIN)
    clock = refined(scores[which], best, meter.span, meter.middle)
    if clock.explained < least or most - rated[:, np.abs(offsets - best) > SAME].max(initial=-np.inf) < MARGIN:
        return otherwise
    far = abs(clock.offset) + abs(clock.drift) * meter.span / 2 >= LEAST or not meter.given
    moved = clock if far else None
    return Found(moved, which, True, _scores(meter, moved))


def _with_common_offset(meters: Sequence[Meter], found: Sequence[Found]) -> list[Found]:
    """Meters whose clock is open have the offset of the others if these agree on one and it fits no worse."""
    offsets = [one.clock.offset for m, one in zip(meters, found, strict=True) if one.clock is not None and not m.dated]
    if len(offsets) < 2 or np.ptp(offsets) >= LEAST:
        return list(found)
    offset, out = float(np.median(offsets)), []
    for meter, one in zip(meters, found, strict=True):
        stamps, t = meter.moved(offset), meter.motion.t
        if not (one.shown or meter.dated) and min(t[-1], stamps[-1]) > max(t[0], stamps[0]):
            window = meter.windows[one.window]
            moved, given = (evidence(meter.motion, meter.stamps + x, window, meter.power)[0] for x in (offset, 0.0))
            if moved >= given:
                one = replace(one, clock=Clock(offset, 0.0, meter.middle, 0.0), shown=True, common=True)
        out.append(one)
    return out


def _law_of(pairs: Sequence[tuple[Meter, Found]]) -> np.ndarray | None:
    """The law (1 + F,) of runs whose clocks are known; None if it is not clear."""
    parts = []
    for meter, one in pairs:
        offset, drift = (0.0, 0.0) if one.clock is None else (one.clock.offset, one.clock.drift)
        part = inside(meter, one.window, offset, drift, 2)
        parts += [] if part is None else [part]
    return law_through(parts) if parts and fitted(parts)[1] >= CLEAR else None


def _law_of_short(meters: Sequence[Meter]) -> np.ndarray | None:
    """The law (1 + F,) of runs that are too short to show their meters' clocks; None if it is not clear.

    Offsets and law are chosen in turns, from the given clocks and from each run's own best fit.
    """
    if len(meters) < SHORT:
        return None
    best: tuple[float, np.ndarray] | None = None
    offsets = [meter.offsets() for meter in meters]
    for at in ([0.0] * len(meters), [_highest(by_fit(m, 0), x) for m, x in zip(meters, offsets, strict=True)]):
        kept = np.ones(len(meters), dtype=bool)
        for _ in range(TURNS):
            parts = [inside(m, 0, x, 0.0, LAW_FEWEST) for m, x, keep in zip(meters, at, kept, strict=True) if keep]
            if not any(parts):
                break
            law = law_through([part for part in parts if part is not None])
            scores = [by_law(meter, 0, law) for meter in meters]
            before, at = at, [_highest(score, x) for score, x in zip(scores, offsets, strict=True)]
            rated = np.array([score(x, 0.0) for score, x in zip(scores, at, strict=True)])
            kept = rated[:, 1] >= np.median(rated[:, 1])
            if at == before and best is not None and rated[:, 0].sum() <= best[0]:
                break
            if np.mean(rated[:, 1] >= CLEAR) > 0.5 and (best is None or rated[:, 0].sum() > best[0]):
                best = float(rated[:, 0].sum()), law
    return None if best is None else best[1]


def _highest(score: Score, offsets: np.ndarray) -> float:
    """The offset [s] of the highest score; 0 if there is none."""
    return float(offsets[int(np.argmax([score(float(x), 0.0)[0] for x in offsets]))]) if len(offsets) else 0.0


def _scores(meter: Meter, clock: Clock | None) -> np.ndarray:
    """Log likelihoods (windows, DELAYS) for `clock.shows_means`; a clock that was found has no further delay."""
    if clock is not None:
        stamps = meter.moved(clock.offset, clock.drift)
        alone = [[evidence(meter.motion, stamps, window, meter.power)[0]] for window in meter.windows]
        return np.tile(np.array(alone), (1, len(DELAYS)))
    return delays_of(meter.motion, meter.stamps, meter.windows, meter.power)
