"""Drive constants, friction and rotor inertia from the joints' own readings, currents or torques.

    y_j = k_j (tau_j(q, v, a, d) + c_j sign(v_j) + b_j v_j + J_j a_j) + o_j + noise

y is current (then 1 / k is Kt, N m/A at the joint side) or torque (then k should be 1), d the links' deviations from
their URDF, o an offset. Joints with the same limits are assumed to have similar drives: the k of a joint that gravity
does not load is hardly visible, so its prior is centred at the others' k and as wide as these differ. The fit is
linear with a fixed k before d, and is repeated. Outliers have less weight (Huber), and so has correlated noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from energy_opt.diagnosis.hypothesis.links import USUAL_SPREAD, deviations_of
from energy_opt.diagnosis.hypothesis.terms import ROTOR
from energy_opt.measured import MeasuredSet, Run, choose_smoothing, coarse, kinematics
from energy_opt.power import PowerModel
from energy_opt.power.drive_law import body_of, rigid_torque
from energy_opt.robot import Robot

STEP = 0.03  # [s] between samples; the readings in between are averaged
MOST = 6000  # most samples in the fit
STILL, SLOWEST = 0.02, 0.004  # [rad/s] below this speed dry friction holds a joint; width of the smoothed sign
HELD = 0.15  # weight of a joint's sample at rest, where dry friction may carry any part of the load
HUBER = 1.5  # standard deviations from which a sample has less weight
OFFSET = 0.05  # usual offset of a reading, as a share of its value at the effort limit
TORQUES = 0.3  # prior standard deviation of k around 1 for logged torques that have another scale
TIMES = 3.0  # multiple from which neither a payload nor wrong links explain a logged torque
STRANGE = 0.5  # largest deviation of k from 1 at which logged values still count as torques
EXACT = 1e-4  # standard deviation of k if logged torques are used unscaled
SURE = 5.0  # standard deviations of k: from 0, to state torques in N m; from 1, to rescale logged torques
FEW = 20  # least samples in motion to estimate a joint's friction
TURNS = 4  # iterations of the fit, without and with the prior from drives of the same kind
KNOWN = 0.1  # relative standard deviation up to which a joint's readings determine its k
ALIKE = 0.1  # least relative spread of k among drives of the same kind
LONGEST = 60  # [samples] longest lag of the noise's autocorrelation


@dataclass(frozen=True)
class JointSamples:
    """Samples of all runs with joint readings: run (K,); per joint (K, n) v, a, torque, reading; torques (K, n, c) by
    the amounts of `Links`.
    """

    run: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    reading: np.ndarray
    torques: np.ndarray


@dataclass(frozen=True)
class JointSide:
    """Result of the joints' readings, per joint (n,); nan without information.

    Attributes:
        unit: of the readings, "A" or "N m". scale, scale_deviation: torque by reading, N m/A (Kt) or 1.
        values: (3, n) dry friction [N m], viscous friction [N m s/rad], rotor inertia [kg m^2].
        covariance: (3, n, n) of each across the joints. pair: (n,) covariance of the first two.
        usual: [rad/s] the median speed in motion.
        left: (K, n) residual of the readings [N m].
        multiple: reading by torque where the data alone show it, without a prior; else nan.
    """

    robot: Robot
    unit: str
    scale: np.ndarray
    scale_deviation: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    pair: np.ndarray
    usual: np.ndarray
    left: np.ndarray
    multiple: np.ndarray
    samples: JointSamples

    @property
    def known(self) -> np.ndarray:
        """(n,) True for joints whose friction is known in N m."""
        return np.isfinite(self.values[0])

    def friction(self, joint: int, speed: float) -> tuple[float, float]:
        """Dry and viscous friction [N m] of a joint at a speed [rad/s], and its standard deviation."""
        c, b = self.values[:2, joint]
        variance = self.covariance[0, joint, joint] + 2 * speed * self.pair[joint]
        return float(c + b * speed), float(max(variance + speed**2 * self.covariance[1, joint, joint], 0.0) ** 0.5)


def joint_side(measured: MeasuredSet, declared: PowerModel) -> JointSide | None:
    """Fit the joints' readings of a set: currents if any are logged, else torques; None where there are hardly any.

    The `declared` model gives payload, tilt and links for the rigid body's torque.
    """
    runs = [r for r in measured.runs if r.current is not None] or [r for r in measured.runs if r.effort is not None]
    if not runs or sum(len(r.time) for r in runs) < FEW:
        return None
    unit = "A" if runs[0].current is not None else "N m"
    samples = _joint_samples(measured, runs, declared)
    return _fit(samples, measured.robot, unit)


def _joint_samples(measured: MeasuredSet, runs: list[Run], declared: PowerModel) -> JointSamples:
    from scipy.integrate import cumulative_trapezoid

    smoothing = choose_smoothing(measured.runs)
    index = {id(r): k for k, r in enumerate(measured.runs)}
    total = sum(float(r.time[-1] - r.time[0]) for r in runs)
    step = max(STEP, total / MOST, float(np.median(np.concatenate([np.diff(r.time) for r in runs]))))
    of, parts = [], []
    for run in runs:
        count = max(2, int((run.time[-1] - run.time[0]) / step))
        edges = np.linspace(run.time[0], run.time[-1], count + 1)
        at = (edges[1:] + edges[:-1]) / 2
        k = kinematics(run, at, smoothing)
        logged = run.current if run.current is not None else run.effort
        assert logged is not None
        area = cumulative_trapezoid(logged, run.time, axis=0, initial=0)
        whole = np.column_stack([np.interp(edges, run.time, column) for column in area.T])
        moved = np.ptp(run.position, axis=0) > 2e-3
        mean = np.diff(whole, axis=0) / np.diff(edges)[:, None]
        parts.append((k.q, np.where(moved, k.v, 0.0), np.where(moved, k.a, 0.0), mean))
        of.append(np.full(count, index[id(run)]))
    q, v, a, reading = (np.concatenate(x) for x in zip(*parts, strict=True))
    body = measured.robot.body
    tau = rigid_torque(declared, body, q, v, a)
    torques = body_of(declared, body).link_regressor(q, v, a) @ deviations_of(body)
    return JointSamples(np.concatenate(of), v, a, tau, reading, torques)


def _fit(samples: JointSamples, robot: Robot, unit: str) -> JointSide:
    limits, n = robot.limits, robot.n
    s = np.tanh(samples.v / SLOWEST)
    used = [np.flatnonzero(np.isfinite(samples.reading[:, j])) for j in range(n)]
    still = np.abs(samples.v) < STILL
    trust, memory = np.where(still, HELD, 1.0), np.ones(n)
    noise = np.array([max(float(np.std(samples.reading[u, j])), 1e-6) for j, u in enumerate(used)])
    k, multiple = _slopes(samples), np.full(n, np.nan)
    middle, tight = np.zeros(n), np.full(n, 1e-12)
    size = 5 * n + samples.torques.shape[2]
    x, h = np.zeros(size), np.eye(size)
    residual = np.zeros_like(samples.reading)
    for turn in range(2 * TURNS):
        if turn == TURNS:  # each joint's own k is found: add the prior from drives of the same kind
            own = np.sqrt(np.diag(np.linalg.inv(h))[:n])
            multiple = np.where(own < KNOWN * np.abs(k), k, np.nan)
            if unit == "A":
                middle, tight = _kinds(k, own, np.column_stack([limits.effort, limits.velocity]), middle, tight)
            else:  # logged torques are used unscaled unless gravity clearly shows another scale
                plain = (np.abs(k - 1) <= STRANGE) | (np.abs(k - 1) < SURE * own)
                middle, tight = np.ones(n), np.where(plain, EXACT, TORQUES) ** -2.0
        by = np.maximum(np.abs(k), 1e-6) * limits.effort  # reading at the effort limit
        usual = np.column_stack([by / 3, by / 3, 3 * ROTOR * by, OFFSET * by])
        h = np.diag(np.concatenate([tight, usual.ravel() ** -2.0, np.full(size - 5 * n, USUAL_SPREAD**-2)]))
        right = np.concatenate([tight * middle, np.zeros(size - n)])
        for j, u in enumerate(used):
            columns = np.zeros((len(u), size))
            columns[:, j] = samples.tau[u, j]
            at = n + 4 * j
            columns[:, at : at + 4] = np.column_stack([s[u, j], samples.v[u, j], samples.a[u, j], np.ones(len(u))])
            columns[:, 5 * n :] = k[j] * samples.torques[u, j]
            weight = np.sqrt(trust[u, j] / memory[j]) / noise[j]
            columns *= weight[:, None]
            h += columns.T @ columns
            right += columns.T @ (samples.reading[u, j] * weight)
        x = np.linalg.solve(h, right)
        k, laws = x[:n], x[n : 5 * n].reshape(n, 4)
        rigid = k * (samples.tau + samples.torques @ x[5 * n :])
        friction = laws[:, 0] * s + laws[:, 1] * samples.v
        residual = samples.reading - rigid - friction - laws[:, 2] * samples.a - laws[:, 3]
        for j, u in enumerate(used):
            live = u[~still[u, j]] if (~still[u, j]).sum() >= FEW else u
            r = residual[:, j]
            noise[j] = max(1.4826 * float(np.median(np.abs(r[live]))), 1e-9)
            trust[:, j] = np.where(still[:, j], HELD, 1.0) * np.minimum(1.0, HUBER * noise[j] / np.abs(r).clip(1e-12))
            memory[j] = _memory(samples.run[u], r[u])
    return _side(samples, robot, unit, x, np.linalg.inv(h), residual, used, multiple)


def _slopes(samples: JointSamples) -> np.ndarray:
    """Initial k of every joint (n,): regression of its reading on the rigid torque."""
    tau = samples.tau - samples.tau.mean(axis=0)
    reading = np.nan_to_num(samples.reading)
    return np.asarray(np.sum(tau * reading, axis=0) / np.maximum(np.sum(tau**2, axis=0), 1e-9))


def _kinds(
    k: np.ndarray, deviation: np.ndarray, limits: np.ndarray, middle: np.ndarray, flat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Prior mean and precision (n,) of each joint's k, from other joints with the same limits (n, 2)."""
    middle, tight = middle.copy(), flat.copy()
    known = deviation < KNOWN * np.abs(k)
    for j in range(len(k)):
        like = np.flatnonzero(known & (limits == limits[j]).all(axis=1) & (np.arange(len(k)) != j))
        if like.size:
            middle[j] = float(np.average(k[like], weights=deviation[like] ** -2.0))
            others = np.append(k[like], k[j]) if known[j] else k[like]
            tight[j] = max(ALIKE * abs(middle[j]), float(np.std(others))) ** -2.0
    return middle, tight


