"""Measured runs as one table of samples: bins of meter readings with the motion and the rigid body's torque there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.measured import MeasuredSet, Run, Smoothing, choose_smoothing, kinematics
from energy_opt.robot import RigidBody

BIN = 0.03  # [s] readings closer than this are averaged
NORMAL_MEDIAN = 0.6745  # median of |x| of a standard normal x
EDGE, DOUBTED = 2, 0.15  # samples on either side of a motion's beginning and end, and their weight
SLACK = 2e-3  # [s] by which motion and meter may be apart
REST = 1e-3  # [rad/s] slower joints stand still, whatever the encoder's noise says


@dataclass(frozen=True)
class Samples:
    """N samples of R runs, run after run.

    Attributes:
        q, v, a: (N, n) rad, rad/s, rad/s^2. t: (N,) set time, s.
        power: (N,) measured, W.
        run: (N,) index of the run. slices: where each run lies. files, kinds: of the runs;
            counts: how many readings stand in a sample's mean.
        temperature: (N, n) degC or nan.
        weight: (N,) the meter's noise over that of the whole comparison, see `weighted`.
        noise: standard deviation of a sample's meter noise, W. floor: of a single reading, W.
        clock: True where the log states every run's set time.
        readings: set time (M,) and power (M,) of every single reading, run by run.
    """

    body: RigidBody
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    t: np.ndarray
    power: np.ndarray
    run: np.ndarray
    slices: tuple[slice, ...]
    files: tuple[str, ...]
    kinds: tuple[str, ...]
    counts: tuple[int, ...]
    temperature: np.ndarray
    weight: np.ndarray
    noise: float
    floor: float
    clock: bool
    readings: tuple[tuple[np.ndarray, np.ndarray], ...]

    @property
    def n(self) -> int:
        return self.q.shape[1]

    def part(self, runs: Sequence[int]) -> Samples:
        """The samples of some runs only, with what was computed of them."""
        rows = np.concatenate([np.arange(self.slices[r].start, self.slices[r].stop) for r in runs])
        lengths = [self.slices[r].stop - self.slices[r].start for r in runs]
        ends = np.cumsum([0, *lengths])
        out = Samples(
            self.body, self.q[rows], self.v[rows], self.a[rows], self.t[rows], self.power[rows],
            np.repeat(np.arange(len(runs)), lengths),
            tuple(slice(int(x), int(y)) for x, y in zip(ends[:-1], ends[1:], strict=True)),
            tuple(self.files[r] for r in runs), tuple(self.kinds[r] for r in runs),
            tuple(self.counts[r] for r in runs), self.temperature[rows],
            self.weight[rows], self.noise, self.floor, self.clock, tuple(self.readings[r] for r in runs),
        )  # fmt: skip
        for name in ("free_torque", "gravity_torque", "free_regressor", "gravity_regressor"):
            if name in self.__dict__:
                out.__dict__[name] = self.__dict__[name][rows]
        return out

    @cached_property
    def free_torque(self) -> np.ndarray:
        """Rigid torque without gravity and payload, (N, n) N m."""
        return self.body.torque(self.q, self.v, self.a, None, np.zeros(3))

    @cached_property
    def gravity_torque(self) -> np.ndarray:
        """d tau / d gravity of the bare arm, (N, n, 3)."""
        rest = np.zeros_like(self.v)
        return np.stack([self.body.torque(self.q, rest, rest, None, unit) for unit in np.eye(3)], axis=2)

    @cached_property
    def free_regressor(self) -> np.ndarray:
        """d tau / d (last link's inertial parameters) without gravity, (N, n, 10)."""
        return self.body.payload_regressor(self.q, self.v, self.a, np.zeros(3))

    @cached_property
    def gravity_regressor(self) -> np.ndarray:
        """The same for unit gravity along x, y, z, at rest: (N, n, 10, 3)."""
        rest = np.zeros_like(self.v)
        return np.stack([self.body.payload_regressor(self.q, rest, rest, unit) for unit in np.eye(3)], axis=3)


def take_samples(measured: MeasuredSet) -> tuple[Samples, Smoothing]:
    """All runs of a set as samples, and the smoothing that the data chose."""
    smoothing = choose_smoothing(measured.runs)
    parts = [_bins(run, smoothing) for run in measured.runs]
    lengths = [len(p[0]) for p in parts]
    ends = np.cumsum([0, *lengths])
    slices = tuple(slice(int(x), int(y)) for x, y in zip(ends[:-1], ends[1:], strict=True))
    t, power, q, v, a, temperature = (np.concatenate(column) for column in zip(*parts, strict=True))
    first = min(float(run.start + run.time[0]) for run in measured.runs)
    samples = Samples(
        measured.robot.body, q, v, a, t - first, power, np.repeat(np.arange(len(parts)), lengths), slices,
        tuple(r.file for r in measured.runs), tuple(r.kind for r in measured.runs),
        tuple(_per_bin(r) for r in measured.runs), temperature,
        np.ones(len(t)), _meter_noise([power[s] for s in slices]),
        _meter_noise([r.power for r in measured.runs]), measured.clock,
        tuple((run.start + run.power_time - first, run.power) for run in measured.runs),
    )  # fmt: skip
    return samples, smoothing


def weighted(samples: Samples, power: np.ndarray) -> Samples:
    """The same samples, trusted less where power changes fast: clocks and motion are known to `SLACK` only.

    Where a motion begins or ends, smoothed positions do not say to the sample when; `EDGE` samples are doubted there.

    Args:
        power: (N,) W, a model's reading; its slope times `SLACK` adds to the meter's noise.
    """
    slope = np.concatenate([np.gradient(power[s], samples.t[s]) for s in samples.slices])
    weight = 1 / np.sqrt(1 + (SLACK * slope / samples.noise) ** 2)
    moving = (samples.v != 0).any(axis=1)
    for rows in samples.slices:
        for k in rows.start + 1 + np.flatnonzero(moving[rows][1:] != moving[rows][:-1]):
            weight[max(rows.start, k - EDGE) : min(rows.stop, k + EDGE)] *= DOUBTED
    return replace(samples, weight=weight)


def _per_bin(run: Run) -> int:
    """How many of a run's meter readings make a sample."""
    return max(1, int(BIN / float(np.median(np.diff(run.power_time))) + 0.5))


def _bins(run: Run, smoothing: Smoothing) -> tuple[np.ndarray, ...]:
    count = _per_bin(run)
    whole = len(run.power) // count * count
    time = run.power_time[:whole].reshape(-1, count).mean(axis=1)
    power = run.power[:whole].reshape(-1, count).mean(axis=1)
    moved = np.ptp(run.position, axis=0)
    k = kinematics(run, time, smoothing)
    q, v, a = k.q, k.v, k.a
    if moved.max() < 2e-3:
        q, v, a = np.tile(run.position.mean(axis=0), (len(time), 1)), np.zeros_like(v), np.zeros_like(a)
    v = np.where(np.abs(v) < REST, 0.0, v)
    temperature = np.full_like(q, np.nan)
    if run.temperature is not None:
        temperature = np.column_stack([np.interp(time, run.time, column) for column in run.temperature.T])
    return run.start + time, power, q, v, a, temperature


def _meter_noise(powers: Sequence[np.ndarray]) -> float:
    """Standard deviation of a reading's noise, W, from third differences: what no smooth power explains.

    Robust twice: by the median within a run, so that kinks and steps of the true power do not count, and over the runs.
    Coarse readings, whose median difference is zero, go by their rms.
    """
    levels = []
    for x in powers:
        if len(x) > 12:
            third = np.diff(x, 3)
            middle = float(np.median(np.abs(third))) / NORMAL_MEDIAN
            levels.append((middle if middle > 0 else float(np.sqrt(np.mean(third**2)))) / np.sqrt(20))
    return max(float(np.median(levels)), 1e-3) if levels else 1.0
