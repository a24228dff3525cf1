"""Stamps of a recorder: their unit, and their cleaning. Repeats, missing samples and gaps are found and counted.

A controller takes samples on an even clock; a recorder may write them with irregular stamps, also if samples are
missing. The samples k have stamps t_k = begin + step (k + s_k) + e_k, with s_k samples missing before them and errors
e_k of the recorder. The step is first the strongest period of the stamps. The numbers s_k are integers that do not
decrease: isotonic regression, rounded, has the least squares e_k. Then step and begin follow from a straight line, and
so on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

COARSE = 0.3  # share of samples with a repeated stamp above which stamps are coarser than the samples
GAP = 0.25  # [s] without a sample (or `GAP_STEPS` steps, if longer) from which the motion in between is unknown
GAP_STEPS = 10
BUNCHED = 5.0  # mean step over median step above which samples arrive in bunches
SKIPPED = 1.6  # usual steps between two samples from which one is missing
EPOCH = 1e8  # [s] larger stamps count from 1970, on the same clock in every file


@dataclass(frozen=True)
class Stamped:
    """Indices of the kept samples (K,), their stamps (K,) [s], and the kept samples that a gap follows."""

    kept: np.ndarray
    time: np.ndarray
    gaps: tuple[int, ...]
    remarks: tuple[str, ...] = field(default=())


def clean(time: np.ndarray, values: np.ndarray) -> Stamped:
    """Samples with the stamps of `restamped`, and the gaps between them.

    Args:
        time: (N,) s, not decreasing. values: (N, m) of all that is logged.
    """
    kept, stamps, remarks = restamped(time, values)
    if len(stamps) < 3:
        return Stamped(kept, stamps, (), tuple(remarks))
    step = np.diff(stamps)
    usual = float(np.median(step))
    limit = max(GAP, GAP_STEPS * usual)
    wide = step > limit
    missing = np.rint(step / usual).astype(int) - 1
    skipped = (step > SKIPPED * usual) & ~wide
    if skipped.any() and skipped.mean() < 0.1:
        remarks.append(f"{int(missing[skipped].sum())} rows missing in {int(skipped.sum())} places: bridged")
    if wide.any():
        begins = stamps[:-1][wide] - stamps[0]
        lengths = ", ".join(f"{x:.3g} s after {t:.4g} s" for x, t in zip(step[wide][:3], begins, strict=False))
        more = f" and {int(wide.sum()) - 3} more" if wide.sum() > 3 else ""
        remarks.append(f"cut at {int(wide.sum())} gap(s) without rows ({lengths}{more})")
    return Stamped(kept, stamps, tuple(int(k) for k in np.flatnonzero(wide)), tuple(remarks))


def restamped(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Indices (K,) of kept samples, their increasing stamps (K,), and remarks.

    A sample that repeats the one before it, stamp and values, is dropped. Samples that share a stamp but differ are
    spread evenly where stamps are coarser than the samples, moved into the place of a missing sample after them if
    there is one, and dropped otherwise. Stamps in bunches are spread; irregular ones become an even clock's.

    Args:
        time: (N,) s, not decreasing. values: (N, m) of all that is logged.
    """
    remarks = []
    same = np.concatenate([[False], np.diff(time) == 0])
    copies = same & np.concatenate([[False], (np.diff(values, axis=0) == 0).all(axis=1)])
    coarse = float((same & ~copies).mean()) > COARSE
    kept = np.flatnonzero(~copies)
    if copies.any() and not coarse:
        remarks.append(f"{int(copies.sum())} repeated rows dropped")
    elif copies.any():  # with coarse stamps, equal samples of an arm at rest are real
        kept = np.arange(len(time))
    stamps = time[kept].astype(float)
    same = np.concatenate([[False], np.diff(stamps) == 0])
    if same.any():
        if coarse:
            stamps = spread(stamps, same)
            remarks.append(
                f"{int(same.sum())} of {len(stamps)} rows repeat the stamp before them: kept, and spread evenly"
            )
        else:
            kept, stamps, moved = _moved_to_gaps(kept, stamps, same)
            if moved:
                remarks.append(f"{moved} rows with a repeated stamp moved to the missing stamp after them")
            if int(same.sum()) - moved:
                remarks.append(f"{int(same.sum()) - moved} rows with a repeated stamp dropped")
    regular = _spread_bunches(stamps)
    if regular is not None:
        stamps = regular
        row = 1e3 * float(np.median(np.diff(stamps)))
        remarks.append(f"stamps come in bunches: rows spread evenly, {row:.3g} ms apart, as on the controller's clock")
    even = _on_even_clock(time, values, kept, stamps)
    if even is not None:  # all samples are real
        off = 1e3 * float(np.abs(time - even).max())
        kept, stamps = np.arange(len(time)), even
        remarks = [
            f"stamps are up to {off:.2g} ms late or early: rows put on an even clock, as they run smoothly on it"
        ]
    return kept, stamps, remarks


