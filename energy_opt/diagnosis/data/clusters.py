"""Distinct motions: repeats of one motion are one cluster, and stay together in every split; which joints move.

A model is judged on motions that it was not fitted to. A repeat of a fitted motion is no such test: all errors of a
model are the same in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.diagnosis.data.noise import Shared
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.measured import MeasuredSet, Run
from energy_opt.measured.run import cut_at_standstill, pieces
from energy_opt.robot import Limits

MOVES = 0.03  # [rad/s] a joint that never exceeds this speed does not move
SLOW = 0.1  # share of a joint's velocity limit
POINTS = 24  # points of a run's path at which motions are compared
SAME = 0.05  # [`Samples.unit`] runs whose paths differ by less at all points are repeats of one motion
PACE = 0.1  # relative difference of durations up to which runs are repeats
FEWEST = 3  # least distinct motions of a kind for holding one out
BY_TIME = 4  # pieces into which a recording without standstills is cut
SHARE = 0.25  # share of the motions of each kind that is held out
DRAWS = 100  # number of random selections of held-out motions
KNOTS, MOST_KNOTS = 0.3, 40  # [s] distance of the knots of a motion's discrepancy function; most knots


def clusters(samples: Samples) -> list[list[int]]:
    """Group the runs: repeats of one motion, or of one pose, form a cluster."""
    keys = []
    for span, kind in zip(samples.slices, samples.kinds, strict=True):
        at = np.linspace(span.start, span.stop - 1, POINTS).round().astype(int)
        keys.append((kind, samples.q[at] / samples.unit, float(samples.t[span.stop - 1] - samples.t[span.start])))
    out: list[list[int]] = []
    for k, (kind, path, lasts) in enumerate(keys):
        for group in out:
            other, way, duration = keys[group[0]]
            paced = kind == "static" or abs(duration - lasts) <= PACE * max(duration, lasts)
            if kind == other and paced and np.abs(path - way).max() < SAME:
                group.append(k)
                break
        else:
            out.append([k])
    return out


def parted(measured: MeasuredSet) -> MeasuredSet:
    """Cut recordings at standstills, else by time, if the set has too few distinct motions to hold one out."""
    moving = [r for r in measured.runs if r.kind == "motion"]
    if not moving or any(r.meter == "total" for r in moving) or _motions(measured) >= FEWEST:
        return measured
    for cut, how in ((cut_at_standstill, "where the arm stands still"), (_by_time, "by time")):
        runs = tuple(piece for run in measured.runs for piece in (cut(run) if run.kind == "motion" else [run]))
        parts = replace(measured, runs=runs)
        if _motions(parts) >= FEWEST:
            remark = f"{len(moving)} recording(s) cut {how}, so that some motions can be held out."
            return replace(parts, remarks=(*measured.remarks, remark))
    return measured


def _by_time(run: Run) -> list[Run]:
    """Cut a recording into `BY_TIME` pieces of the same length."""
    edges = np.linspace(0, len(run.time) - 1, BY_TIME + 1).astype(int)
    return pieces(run, list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)))


def _motions(measured: MeasuredSet) -> int:
    """Number of distinct motions of a set."""
    samples = take_samples(measured)
    return sum(samples.kinds[group[0]] == "motion" for group in clusters(samples))


def repeats(samples: Samples) -> list[int]:
    """Number of recordings (R,) of each run's motion or pose."""
    out = [1] * len(samples.slices)
    for group in clusters(samples):
        for r in group:
            out[r] = len(group)
    return out


def excited(samples: Samples, limits: Limits) -> np.ndarray:
    """(n,) True for joints that move enough to show their losses.

    A joint must exceed `MOVES`. If no joint of the arm reaches `SLOW` of its velocity limit in `limits`, all count as
    idle: slow motion does not show viscous friction, regeneration and inertia.
    """
    if (np.abs(samples.v) < SLOW * limits.velocity).all():
        return np.zeros(samples.n, dtype=bool)
    return moves(samples)


def moves(samples: Samples) -> np.ndarray:
    """(n,) True for joints that exceed the speed `MOVES`."""
    return np.asarray(np.abs(samples.v).max(axis=0) > MOVES)


def samples_of(samples: Samples, group: Sequence[int]) -> np.ndarray:
    """Indices (m,) of the readings of the runs in `group`, run after run."""
    return np.concatenate([np.arange(samples.parts[r].start, samples.parts[r].stop) for r in group])


def split(samples: Samples, seed: int = 0) -> tuple[list[int], list[int]]:
    """Indices of training and holdout runs, each ascending; repeats of a motion stay together.

    Of `DRAWS` random selections, the one is used whose motions resemble all motions of their kind most, by the means of
    every joint's speed, squared torque, and positive and negative power. So the held-out motions excite the same
    effects as the others. The order of the log and the names of the files have no influence. A kind with fewer than
    `FEWEST` motions is not split. Poses alone cannot judge motions: they are not held out if no motion can be. `seed`
    is that of the selections.
    """
    rng = np.random.default_rng(seed)
    torque = samples.body.torque(samples.q, samples.v, samples.a)
    power = torque * samples.v
    signals = np.column_stack([torque**2, np.abs(samples.v), np.maximum(power, 0), np.minimum(power, 0)])
    groups, holdout = clusters(samples), []
    for kind in ("motion", "static"):
        own = [g for g in groups if samples.kinds[g[0]] == kind]
        if len(own) < FEWEST:
            if own and kind == "motion":
                break
            continue
        means = np.array([np.mean([signals[samples.slices[r]].mean(axis=0) for r in g], axis=0) for g in own])
        order = np.argsort(means[:, : samples.n].sum(axis=1))
        means = (means - means.mean(axis=0)) / np.maximum(means.std(axis=0), 1e-9)
        count = max(1, round(SHARE * len(own)))
        drawn = [order[rng.permutation(len(own))[:count]] for _ in range(DRAWS)]
        best = min(drawn, key=lambda held: float(np.sum(means[held].mean(axis=0) ** 2)))
        holdout += [r for k in best for r in own[int(k)]]
    return [k for k in range(len(samples.kinds)) if k not in holdout], sorted(holdout)


def shared_functions(samples: Samples) -> Shared:
    """A piecewise linear function of phase for every motion that is repeated, a constant for every such pose.

    The model error in a motion recorded once counts as slow noise of that run.
    """
    motions, columns = [], np.zeros((len(samples.power), MOST_KNOTS))
    for group in clusters(samples):
        if len(group) < 2:
            continue
        lasts = float(np.ptp(samples.at[samples.parts[group[0]]]))
        count = 1 if samples.kinds[group[0]] == "static" else int(np.clip(round(lasts / KNOTS) + 1, 2, MOST_KNOTS))
        for r in group:
            part = samples.parts[r]
            phase = (samples.at[part] - samples.at[part][0]) / max(float(np.ptp(samples.at[part])), 1e-9)
            columns[part, :count] = np.maximum(0.0, 1 - np.abs(phase[:, None] * (count - 1) - np.arange(count)))
        motions.append((samples_of(samples, group), count))
    return Shared(columns[:, : max((count for _, count in motions), default=0)], tuple(motions))