def _memory(run: np.ndarray, r: np.ndarray) -> float:
    """Number of samples worth one independent sample: 1 + 2 times the sum of the noise's autocorrelations."""
    r = r - np.median(r)
    spread = 1.4826 * float(np.median(np.abs(r)))
    r = np.clip(r, -3 * spread, 3 * spread)
    whole, total = float(r @ r), 1.0
    if whole <= 0:
        return 1.0
    for lag in range(1, min(LONGEST, len(r) // 3)):
        same = run[lag:] == run[:-lag]
        value = float(np.sum(r[lag:][same] * r[:-lag][same])) / whole
        if value <= 0.02:
            break
        total += 2 * value
    return total


def _side(
    samples: JointSamples, robot: Robot, unit: str, x: np.ndarray, spread: np.ndarray, residual: np.ndarray,
    used: list[np.ndarray], multiple: np.ndarray,
) -> JointSide:  # fmt: skip
    """Values in N m with their covariance: c = beta / k, to first order."""
    n = len(used)
    k, deviation = x[:n], np.sqrt(np.diag(spread)[:n])
    sure = np.abs(k) > SURE * deviation
    values, covariance, usual = np.full((3, n), np.nan), np.full((3, n, n), np.nan), np.full(n, np.nan)
    slopes = np.zeros((3, n, len(x)))
    for j, u in enumerate(used):
        live = np.abs(samples.v[u, j]) > STILL
        if not sure[j] or live.sum() < FEW:
            continue
        usual[j] = float(np.median(np.abs(samples.v[u, j][live])))
        own = x[n + 4 * j : n + 4 * j + 3]
        values[:, j] = own / k[j]
        for p in range(3):
            slopes[p, j, n + 4 * j + p] = 1 / k[j]
            slopes[p, j, j] = -own[p] / k[j] ** 2
    known = np.isfinite(values[0])
    for p in range(3):
        covariance[p][np.ix_(known, known)] = (slopes[p] @ spread @ slopes[p].T)[np.ix_(known, known)]
    pair = np.where(known, np.einsum("jx,xy,jy->j", slopes[0], spread, slopes[1]), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        return JointSide(
            robot, unit, np.where(sure, 1 / k, np.nan), np.where(sure, deviation / k**2, np.nan), values, covariance,
            pair, usual, np.where(sure, residual / k, np.nan), multiple, samples,
        )  # fmt: skip


LASTS = 0.3  # [s] window over which contact torque is averaged
PUSH = 0.1  # share of a joint's effort limit above which unexplained torque is contact; links off by 10 % cause 0.06
BEYOND = 4.0  # multiple of the usual residual that contact torque must exceed
# negative friction is contact beyond this share of the effort limit (half of usual dry friction), by this many standard
# deviations
LED, SURELY = 0.01, 5.0
ENOUGH = 0.3  # least share of the runs in motion without contact for a diagnosis


@dataclass(frozen=True)
class Push:
    """The strongest external contact of a run: its index, file, joint and torque [N m]."""

    run: int
    file: str
    joint: str
    torque: float


def pushes(side: JointSide, measured: MeasuredSet) -> list[Push]:
    """One entry for every run with external contact; none if samples are too far apart to tell inertia from contact."""
    if any(coarse(run) for run in measured.runs):
        return []
    limits, joints = measured.robot.limits, measured.robot.joints
    led = _led(side)
    if led is not None:
        j, torque = led
        moving = [k for k in np.unique(side.samples.run) if measured.runs[k].kind == "motion"]
        return [Push(int(k), measured.runs[k].file, joints[j], torque) for k in moving]
    excess = side.left.copy()
    carried = np.abs(np.nan_to_num(side.values[0]))
    still = np.abs(side.samples.v) < STILL
    excess = np.where(still, np.sign(excess) * np.maximum(np.abs(excess) - 1.5 * carried, 0.0), excess)
    excess = np.nan_to_num(excess)
    step = _step(side, measured)
    width = max(1, round(LASTS / step))
    slow = {int(r): _means(excess[side.samples.run == r], width) for r in np.unique(side.samples.run)}
    usual = 1.4826 * np.median(np.abs(np.concatenate(list(slow.values()))), axis=0)
    least = np.minimum(np.maximum(PUSH * limits.effort, BEYOND * usual), 2 * PUSH * limits.effort)
    out = []
    for r, own in slow.items():
        share = np.abs(own).max(axis=0) / least
        j = int(np.argmax(share))
        if share[j] > 1:
            out.append(Push(r, measured.runs[r].file, joints[j], float(np.abs(own[:, j]).max())))
    return out


def _led(side: JointSide) -> tuple[int, float] | None:
    """A joint whose fitted friction is negative, and by how much [N m]: a hand that guides the arm causes this."""
    for j in np.flatnonzero(side.known):
        friction, deviation = side.friction(int(j), float(side.usual[j]))
        if friction + SURELY * deviation < -LED * side.robot.limits.effort[j]:
            return int(j), -friction
    return None


def _step(side: JointSide, measured: MeasuredSet) -> float:
    runs, counts = np.unique(side.samples.run, return_counts=True)
    return float(np.median([np.ptp(measured.runs[r].time) / k for r, k in zip(runs, counts, strict=True)]))


def _means(x: np.ndarray, width: int) -> np.ndarray:
    """Means (K', n) over `width` samples, or over all if there are fewer."""
    windows = np.lib.stride_tricks.sliding_window_view(x, min(width, len(x)), axis=0)
    return np.asarray(windows.mean(axis=2))


def free_runs(measured: MeasuredSet, found: list[Push]) -> tuple[MeasuredSet, bool]:
    """The set without the runs with external contact and True, or the whole set and False if too few runs are left."""
    excluded = {p.run for p in found}
    moving = [k for k, r in enumerate(measured.runs) if r.kind == "motion"]
    left = [k for k in moving if k not in excluded]
    if not excluded:
        return measured, True
    if len(left) < max(2, ENOUGH * len(moving)):
        return measured, False
    return replace(measured, runs=tuple(r for k, r in enumerate(measured.runs) if k not in excluded)), True


def push_words(found: list[Push], enough: bool) -> list[str]:
    """Remarks on external contacts; `enough`: whether enough runs are left without them, by `free_runs`."""
    if not found:
        return []
    worst = max(found, key=lambda p: p.torque)
    what = f"{worst.torque:.3g} N m on {worst.joint} in {worst.file}"
    begin = f"Something outside pushed the arm in {len(found)} run(s): torque without power (up to {what})"
    if enough:
        return [f"{begin}: left out are {', '.join(p.file for p in found)}."]
    return [f"{begin}: no cause can be claimed from such a set. Record it without any contact with the arm."]
