"""A measured set as arrays: one `Run` for each run, joints in the robot's order, SI units.

One long recording is cut into runs where the arm rests. The meter's readings follow from a model's power over time:
means over windows, differences of counters, totals. A model is evaluated at `nodes(run)`, and `operator` gives the
readings that the meter would have shown:

    at = nodes(run)                          # (K,) s on the run's clock, evenly spaced
    expected = operator(run, at) @ power     # (M,) W beside run.power, (M, P) for slopes (K, P)

Power is assumed to be linear between nodes. So a reading over [b - w, b] is, exactly,

    1/w * sum over intervals [t_k, t_k+1] of the integral of p_k (t_k+1 - t)/h + p_k+1 (t - t_k)/h over their overlap,

which is a line of a sparse matrix. Other properties of the meter (delay, lag, gain) act on the power at the nodes,
before the mean.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from energy_opt.numerics.signals import standstills
from energy_opt.robot import PointMass, Robot

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

JOINT_SIGNALS = ("position", "velocity", "acceleration", "effort", "current", "temperature")


@dataclass(frozen=True)
class Run:
    """One run; time counts from the run's own zero. Joint samples (N) and meter readings (M) have stamps of their own.

    A reading is the mean of the power over the `window` that ends at its stamp, and the power at the stamp where that
    is 0. A counter's reading is the mean power since its reading before; a total is one reading over the whole run.
    `operator` takes a model's power to the readings.

    Attributes:
        file: its name in the log; pieces of a cut recording are called file#1, file#2, ...
        kind: "motion" or "static".
        start: set time of the run's time 0, s.
        time: (N,) s, increasing. position: (N, n) rad.
        velocity, acceleration, effort, temperature, current: (N, n) rad/s, rad/s^2, N m, degC, A, or None where not
            logged.
        power_time, power: (M,) s on the run's clock, and W.
        window: (M,) s, length of the interval before its stamp over which a reading is a mean; 0: the power at the
            stamp.
        meter: "power", "energy" (differences of a counter) or "total" (one reading).
        clock: "shared" with the joints, "stated" in log.toml, or "estimated" by correlation; an estimated clock is
            known to a fraction of a reading, so a delay that is found with it is no property of the meter.
        logged: further signals by name, at the joints' stamps, (N,): 0 and 1 of digital signals, or numbers.
        lines: (N,) lines of the file (its first is 1), where the run comes from one.
    """

    file: str
    kind: str
    start: float
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None
    acceleration: np.ndarray | None
    effort: np.ndarray | None
    temperature: np.ndarray | None
    power_time: np.ndarray
    power: np.ndarray
    current: np.ndarray | None = None
    window: np.ndarray = field(default_factory=lambda: np.zeros(0))
    meter: str = "power"
    clock: str = "shared"
    lines: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    logged: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.window) != len(self.power):
            object.__setattr__(self, "window", np.zeros(len(self.power)))

    def logged_at(self, samples: slice | np.ndarray) -> dict[str, np.ndarray]:
        """`logged`, (M,) each, at the joint samples `samples` (M,)."""
        return {name: values[samples] for name, values in self.logged.items()}

    def joint_signals(self) -> Iterator[tuple[str, np.ndarray]]:
        """Name and (N, n) values of every joint signal that is logged."""
        for name in JOINT_SIGNALS:
            values = getattr(self, name)
            if values is not None:
                yield name, values


@dataclass(frozen=True)
class MeasuredSet:
    """All runs of a set.

    `clock`: True if the log states every run's set time. `payload`: as stated by the recorder, if it is. `remarks`: on
    the reading: samples dropped, recordings cut, clocks found.
    """

    path: Path
    robot: Robot
    runs: tuple[Run, ...]
    clock: bool
    payload: PointMass | None = None
    remarks: tuple[str, ...] = ()


LONG = 1.5  # [s] a standstill of at least this duration becomes a static run
MARGIN = 0.15  # [s] of it that go to the motion before and after
FEW_READINGS = 4  # least meter readings of a piece
MOVES = 0.005  # [rad] a piece in which no joint moves further is static
FEWEST_SAMPLES = 8  # least joint samples of a piece beyond its first


def is_at_rest(time: np.ndarray, position: np.ndarray) -> bool:
    """Whether no joint moves further than `MOVES` over samples (N,), (N, n); noise of single samples is no motion."""
    wide = max(1, min(len(time), round(0.1 / max(float(np.median(np.diff(time))), 1e-9)))) if len(time) > 1 else 1
    sums = np.cumsum(np.vstack([np.zeros(position.shape[1]), position - position[0]]), axis=0)
    return bool(np.ptp((sums[wide:] - sums[:-wide]) / wide, axis=0).max() <= MOVES)


def cut_at_standstill(run: Run) -> list[Run]:
    """The pieces of a recording; long standstills become static runs, everything else motion runs.

    No piece is left with fewer readings of the meter than `FEW_READINGS`: a slow meter's recording is cut less often.
    """
    begin, end = run.power_time - run.window, run.power_time

    def enough(first: int, last: int, whole: bool = False) -> bool:
        below = int(np.searchsorted(begin if whole else end, run.time[first]))
        return not len(end) or int(np.searchsorted(end, run.time[last], side="right")) - below >= FEW_READINGS

    cuts: list[int] = [0]
    final = len(run.time) - 1
    margin = max(1, round(MARGIN / float(np.median(np.diff(run.time)))))
    for first, last in standstills(run.time, run.position):
        low, high, middle = first + margin, last - margin, (first + last) // 2
        if run.time[last] - run.time[first] >= LONG and enough(low, high, whole=True):
            if first > 0 and enough(cuts[-1], low):
                cuts.append(low)
            if last < final and enough(high, final):
                cuts.append(high)
        elif enough(cuts[-1], middle) and enough(middle, final):
            cuts.append(middle)
    cuts = sorted({*cuts, final})
    return pieces(run, [(a, b) for a, b in pairwise(cuts) if b - a >= FEWEST_SAMPLES])


def pieces(run: Run, spans: Sequence[tuple[int, int]], strict: bool = False) -> list[Run]:
    """Parts of a run between joint samples, with the readings of each.

    Every reading goes to one piece. A piece at rest takes the readings whose window lies in it. Each other reading goes
    to the piece with most of its window; the joint samples of this piece then reach back as far as the window.

    Args:
        run: the recording. spans: first and last joint sample of each piece. strict: leave out readings whose window
            lies in no piece, and keep the run's kind.
    """
    still = [is_at_rest(run.time[a : b + 1], run.position[a : b + 1]) for a, b in spans]
    end = run.power_time
    begin = np.maximum.accumulate(end - run.window) if len(end) else end
    most, owner = np.full(len(end), -np.inf), np.full(len(end), -1)
    for k, (a, b) in enumerate(spans):
        low, high = run.time[a], run.time[b]
        near = slice(int(np.searchsorted(end, low - 1e-9)), int(np.searchsorted(begin, high, side="right")))
        shared = np.minimum(end[near], high) - np.maximum(begin[near], low)
        whole = (begin[near] >= low - 1e-9) & (end[near] <= high + 1e-9)
        shared = np.where(whole | ((shared > 0) & (not strict and not still[k])), shared, -np.inf)
        better = shared > most[near]
        most[near], owner[near] = np.where(better, shared, most[near]), np.where(better, k, owner[near])
    by_owner = np.argsort(owner, kind="stable")
    edges = np.searchsorted(owner[by_owner], np.arange(len(spans) + 1))
    out: list[Run] = []
    for k, (a, b) in enumerate(spans):
        readings = by_owner[edges[k] : edges[k + 1]]
        if len(end) and not readings.size:
            continue
        if readings.size and not strict:
            a = min(a, max(0, int(np.searchsorted(run.time, begin[readings].min(), side="right")) - 1))
            b = max(b, min(len(run.time) - 1, int(np.searchsorted(run.time, end[readings[-1]], side="left"))))
        out.append(
            _piece(run, a, b, readings, (run.kind if strict else "static" if still[k] else "motion"), len(out) + 1)
        )
    return out


def _piece(run: Run, first: int, last: int, readings: np.ndarray, kind: str, number: int) -> Run:
    """The part of a run between two joint samples, with some readings; its time begins at 0."""
    samples = slice(first, last + 1)
    joints: dict[str, Any] = {name: values[samples] for name, values in run.joint_signals()}
    zero = float(run.time[first])
    return dataclasses.replace(
        run,
        file=f"{run.file}#{number}",
        kind=kind,
        start=run.start + zero,
        time=run.time[samples] - zero,
        lines=run.lines[samples],
        logged=run.logged_at(samples),
        power_time=run.power_time[readings] - zero,
        power=run.power[readings],
        window=run.window[readings],
        **joints,
    )


STEP = 0.02  # [s] between nodes; power of drives above 10 Hz hardly changes a mean over a window
FEWEST_NODES = 4  # least nodes in a window


def nodes(run: Run) -> np.ndarray:
    """Times (K,) [s] at which to evaluate a model of the run's power: the stamps, or an even grid under the windows."""
    if not len(run.power) or not run.window.any():
        return run.power_time
    first = max(float(np.min(run.power_time - run.window)), float(run.time[0]))
    last = min(float(run.power_time[-1]), float(run.time[-1]))
    step = min(STEP, float(run.window[run.window > 0].min()) / FEWEST_NODES)
    return np.linspace(first, last, max(2, int(np.ceil((last - first) / step)) + 1))


