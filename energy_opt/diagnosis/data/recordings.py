"""Measured runs as samples: readings averaged in bins, smoothed motion, and its uncertainty by position errors.

Before that a set is prepared: damaged runs are left out, and long sets are shortened. A model is evaluated at nodes:
the middles of bins for readings at instants, else evenly under the windows over which the meter averages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from energy_opt.diagnosis.data.noise import meter_noise, resolution
from energy_opt.diagnosis.data.samples import Samples, laid
from energy_opt.measured import MeasuredSet, Run, Smoothing, choose_smoothing, kinematics
from energy_opt.measured.run import nodes, operator

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

BIN = 0.03  # [s] readings closer than this are averaged
MOST_READINGS = 10_000  # most readings in a fit: five minutes of a fast meter; of more, neighbours are averaged
REST, BY_NOISE = 1e-3, 4.0  # [rad/s] slower joints count as still, see `_motion`; standard deviations of noise, too
MOST_NODES = 40_000  # most nodes at which models are evaluated: twenty minutes of a fast meter
FEW_IN_BIN = 4  # least readings of a bin that show how single ones scatter in it
FEW_RUNS = 8  # least runs to keep if runs are left out; otherwise each run is cut short
FOUND = 0.1  # share of the time between readings to which a clock is found by correlation
COMPARED = 4  # least runs of a kind to compare their scatter
# scatter from reading to reading of a damaged run, over the median of such runs; and over the level of the power
SCATTER, WILD = 20.0, 0.1
Taken = tuple[tuple[np.ndarray, ...], tuple[np.ndarray, np.ndarray], "csr_matrix | None", int]


def prepared(measured: MeasuredSet) -> MeasuredSet:
    """A set as it is fitted: runs of the meter without damaged ones, and not too long."""
    return shortened(_without_scattering(_metered(measured)))


def _metered(measured: MeasuredSet) -> MeasuredSet:
    """Leave out the runs without any meter reading."""
    runs = tuple(run for run in measured.runs if len(run.power))
    less = len(measured.runs) - len(runs)
    if not less:
        return measured
    remark = f"{less} run(s) without a reading of the meter left out"
    return replace(measured, runs=runs, remarks=(*measured.remarks, remark))


def _without_scattering(measured: MeasuredSet) -> MeasuredSet:
    """Leave out runs whose power scatters far more than in the other runs: the meter's column is damaged there.

    Errors of damaged readings exceed all else, so that one such run hides every cause. Runs are compared with those of
    the same kind, as the power in motion is less smooth than at rest.
    """
    level = float(np.median(np.abs(np.concatenate([run.power for run in measured.runs]))))
    bad = set()
    for kind in ("motion", "static"):
        alike = [run for run in measured.runs if run.kind == kind]
        if len(alike) < COMPARED:
            continue
        scatter = [meter_noise([(run.power_time, run.power)]) for run in alike]
        most = max(SCATTER * float(np.median(scatter)), WILD * level)
        bad |= {run.file for run, own in zip(alike, scatter, strict=True) if own > most}
    if not bad:
        return measured
    remark = (
        f"Left out, as the power scatters more than {SCATTER:.0f} times as much as in the other runs: "
        f"{', '.join(sorted(bad))}. Are these readings damaged?"
    )
    runs = tuple(run for run in measured.runs if run.file not in bad)
    return replace(measured, runs=runs, remarks=(*measured.remarks, remark))


def shortened(measured: MeasuredSet) -> MeasuredSet:
    """Reduce a set to `MOST_NODES`: leave out runs evenly, or cut the ends of a few long ones; add a remark."""
    counts = [len(nodes(r)) if r.window.any() else len(r.power) // per_bin(r) for r in measured.runs]
    share = MOST_NODES / max(sum(counts), 1)
    if share >= 1:
        return measured
    runs = measured.runs
    if share * len(runs) >= FEW_RUNS:
        kept = tuple(r for k, r in enumerate(runs) if int((k + 1) * share) > int(k * share))
        how = f"{len(kept)} of {len(runs)} runs, spread evenly, are used"
    else:
        kept = tuple(_first(run, share) for run in runs)
        how = f"the first {100 * share:.0f} % of each run are used"
    remark = f"The set is longer than {MOST_NODES} samples, the most that are fitted: {how}."
    return replace(measured, runs=kept, remarks=(*measured.remarks, remark))


def _first(run: Run, share: float) -> Run:
    """The first `share` of a run's duration."""
    end = run.time[0] + share * (run.time[-1] - run.time[0])
    samples, read = run.time <= end, run.power_time <= end
    signals = {name: values[samples] for name, values in run.joint_signals()}
    index = run.lines[samples] if len(run.lines) == len(run.time) else run.lines
    return replace(
        run, time=run.time[samples], lines=index, power_time=run.power_time[read], power=run.power[read],
        window=run.window[read], logged=run.logged_at(samples), **signals,
    )  # fmt: skip


