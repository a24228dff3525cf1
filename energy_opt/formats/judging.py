"""Judging of files as their controllers run them. In a cycle, each stretch is judged with its own payload and scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.formats.controller_program import Part
from energy_opt.formats.resample import KINDS, worst_steps
from energy_opt.motion.judge.certificate import Certificate, certify
from energy_opt.motion.judge.clearance import clearance_of, measured
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit, Violation
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.trajectory import NANOSECOND, Trajectory

AT_REST = 1e-6  # [rad/s, m/s] slower arms are at rest


@dataclass(frozen=True)
class Judging:
    """Judges the content of a file as its controller runs it.

    Attributes:
        scorer: gives torque and power under the model. limits: those to keep. cell: bodies to keep clear of; None:
            none. samples: number of places of the certificate; None: the usual density. holder: scorer whose torque and
            power are compared with the limits; None: `scorer`. stops: (K, n) ends of motions within what is judged.
        measured: whether the least distance of a proven motion is measured all along it, and not only by the proof.
    """

    scorer: Scorer
    limits: tuple[Limit, ...]
    cell: Cell | None = None
    samples: int | None = None
    holder: Scorer | None = None
    stops: np.ndarray | None = None
    measured: bool = False

    def __call__(self, trajectory: Trajectory) -> Certificate:
        """The certificate of a trajectory whose samples are joined by quintics."""
        return self._clear(certify(trajectory, self.holder or self.scorer, self.limits, self.samples), trajectory)

    def at_steps(self, trajectory: Trajectory, rate: float | None) -> Certificate:
        """The certificate of positions that a controller takes one by one.

        Limits on velocity, acceleration and jerk are compared with differences from step to step.

        Args:
            trajectory: the positions. rate: [Hz] of the steps; None: differences are not compared.
        """
        whole = certify(trajectory, self.holder or self.scorer, self.limits, samples_only=True)
        others = tuple(found for found in whole.found if found.limit not in KINDS)
        steps = () if rate is None else worst_steps(trajectory, rate, self.scorer.robot.limits)
        return self._clear(replace(whole, found=(*others, *steps)), trajectory)

    def joules(self, trajectory: Trajectory) -> float:
        """Energy [J] of a trajectory under the model."""
        return self.scorer.energy(trajectory).total

    def _clear(self, certificate: Certificate, trajectory: Trajectory) -> Certificate:
        """The certificate with the clearance of the trajectory."""
        if self.cell is None:
            return certificate
        certificate = replace(certificate, clearance=clearance_of(self.cell, trajectory, self.stops))
        return measured(self.cell, trajectory, certificate) if self.measured else certificate


@dataclass(frozen=True)
class Window:
    """A stretch of a cycle with constant payload and scene.

    Attributes:
        start, end: [s] in the cycle. judge: of this stretch. stops: [s] ends of the motions within it.
    """

    start: float
    end: float
    judge: Judging
    stops: tuple[float, ...] = ()


@dataclass(frozen=True)
class CycleJudging(Judging):
    """Judges a whole cycle, stretch by stretch; `scorer` is the first one's."""

    windows: tuple[Window, ...] = ()

    @classmethod
    def of(cls, stretches: Iterable[tuple[float, Scorer, Cell | None]], measured: bool = False) -> CycleJudging:
        """Judge of a cycle within the robot's limits; equal neighbours are merged.

        Args:
            stretches: duration [s], scorer and cell of each, in order. measured: as that of `Judging`.
        """
        windows: list[Window] = []
        at = 0.0
        for seconds, scorer, cell in stretches:
            if windows and windows[-1].judge.scorer is scorer and windows[-1].judge.cell is cell:
                last = windows[-1]
                windows[-1] = replace(last, end=at + seconds, stops=(*last.stops, at))
            else:
                judge = Judging(scorer, joint_limits(scorer.robot.limits), cell, measured=measured)
                windows.append(Window(at, at + seconds, judge))
            at += seconds
        first = windows[0].judge
        return cls(first.scorer, first.limits, windows=tuple(windows))

    def __call__(self, trajectory: Trajectory) -> Certificate:
        """The worst of the certificates of all stretches."""
        return self._over(trajectory, lambda judge, part: judge(part))

    def of_motions(self, trajectory: Trajectory) -> Certificate:
        """The same, where a jump of the acceleration between two motions, see `joined`, breaks no jerk limit."""
        looks = []
        for motion in apart(trajectory):
            at, end = (float(motion.time[k] - trajectory.time[0]) for k in (0, -1))
            windows = [
                replace(w, start=w.start - at, end=w.end - at, stops=tuple(s - at for s in w.stops if at < s < end))
                for w in self.windows if w.end > at and w.start < end
            ]  # fmt: skip
            looks.append((replace(self, windows=tuple(windows))(motion), at))
        return _worst(looks)

    def at_steps(self, trajectory: Trajectory, rate: float | None) -> Certificate:
        """The worst of all stretches; differences from step to step are compared over the whole cycle."""
        found = self._over(trajectory, lambda judge, part: judge.at_steps(part, None))
        steps = () if rate is None else worst_steps(trajectory, rate, self.scorer.robot.limits)
        return replace(found, found=(*found.found, *steps))  # differences between steps do not depend on the stretches

    def of_parts(self, parts: Sequence[Part]) -> Certificate:
        """Certificate of a program's motions one by one, each by the judge of its middle; the arm rests in between."""
        looks, at = [], 0.0
        for part in parts:
            end = at + part.trajectory.duration
            window = next((w for w in self.windows if w.end > (at + end) / 2), self.windows[-1])
            looks.append((window.judge(part.trajectory), at))
            at = end
        return _worst(looks)

    def joules(self, trajectory: Trajectory) -> float:
        """Energy of the whole cycle under the models of its stretches [J]."""
        return sum(window.judge.joules(_part(trajectory, window)) for window in self.windows)

    def _over(self, trajectory: Trajectory, look: Callable[[Judging, Trajectory], Certificate]) -> Certificate:
        """The worst of the certificates that `look` gives for the stretches."""
        looks = []
        for window in self.windows:
            part, judge = _part(trajectory, window), window.judge
            if window.stops:
                judge = replace(judge, stops=trajectory.sample(trajectory.time[0] + np.array(window.stops))[0])
            looks.append((look(judge, part), float(part.time[0] - trajectory.time[0])))
        return _worst(looks)


