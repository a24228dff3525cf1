"""Static power to overhead and copper loss.

    Method 1   p = p0                          p0 the mean over poses
    Method 2   p = p0 + r |g(q)|^2             ordinary least squares over poses, g the gravity torque

Intervals are Student's, from the spread of the poses' mean powers about the line. Each pose counts once, however long
and however often it was held, since the meter's noise is not the only reason for a pose's distance from the line:
the model's error is the same in all repeats of a pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.effects import CopperLoss, Standby
from energy_opt.errors import BadInput
from energy_opt.measured import MeasuredSet
from energy_opt.measured.run import LONG
from energy_opt.measured.sets import moves_though_static
from energy_opt.numerics.signals import standstills
from energy_opt.power import PowerModel
from energy_opt.results import Found
from energy_opt.robot import PointMass, RigidBody

FEWEST_READINGS = 5  # least readings of a standstill, or as many as take `LONG` if the meter is slow
FEWEST = 3  # least poses for an interval by Method 2
# poses farther from the line than NOISY times the meter's noise have another reason, worth a word below this R^2
NOISY, CLEAR = 5.0, 0.99
SAME_POSE = 0.02  # [rad] poses that differ by less in every joint are one pose


@dataclass(frozen=True)
class Pose:
    """A pose held still: where, its mean power [W], its |gravity torque|^2 [(N m)^2], and how long [s].

    `noise`: standard error of the mean power by the spread of the readings, W.
    """

    file: str
    position: np.ndarray
    power: float
    load: float
    duration: float
    noise: float = 0.0


@dataclass(frozen=True, repr=False, eq=False)
class Identification(Found):
    """Results of both methods: `standby` [W] of Method 1, `line` of Method 2, `model_1()`, `model_2()`; by name, as
    `["poses"]`, the values of identify.json.

    Attributes:
        standby: overhead of Method 1, W; its 95 % interval `standby_ci95` (None for a single pose).
        line: Method 2 as {standby, r_over_kt2, ci95, r_squared}, or None where the poses do not determine it.
        word: the reason why Method 2 is refused, or a warning about it; otherwise empty. request: the request with
            version and command line, as in identify.json.
    """

    robot: str
    poses: tuple[Pose, ...]
    standby: float
    standby_ci95: tuple[float, float] | None
    line: dict[str, Any] | None
    word: str
    request: Mapping[str, Any] = field(default_factory=dict)
    answer = "identify.json"

    def model_1(self) -> PowerModel:
        """Method 1 as a model."""
        return PowerModel(self.robot, (Standby(power=self.standby),))

    def model_2(self) -> PowerModel | None:
        """Method 2 as a model, or None where it was refused."""
        if self.line is None:
            return None
        copper = CopperLoss(r_over_kt2=max(self.line["r_over_kt2"], 0.0))
        return PowerModel(self.robot, (Standby(power=max(self.line["standby"], 0.0)), copper))

    def document(self) -> dict[str, Any]:
        """The content of identify.json."""
        records = [{"file": p.file, "power": p.power, "gravity_torque_squared": p.load} for p in self.poses]
        return {
            "robot": self.robot,
            "method1": {"standby": self.standby, "ci95": self.standby_ci95},
            "method2": self.line,
            "remark": self.word,
            "poses": records,
            **({"request": dict(self.request)} if self.request else {}),
        }

    def kept(self, out: Path) -> Identification:
        """Write identify.json, the models of both methods, plot.png and report.html into the folder `out`."""
        from energy_opt.static_poses.identification_files import write  # plots are slow to import

        write(out, self.document(), {"model_method1": self.model_1(), "model_method2": self.model_2()})
        return self

    def __repr__(self) -> str:
        second = "" if self.line is None else f", R/Kt^2 {self.line['r_over_kt2']:.4g} W/(N m)^2"
        return f"Identification({self.robot!r}, {len(self.poses)} poses, overhead {self.standby:.2f} W{second})"

    def __str__(self) -> str:
        lines = [f"{len(self.poses)} poses", f"Method 1: overhead {self.standby:.2f} W"]
        if self.line is not None:
            (low, high), (least, most) = self.line["ci95"]["standby"], self.line["ci95"]["r_over_kt2"]
            lines.append(
                f"Method 2: overhead {self.line['standby']:.2f} W [{low:.2f}, {high:.2f}], "
                f"R/Kt^2 {self.line['r_over_kt2']:.4g} W/(N m)^2 [{least:.4g}, {most:.4g}], "
                f"R^2 = {self.line['r_squared']:.3f}"
            )
        return "\n".join([*lines, *([self.word] if self.word else [])])


def poses_of(measured: MeasuredSet, payload: PointMass | None = None, gravity: np.ndarray | None = None) -> list[Pose]:
    """The static poses of a set; if it has no static run, the standstills within motion runs.

    Args:
        payload: in the last joint's frame. gravity: (3,) [m/s^2] in the base frame (that of an upright base).

    Raises:
        BadInput: a run that is called static moves.
    """
    body = measured.robot.body
    static = [r for r in measured.runs if r.kind == "static" and len(r.power)]
    out = []
    for run in static:
        if said := moves_though_static(run, measured.robot):
            raise BadInput(f"{measured.path / run.file}: {said}")
        out.append(_pose(body, run.file, run.position, run.power, float(run.time[-1] - run.time[0]), payload, gravity))
    if static:
        return out
    for run in measured.runs:
        for first, last in standstills(run.time, run.position):
            begin = run.power_time - run.window
            inside = (begin >= run.time[first]) & (run.power_time <= run.time[last])
            held = float(np.ptp(run.power_time[inside]) + run.window[inside].max()) if inside.any() else 0.0
            if inside.sum() >= FEWEST_READINGS or (inside.sum() > 1 and held >= LONG):
                held = float(run.time[last] - run.time[first])
                records = run.position[first : last + 1]
                out.append(_pose(body, run.file, records, run.power[inside], held, payload, gravity))
    return out


def _pose(
    body: RigidBody, file: str, position: np.ndarray, power: np.ndarray, held: float, payload: PointMass | None,
    gravity: np.ndarray | None,
) -> Pose:  # fmt: skip
    """A static pose: the means of positions (N, n) and power (N,) [W].

    Args:
        held: [s] how long it is held. payload, gravity: as for `poses_of`.
    """
    q = position.mean(axis=0)
    rest = np.zeros((1, body.n))
    torque = body.torque(q[None], rest, rest, payload, gravity)[0]
    noise = float(power.std() / np.sqrt(len(power)))
    return Pose(file, q, float(power.mean()), float(torque @ torque), held, noise)


def identify(robot: str, poses: Sequence[Pose]) -> Identification:
    """Both methods on static poses.

    Raises:
        BadInput: there is no pose.
    """
    if not poses:
        raise BadInput('no static pose: the set needs runs of kind = "static", or motion runs that pause')
    from scipy.stats import linregress
    from scipy.stats import t as student

    own = _different(np.array([p.position for p in poses]))
    power, load = (np.array([x[at].mean() for at in own]) for x in np.array([(p.power, p.load) for p in poses]).T)
    count = len(own)
    mean = float(power.mean())
    interval = None
    if count > 1:
        half = float(student.ppf(0.975, count - 1) * power.std(ddof=1) / np.sqrt(count))
        interval = (mean - half, mean + half)

    def refused(why: str) -> Identification:
        return Identification(robot, tuple(poses), mean, interval, None, f"Method 2 refused: {why}")

    if count < FEWEST:
        return refused(f"{count} different pose(s); a fit with a confidence interval needs {FEWEST} or more")
    spread = float(np.std(load))
    if spread <= 1e-6 * max(float(load.mean()), 1e-12) or spread < 1e-3:
        return refused("all gravity torques are alike, so r_over_kt2 cannot be separated from overhead")
    if np.ptp(power) == 0:
        return refused(f"the power is {mean:g} W in every pose; is the meter connected?")
    fit = linregress(load, power)
    standby, r = float(fit.intercept), float(fit.slope)
    half = student.ppf(0.975, count - 2) * np.array([fit.intercept_stderr, fit.stderr])
    low, high = float(r - half[1]), float(r + half[1])
    off = float(np.sqrt(np.mean((power - standby - r * load) ** 2)))
    noise, missing = float(np.sqrt(np.mean([p.noise**2 for p in poses]))), ""
    if off > NOISY * noise > 0 and fit.rvalue**2 < CLEAR:
        missing = (
            f"the poses are {off:.2g} W from the line, {off / noise:.0f} times the meter's noise: is a payload "
            "(--payload) or a tilt of the base (--base) missing? Friction at rest, and joints whose r_over_kt2 differ, "
            "do this too"
        )
    if high <= 0:
        return refused(f"power falls with gravity torque (r_over_kt2 in [{low:.3g}, {high:.3g}])")
    if low <= 0:
        return refused(
            f"the poses do not vary enough: r_over_kt2 lies in [{low:.3g}, {high:.3g}] W/(N m)^2, "
            f"which holds 0; `energy-opt identify --suggest N` proposes better poses{'; ' * bool(missing)}{missing}"
        )
    ci95 = {"standby": [float(standby - half[0]), float(standby + half[0])], "r_over_kt2": [low, high]}
    line = {"standby": standby, "r_over_kt2": r, "ci95": ci95, "r_squared": float(fit.rvalue**2)}
    words = [f"{count} different poses; repeats of a pose count as one"] if count < len(poses) else []
    if half[1] >= 0.5 * r:
        why = "" if missing else ": the poses vary little"
        words.append(f"r_over_kt2 is known to {100 * half[1] / r:.0f} % only{why}")
    words += [missing] if missing else []
    if standby < 0:
        words.append(f"Method 2's overhead is below zero ({standby:.3g} ± {half[0]:.2g} W): its model file has 0 W")
    word = "; ".join(words)
    return Identification(robot, tuple(poses), mean, interval, line, word)


def _different(positions: np.ndarray) -> list[list[int]]:
    """The records of each different pose: one that differs by more than `SAME_POSE` in some joint from all before it.

    Args:
        positions: (N, n) [rad].
    """
    out: list[list[int]] = []
    for k, q in enumerate(positions):
        same = next((at for at in out if np.abs(q - positions[at[0]]).max() <= SAME_POSE), None)
        if same is None:
            out.append([k])
        else:
            same.append(k)
    return out