def on_time(measured: MeasuredSet, late: float) -> MeasuredSet:
    """Move the meter's readings, which are `late` [s] against the positions; instants beyond these are left out."""
    runs = []
    for run in measured.runs:
        time = run.power_time - late
        kept = (run.window > 0) | ((time >= run.time[0]) & (time <= run.time[-1]))
        moved = replace(run, power_time=time[kept], power=run.power[kept], window=run.window[kept])
        runs.append(moved if kept.any() else run)
    remark = (
        f"The meter's readings are {1e3 * abs(late):.2g} ms {'late' if late > 0 else 'early'} against the positions, "
        "no more than their sampling and smoothing leave open: moved by this time, and no property of the meter."
    )
    return replace(measured, runs=tuple(runs), remarks=(*measured.remarks, remark))


def take_samples(measured: MeasuredSet) -> Samples:
    """All runs of a set as samples; the smoothing is chosen from the data."""
    smoothing = choose_smoothing(measured.runs)
    taken = [_windows(run, smoothing) if run.window.any() else _bins(run, smoothing) for run in measured.runs]
    first = min(float(run.start + run.time[0]) for run in measured.runs)
    noise = meter_noise([reading for _, reading, _, _ in taken])
    single = [(run.start + run.power_time - first, run.power) for run in measured.runs]
    within = _within_bins(measured.runs, [m[2] for m, *_ in taken])
    step = resolution([run.power for run in measured.runs])
    group = -(-sum(len(power) for _, (_, power), _, _ in taken) // MOST_READINGS)  # so that at most so many remain
    if group > 1:
        windows = [run.window.any() for run in measured.runs]
        taken = [_grouped(run, group) for run in taken]
        single = [
            (reading[0] - first, reading[1]) if own else one
            for one, (_, reading, _, _), own in zip(single, taken, windows, strict=True)
        ]
    motion, readings, operators, counts = zip(*taken, strict=True)
    t, q, v, a, temperature, blur, smoothed, jumps = (np.concatenate(column) for column in zip(*motion, strict=True))
    at, power = (np.concatenate(column) for column in zip(*readings, strict=True))
    parts = laid([slice(0, len(r[0])) for r in readings])
    return Samples(
        measured.robot.body, q, v, a, t - first, laid([slice(0, len(m[0])) for m in motion]), temperature,
        at - first, power, parts, operators, counts, np.ones(len(at)), noise / group**0.5,
        max(meter_noise([(r.power_time, r.power) for r in measured.runs]), within, step / 12**0.5),
        tuple(r.file for r in measured.runs), tuple(r.kind for r in measured.runs), tuple(single), group,
        _logged(measured.runs, [m[0] for m in motion]), blur, jumps, tuple(_period(m[2], m[6]) for m in motion),
        _lag(measured, smoothing, v, smoothed),
        step, averaged=any(run.window.any() for run in measured.runs),
    )  # fmt: skip


def _lag(measured: MeasuredSet, smoothing: Smoothing, v: np.ndarray, smoothed: np.ndarray) -> float:
    """Time uncertainty [s] of the motion: the largest of sampling time, time per position step, and smoothing time.

    Clocks that were found by correlation are uncertain by a share of the time between readings.
    """
    spacing = float(np.median(np.concatenate([np.diff(run.time) for run in measured.runs])))
    found = [np.diff(run.power_time) for run in measured.runs if run.clock == "estimated" and len(run.power) > 1]
    if found:
        spacing = max(spacing, FOUND * float(np.median(np.concatenate(found))))
    speed = np.abs(v[v != 0])
    if not speed.size:
        return spacing
    step = 12**0.5 * smoothing.position_noise
    return max(spacing, step / float(np.median(speed)), float(np.median(smoothed[v != 0])))


def _period(v: np.ndarray, smoothed: np.ndarray) -> float:
    """Period [s] of the lowest cut-off of a run's joints that move; `v` and `smoothed` (K, n) as of `_motion`."""
    return 2 * np.pi * float(np.max(smoothed, where=v != 0, initial=0.0))


def _blur(run: Run, smoothing: Smoothing, cutoffs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (n,) of velocities and (n,) of accelerations after smoothing of noisy readings.

    White noise s of samples h apart has the density 2 s^2 h; the smoother's response is 1 / (1 + (f / f_c)^6).
    """
    h, f = float(np.median(np.diff(run.time))), np.where(np.isfinite(cutoffs), cutoffs, 0.0)
    if run.velocity is None:
        s = smoothing.position_noise
        v = s * 2 * np.pi * np.sqrt(2 * h * f**3 * np.pi / 12)
        a = s * (2 * np.pi) ** 2 * np.sqrt(2 * h * f**5 * np.pi / 18)
    else:
        s = smoothing.velocity_noise
        v = s * np.sqrt(2 * h * f * 5 * np.pi / 18)
        a = s * 2 * np.pi * np.sqrt(2 * h * f**3 * np.pi / 12)
    return v, 0 * a if run.acceleration is not None else a


def _bins(run: Run, smoothing: Smoothing) -> Taken:
    """Readings at instants, averaged in bins; nodes are the bins' middles."""
    index = binned(run)
    time, power = run.power_time[index].mean(axis=1), run.power[index].mean(axis=1)
    return _motion(run, time, smoothing), (run.start + time, power), None, index.shape[1]


def binned(run: Run) -> np.ndarray:
    """Indices (K, count) of the readings in each bin.

    Bins over a gap, where readings were dropped, are left out: they last more than twice as long as the usual one.
    """
    count = per_bin(run)
    index = np.arange(len(run.power) // count * count).reshape(-1, count)
    if not len(index):
        return index
    lasts = np.ptp(run.power_time[index], axis=1)
    return index[lasts <= 2 * np.median(lasts)]


def _within_bins(runs: Sequence[Run], speeds: Sequence[np.ndarray]) -> float:
    """Standard deviation [W] of single readings about the mean of their bin while the arm rests; 0 if bins are small.

    Neighbouring readings of a fast meter share noise, which their differences do not show.
    """
    scatter = []
    for run, v in zip(runs, speeds, strict=True):
        if not run.window.any() and per_bin(run) >= FEW_IN_BIN:
            index = binned(run)
            scatter += run.power[index[~(v != 0).any(axis=1)]].var(axis=1, ddof=1).tolist()
    return float(np.sqrt(np.median(scatter))) if scatter else 0.0


def _windows(run: Run, smoothing: Smoothing) -> Taken:
    """Readings over windows; nodes lie evenly under them."""
    at = nodes(run)
    middle = run.start + run.power_time - run.window / 2
    return _motion(run, at, smoothing), (middle, run.power), operator(run, at), 1


def _grouped(taken: Taken, group: int) -> Taken:
    """Neighbouring readings averaged; the nodes stay. A run of fewer than `group` readings is not changed."""
    from scipy.sparse import csr_matrix

    motion, (at, power), op, count = taken
    if len(power) < group:
        return taken
    whole = len(power) // group
    index = np.arange(whole * group)
    mean = csr_matrix((np.full(len(index), 1 / group), (index // group, index)), shape=(whole, len(power)))
    through = mean @ (_bin_matrix(len(power), count) if op is None else op)  # from the nodes to the means
    return motion, (mean @ at, mean @ power), through.tocsr(), 1


def _motion(run: Run, time: np.ndarray, smoothing: Smoothing) -> tuple[np.ndarray, ...]:
    """Set time, motion and temperature at some times of a run, blur, the smoothing's time constants [s], and jumps."""
    moved = np.ptp(run.position, axis=0)
    k = kinematics(run, time, smoothing, details=True)
    q, v, a = k.q, np.where(k.rest, 0.0, k.v), np.where(k.rest, 0.0, k.a)
    if moved.max() < 2e-3:
        q, v, a = np.tile(run.position.mean(axis=0), (len(time), 1)), np.zeros_like(v), np.zeros_like(a)
    blur_v, blur_a = _blur(run, smoothing, k.cutoffs)
    noise = np.abs(v) < BY_NOISE * blur_v
    slow = noise | (np.abs(v) < REST)
    # a joint that creeps while another moves has friction in its direction
    creeps = slow & ~noise & ~k.still & ~slow.all(axis=1, keepdims=True)
    v = np.where(slow & ~creeps, 0.0, v)
    temperature = np.full_like(q, np.nan)
    if run.temperature is not None:
        temperature = np.column_stack([np.interp(time, run.time, c) for c in run.temperature.T])
    # errors are correlated over some bins: they are widened by the root of their number
    step = max(BIN, float(np.median(np.diff(run.time))))
    alike = np.sqrt(np.maximum(1.0, 1 / np.maximum(2 * np.where(np.isfinite(k.cutoffs), k.cutoffs, 0.0) * step, 1e-9)))
    blur = np.where(np.tile(v, 2) != 0, np.concatenate([blur_v * alike, blur_a * alike]), 0.0)
    smoothed = np.tile(1 / (2 * np.pi * k.cutoffs), (len(time), 1))
    return run.start + time, q, v, a, temperature, blur, smoothed, np.where(np.tile(k.rest, 2), 0.0, k.jumps)


def _logged(runs: Sequence[Run], times: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Further signals that all runs have and that change, at the set times; a value holds until the next sample.

    Of readings that are averaged, it is the mean signal: it may switch between two of them.
    """
    out: dict[str, np.ndarray] = {}
    for name in sorted(set.intersection(*(set(run.logged) for run in runs))):
        parts = []
        for run, time in zip(runs, times, strict=True):
            stamps = (time - run.start)[:, None] if run.window.any() else run.power_time[binned(run)]
            at = np.searchsorted(run.time, stamps, side="right") - 1
            parts.append(run.logged[name][np.maximum(at, 0)].mean(axis=1))
        values = np.concatenate(parts)
        out |= {name: values} if np.ptp(values) > 0 else {}
    return out


def _bin_matrix(readings: int, count: int) -> csr_matrix:
    """`_bin_mean` as a matrix."""
    from scipy.sparse import diags

    bend = np.zeros(readings)
    bend[1:-1] = (1 - 1 / count**2) / 24
    return diags([bend[1:], 1 - 2 * bend, bend[:-1]], [-1, 0, 1], format="csr")


def per_bin(run: Run) -> int:
    """Number of a run's meter readings per sample."""
    return max(1, int(BIN / float(np.median(np.diff(run.power_time))) + 0.5)) if len(run.power) > 1 else 1