def _worst(looks: Sequence[tuple[Certificate, float]]) -> Certificate:
    """The worst violation of each limit in certificates of stretches that begin at the given times [s]."""
    found: dict[str, list[Violation]] = {}
    for certificate, at in looks:
        for violation in certificate.found:
            found.setdefault(violation.limit, []).append(replace(violation, time=violation.time + at))
    worst = tuple(max(places, key=lambda v: float("inf") if v.excess is None else v.excess)
                  for places in found.values())  # fmt: skip
    certificates = [certificate for certificate, _ in looks]
    clearance = _least([_later(c.clearance, at) for c, at in looks if c.clearance is not None])
    samples, power = sum(c.samples for c in certificates), max(c.peak_power for c in certificates)
    return Certificate(samples, worst, power, clearance, all(c.proven for c in certificates))


def _later(found: Clearance, by: float) -> Clearance:
    """The clearance of a motion that begins at `by` [s]."""
    return found if found.time is None else replace(found, time=found.time + by)


def _least(clearances: Sequence[Clearance]) -> Clearance | None:
    """The worst of all: if each is proven, its least bound, and the least distance that was measured in any."""
    worst = min(clearances, key=lambda c: (c.proven, c.lower_bound is None, c.lower_bound), default=None)
    measured = [c for c in clearances if c.min_distance is not None]
    if worst is None or not worst.proven or not measured:
        return worst
    near = min(measured, key=lambda c: c.min_distance or 0.0)
    return replace(worst, min_distance=near.min_distance, pair=near.pair, time=near.time)


def apart(trajectory: Trajectory) -> list[Trajectory]:
    """The motions between jumps of the acceleration at rest, where `joined` keeps two samples a nanosecond apart."""
    resting = np.abs(trajectory.velocity).max(axis=1) < AT_REST
    jumps = np.flatnonzero((np.diff(trajectory.time) < 1.5 * NANOSECOND) & resting[:-1] & resting[1:])
    bounds = [0, *(jumps + 1).tolist(), len(trajectory.time)]
    return [trajectory.part(slice(a, b)) for a, b in pairwise(bounds) if b - a > 1] or [trajectory]


def _part(trajectory: Trajectory, window: Window) -> Trajectory:
    """The samples of a stretch, with those just outside of it."""
    time = trajectory.time - trajectory.time[0]
    first = max(int(time.searchsorted(window.start + 1e-9, side="right")) - 1, 0)
    last = int(time.searchsorted(window.end - 1e-9))
    return trajectory.part(slice(min(first, len(time) - 2), min(max(last, first + 1), len(time) - 1) + 1))