def operator(run: Run, at: np.ndarray) -> csr_matrix:
    """The matrix (M, K) from power at times `at` (K,) [s, increasing] to the run's readings.

    Each line sums to 1. With a, b the overlap of the window with [t_k, t_k+1], the share (b - a) / w is divided between
    both nodes by the overlap's middle. A window that reaches beyond `at` counts with its inner part; a stamp outside
    takes the nearest value.
    """
    from scipy.sparse import csr_matrix

    at = np.asarray(at, dtype=float)
    last = np.clip(run.power_time, at[0], at[-1])
    first = np.clip(run.power_time - run.window, at[0], at[-1])
    count = len(at)
    if count == 1:
        return csr_matrix(np.ones((len(last), 1)))
    at_once = last - first <= 1e-9
    low = np.clip(np.searchsorted(at, first, side="right") - 1, 0, count - 2)
    high = np.clip(np.searchsorted(at, last, side="left") - 1, low, count - 2)
    low = np.where(at_once, high, low)
    per_reading = high - low + 1
    row = np.repeat(np.arange(len(last)), per_reading)
    offset = np.arange(len(row)) - np.repeat(np.cumsum(per_reading) - per_reading, per_reading)
    k = low[row] + offset
    left, right = at[k], at[k + 1]
    a, b = np.maximum(first[row], left), np.minimum(last[row], right)
    length = np.where(at_once[row], 1.0, last[row] - first[row])
    middle = np.where(at_once[row], last[row], (a + b) / 2)
    share = np.where(at_once[row], 1.0, (b - a) / length)
    to_right = share * (middle - left) / (right - left)
    data = np.concatenate([share - to_right, to_right])
    return csr_matrix((data, (np.concatenate([row, row]), np.concatenate([k, k + 1]))), shape=(len(last), count))