def _spread_bunches(stamps: np.ndarray) -> np.ndarray | None:
    """Stamps of samples in bunches, spread evenly up to the last of each bunch; None if there are no bunches."""
    step = np.diff(stamps)
    near = step[step < GAP]
    if len(near) < 3 or BUNCHED * float(np.median(near)) >= float(near.mean()):
        return None
    last = np.append(np.flatnonzero(step > near.mean()), len(stamps) - 1)
    size = np.diff(last, prepend=-1)
    apart = np.diff(stamps[last], prepend=np.nan) / size
    row = float(np.nanmedian(apart))
    apart = np.where(apart < 2 * row, apart, row)  # also for the first bunch, whose start is unknown
    bunch = np.repeat(np.arange(len(last)), size)
    return np.asarray(stamps[last][bunch] - apart[bunch] * (last[bunch] - np.arange(len(stamps))))


def spread(stamps: np.ndarray, same: np.ndarray) -> np.ndarray:
    """Spread samples of one stamp evenly up to the next stamp; those of the last stamp with the usual distance."""
    group = np.cumsum(~same) - 1
    first = np.flatnonzero(~same)
    size = np.diff(np.append(first, len(stamps)))
    length = np.diff(stamps[first])
    usual = float(np.median(length)) if len(length) else 1.0
    length = np.append(np.minimum(length, 2 * usual), usual)
    apart = length / size
    if len(apart) > 2:  # the first and the last stamp may have only some of their samples
        row = float(np.median(apart[1:-1]))
        apart[0], apart[-1] = min(apart[0], row), min(apart[-1], row)
    begin = stamps[first]
    if len(begin) > 1:
        begin[0] = begin[1] - size[0] * apart[0]
    return begin[group] + (np.arange(len(stamps)) - first[group]) * apart[group]


