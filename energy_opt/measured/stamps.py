"""Stamps of recorders made into those of a motion: repeated stamps, missing samples, gaps; all are counted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

COARSE = 0.3  # share of samples with the stamp of the sample before, from which stamps are coarser than the samples
GAP = 0.25  # [s] without a row, or `GAP_STEPS` steps: nothing is known of the motion in between
GAP_STEPS = 10
BUNCHED = 5.0  # times the usual step is the mean one, where samples arrive in bunches
SKIPPED = 1.6  # steps between samples from which one is missing


@dataclass(frozen=True)
class Stamped:
    """Which samples are kept (K,), their stamps (K,) [s], and after which of the kept ones there is a gap."""

    kept: np.ndarray
    time: np.ndarray
    gaps: tuple[int, ...]
    remarks: tuple[str, ...] = field(default=())


def backward(time: np.ndarray) -> int | None:
    """The first row whose stamp lies before that of the row above it, None where there is none."""
    back = np.flatnonzero(np.diff(time) < 0)
    return int(back[0]) + 1 if back.size else None


def clean(time: np.ndarray, values: np.ndarray) -> Stamped:
    """Samples with increasing stamps out of samples with stamps that do not decrease.

    A sample that repeats the one before it, stamp and values, is dropped. Samples that share a stamp but differ are
    spread evenly where stamps are coarser than the samples, moved to the free place behind them where there is one,
    and dropped otherwise.

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
    elif copies.any():  # under coarse stamps an arm at rest repeats itself truly
        kept = np.arange(len(time))
    stamps = time[kept].astype(float)
    same = np.concatenate([[False], np.diff(stamps) == 0])
    if same.any():
        if coarse:
            stamps = _spread(stamps, same)
            remarks.append(f"stamps stand still in {int(same.sum())} of {len(stamps)} rows: rows spread evenly, kept")
        else:
            kept, stamps, moved = _moved(kept, stamps, same)
            if moved:
                remarks.append(f"{moved} rows with the stamp of the row before moved to the free place behind it")
            if int(same.sum()) - moved:
                remarks.append(f"{int(same.sum()) - moved} rows with the stamp of the row before dropped")
    spread = _unbunched(stamps)
    if spread is not None:
        stamps = spread
        row = 1e3 * float(np.median(np.diff(stamps)))
        remarks.append(f"stamps come in bunches: rows spread evenly, {row:.3g} ms apart, as on the controller's clock")
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


def _unbunched(stamps: np.ndarray) -> np.ndarray | None:
    """Samples that arrived in bunches, spread evenly up to the last of each bunch; None where they do not bunch."""
    step = np.diff(stamps)
    near = step[step < GAP]
    if len(near) < 3 or BUNCHED * float(np.median(near)) >= float(near.mean()):
        return None
    last = np.append(np.flatnonzero(step > near.mean()), len(stamps) - 1)
    size = np.diff(last, prepend=-1)
    apart = np.diff(stamps[last], prepend=np.nan) / size
    row = float(np.nanmedian(apart))
    apart = np.where(apart < 2 * row, apart, row)  # also the first bunch, of which nobody knows when it began
    bunch = np.repeat(np.arange(len(last)), size)
    return np.asarray(stamps[last][bunch] - apart[bunch] * (last[bunch] - np.arange(len(stamps))))


def _spread(stamps: np.ndarray, same: np.ndarray) -> np.ndarray:
    """Samples of one stamp spread evenly up to the next stamp; those of the last as far apart as those before."""
    group = np.cumsum(~same) - 1
    first = np.flatnonzero(~same)
    size = np.diff(np.append(first, len(stamps)))
    length = np.diff(stamps[first])
    usual = float(np.median(length)) if len(length) else 1.0
    length = np.append(np.minimum(length, 2 * usual), usual)
    apart = length / size
    if len(apart) > 2:  # the first and the last stamp may be those of a part of the samples
        row = float(np.median(apart[1:-1]))
        apart[0], apart[-1] = min(apart[0], row), min(apart[-1], row)
    begin = stamps[first]
    if len(begin) > 1:
        begin[0] = begin[1] - size[0] * apart[0]
    return begin[group] + (np.arange(len(stamps)) - first[group]) * apart[group]


def _moved(kept: np.ndarray, stamps: np.ndarray, same: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Samples with the stamp of the one before: half way to the next where one is missing, else dropped."""
    step = np.diff(stamps)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    room = np.append(step, 0.0) > SKIPPED * usual
    move = same & room & ~np.append(same[1:], False)
    stamps = np.where(move, stamps + usual, stamps)
    stay = ~same | move
    return kept[stay], stamps[stay], int(move.sum())


def held(values: np.ndarray) -> np.ndarray | None:
    """The samples (M,) at which a slower source's reading was new, where each is held over several; None where not.

    Readings come at a beat: all distances between changes are multiples of one number of samples. A coarse instrument's
    values stay for a while too, but keep no beat.
    """
    change = np.flatnonzero(np.diff(values) != 0) + 1
    if len(change) < 5 or len(change) > len(values) / 3:
        return None
    apart = np.diff(change)
    beat = int(np.percentile(apart, 10))
    if beat < 3:
        return None
    off = np.abs(apart - beat * np.rint(apart / beat))
    return change if float(np.mean(off <= (1 if beat >= 10 else 0))) >= 0.95 else None