def _moved_to_gaps(kept: np.ndarray, stamps: np.ndarray, same: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Move samples with a repeated stamp by the usual step if a sample is missing after them; drop the others."""
    step = np.diff(stamps)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    room = np.append(step, 0.0) > SKIPPED * usual
    move = same & room & ~np.append(same[1:], False)
    stamps = np.where(move, stamps + usual, stamps)
    stay = ~same | move
    return kept[stay], stamps[stay], int(move.sum())


FASTEST = 4e-4  # [s] a unit of which the step would be shorter is not believed


def stamp_factor(stamps: np.ndarray, name: str = "time", span: float | None = None) -> float:
    """Seconds per unit of stamps without a named unit: by their size if they count from 1970, else by their step.

    Recorders of arms write 5 to 2000 samples/s, so a step of 0.5 or more is not in seconds; meters write 0.1 to 100.

    Args:
        stamps: (N,) as written; not finite ones are ignored. name: "power.time" for a meter's.
        span: [s] the approximate duration, if known: it decides among the units that leave a believable step.
    """
    stamps = stamps[np.isfinite(stamps)]
    if len(stamps) < 2:
        return 1.0
    size, step = float(np.median(np.abs(stamps))), np.diff(stamps)
    step = step[step > 0]
    usual = float(np.median(step)) if step.size else 1.0
    for first, factor in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)):
        if size > first:
            return factor
    if size > EPOCH and float(stamps[-1] - stamps[0]) < 1e6 and usual < 20:
        return 1.0
    if span is not None:
        factors = (1.0, 1e-3, 1e-6, 1e-9)  # a meter may run much longer than the motion
        slow_enough = [f for f in factors if f * usual > FASTEST] or factors
        return min(slow_enough, key=lambda f: abs(np.log(f * (stamps[-1] - stamps[0]) / span)))
    slow = 20.0 if name == "power.time" else 1.0
    for first, factor in ((3.2e5, 1e-9), (320.0, 1e-6), (0.5, 1e-3)):  # between 5 samples/s in one and 2000 in the next
        if usual >= first * slow:
            return factor
    return 1.0


JITTER, FEW = 0.05, 20  # median distance of the steps from their mean, over it, of irregular stamps; least samples
WITHIN, FARTHEST = 0.99, 1.5  # share of the stamps that must be near the even clock: by at most so many of its steps
SMOOTHER = 0.5  # factor on the squares of changes of speed by which values run more smoothly with other stamps
FIRST, NEAR = 1000, 0.15  # samples from which the period is found; its largest distance from the median step, over it
TURNS = 6  # straight lines fitted to a number of samples
ASIDE = 3  # most samples by which the place of a missing one is corrected
CLEARER = 0.2  # factor on the squares of changes of speed around it by which the values must run more smoothly then


def _on_even_clock(time: np.ndarray, values: np.ndarray, kept: np.ndarray, stamps: np.ndarray) -> np.ndarray | None:
    """An even clock (N,) for samples with irregular stamps `time` (N,), if it is the better one; else None.

    A recorder writes samples of a controller's clock with stamps of its own. The clock must stay near them, and the
    values (N, m) run more smoothly on it than those of the samples `kept` with their `stamps` (K,): samples
    that were really taken at irregular times, or twice, do not.
    """
    if len(time) < FEW:
        return None
    usual = float(np.median(np.diff(time)))
    step, whole = _line(np.arange(len(time)), time)
    if np.median(np.abs(np.diff(time) - step)) < JITTER * step:
        return None
    clocks = [whole] if np.abs(time - whole).max() <= step else []
    if usual > 0:
        places = _places(time - time[0])
        step, even = _line(places, time)
        if np.quantile(np.abs(time - even), WITHIN) <= FARTHEST * step:
            clocks.append(_line(_settled(places, values), time)[1])

    def rough(at: np.ndarray, x: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):  # stamps may be the same
            return np.asarray(np.nanmean(np.diff(np.diff(x, axis=0) / np.diff(at)[:, None], axis=0) ** 2, axis=0))

    def smoother(one: np.ndarray, other: np.ndarray) -> bool:
        """True if more of the values run clearly more smoothly in one case than in the other."""
        return bool(np.count_nonzero(one < SMOOTHER * other) > np.count_nonzero(other < SMOOTHER * one))

    best: np.ndarray | None = None
    least = rough(stamps, values[kept])
    for even in clocks:
        own = rough(even, values)
        if smoother(own, least):
            best, least = even, own
    return best


def _line(places: np.ndarray, time: np.ndarray) -> tuple[float, np.ndarray]:
    """Step [s] of the even clock on which samples have these places (N,), and its stamps (N,)."""
    step, begin = (float(x) for x in np.polyfit(places, time - time[0], 1))
    return step, time[0] + begin + step * places


def _places(time: np.ndarray) -> np.ndarray:
    """Places (N,) of samples on an even clock, of which some are missing; `time` (N,) [s] begins at 0."""
    from scipy.optimize import isotonic_regression

    step, begin = _period(time[:FIRST])
    size = min(FIRST, len(time))
    while True:
        count = np.arange(size)
        for _ in range(TURNS):
            missing = isotonic_regression((time[:size] - begin) / step - count).x
            places = count + np.rint(missing).astype(int)
            step, begin = (float(x) for x in np.polyfit(places, time[:size], 1))
        if size == len(time):
            return places
        size = min(2 * size, len(time))


def _settled(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Move each missing sample by at most `ASIDE` samples, to where the values (N, m) clearly run more smoothly."""
    places, size = places.copy(), np.maximum(np.nanmean(np.abs(np.diff(values, axis=0)), axis=0), 1e-12)

    def rough(at: np.ndarray, x: np.ndarray) -> float:
        slope = np.diff(x, axis=0) / np.diff(at)[:, None]
        return float(np.nansum((np.diff(slope, axis=0) / size) ** 2))

    for k in (1 + np.flatnonzero(np.diff(places) > 1)).tolist():
        near = slice(max(k - 3 * ASIDE, 0), k + 3 * ASIDE)
        first, tried = k - near.start, [places[near]]
        for aside in range(1, ASIDE + 1):
            for part, by in ((slice(first, first + aside), -1), (slice(max(first - aside, 0), first), 1)):
                other = places[near].copy()
                other[part] += by
                if (np.diff(other) > 0).all():
                    tried.append(other)
        worth = [rough(at, values[near]) for at in tried]
        best = int(np.argmin(worth))
        places[near] = tried[best if worth[best] < CLEARER * worth[0] else 0]
    return places


def _period(time: np.ndarray) -> tuple[float, float]:
    """Period [s] of stamps (N,) near their median step at which most of them are in phase, and this phase [s]."""
    usual = float(np.median(np.diff(time)))
    rates = np.arange((1 - NEAR) / usual, (1 + NEAR) / usual, 1 / (8 * max(float(np.ptp(time)), usual)))
    sums = np.array([np.exp(2j * np.pi * rate * time).sum() for rate in rates])
    best = int(np.argmax(np.abs(sums)))
    return 1 / float(rates[best]), float(np.angle(sums[best])) / (2 * np.pi * float(rates[best]))
