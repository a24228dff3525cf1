"""Measured runs as one table: nodes at which models are evaluated, and the meter readings computed from them.

What depends on the motion alone is computed once and cached here: rigid torque, its derivatives by inertial parameters
and gravity, time since the last motion. Hundreds of candidate models are then evaluated on the same table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from energy_opt.power.motions import dwells, idle_time
from energy_opt.robot import RigidBody

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

PIECE = 8192  # nodes processed at once where each needs kilobytes of memory


@dataclass(frozen=True)
class Samples:
    """K nodes and M readings of R runs, run after run; with a fast meter without windows they are the same instants.

    Attributes:
        q, v, a: (K, n) rad, rad/s, rad/s^2 at the nodes. t: (K,) set time, s. slices: where each run's nodes lie.
        temperature: (K, n) degC or nan.
        at: (M,) set time of the readings, s. power: (M,) W. parts: where each run's readings lie.
        operators: matrix from nodes to readings of each run, None if both are the same.
        counts: number of meter readings averaged in one of these.
        weight: (M,) weight of each reading, 1 is full weight, see `weighted`.
        noise: standard deviation of a reading's white noise, W. floor: of a single reading of the meter, W.
        files, kinds: of the runs.
        single: set time and power of every single reading of the meter, run by run.
        logged: (K,) values by name of further signals that every run has and that change somewhere.
        group: how many neighbouring readings were averaged to one, 1 in all but long sets.
        blur: (K, 2 n) standard deviations of v and a by errors of the logged positions or velocities.
        jumps: (K, 2 n) errors of v and a beside jumps of the acceleration, see `Kinematics`; none where it is empty.
        periods: (R,) [s] of the smoothing of each run: jumps closer together have one error.
        lag: [s] time uncertainty of the motion by sampling, quantisation and smoothing of the positions.
        resolution: step [W] to which the meter rounds; 0 if none is seen.
        allowed: (M,) [W^2] variance of single readings by these errors and by clocks, see `weighted`.
        doubted: (M,) True for readings beside starts, ends and steps, whose exact times the positions do not show.
        averaged: True if the window over which the meter averages is known.
        elsewhere: times (H,) [s] and rigid torque (H, n) [N m] of the set's other runs, in which windings get warm.
    """

    body: RigidBody
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    t: np.ndarray
    slices: tuple[slice, ...]
    temperature: np.ndarray
    at: np.ndarray
    power: np.ndarray
    parts: tuple[slice, ...]
    operators: tuple[csr_matrix | None, ...]
    counts: tuple[int, ...]
    weight: np.ndarray
    noise: float
    floor: float
    files: tuple[str, ...]
    kinds: tuple[str, ...]
    single: tuple[tuple[np.ndarray, np.ndarray], ...]
    group: int = 1
    logged: Mapping[str, np.ndarray] = field(default_factory=dict)
    blur: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    jumps: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    periods: tuple[float, ...] = ()
    lag: float = 0.0
    resolution: float = 0.0
    allowed: np.ndarray = field(default_factory=lambda: np.zeros(0))
    doubted: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    averaged: bool = False
    elsewhere: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    def part(self, runs: Sequence[int]) -> Samples:
        """The given runs only; what depends on the whole set, as temperatures relative to it, stays as it is."""
        samples = np.concatenate([np.arange(self.slices[r].start, self.slices[r].stop) for r in runs])
        read = np.concatenate([np.arange(self.parts[r].start, self.parts[r].stop) for r in runs])
        others = np.setdiff1d(np.arange(len(self.t)), samples)
        out = replace(
            self, q=self.q[samples], v=self.v[samples], a=self.a[samples], t=self.t[samples],
            temperature=self.temperature[samples], slices=laid([self.slices[r] for r in runs]), at=self.at[read],
            power=self.power[read], weight=self.weight[read], parts=laid([self.parts[r] for r in runs]),
            operators=tuple(self.operators[r] for r in runs), counts=tuple(self.counts[r] for r in runs),
            files=tuple(self.files[r] for r in runs), kinds=tuple(self.kinds[r] for r in runs),
            single=tuple(self.single[r] for r in runs), logged={k: x[samples] for k, x in self.logged.items()},
            blur=self.blur[samples] if len(self.blur) else self.blur,
            jumps=self.jumps[samples] if len(self.jumps) else self.jumps,
            periods=tuple(self.periods[r] for r in runs) if self.periods else (),
            allowed=self.allowed[read] if len(self.allowed) else self.allowed,
            doubted=self.doubted[read] if len(self.doubted) else self.doubted,
            elsewhere=(self.t[others], self.gravity_torque[others] @ self.body.gravity + self.free_torque[others]),
        )  # fmt: skip
        at_once = ("regressors",) if len(self.q) <= PIECE else ()
        for name in ("free_torque", "gravity_torque", "warmth", "idle", "dwell", *at_once):
            out.__dict__[name] = getattr(self, name)[samples]
        return out

    def reread(self, **readings: Any) -> Samples:
        """The same motions with other readings."""
        out = replace(self, **readings)
        kept = ("free_torque", "gravity_torque", "regressors", "last_regressors", "warmth", "idle", "dwell")
        out.__dict__.update({name: self.__dict__[name] for name in kept if name in self.__dict__})
        return out

    def at_nodes(self) -> Samples:
        """The same motions with a zero reading at each node, as if the set had no other runs."""
        count = len(self.slices)
        return self.reread(
            at=self.t, power=np.zeros(len(self.t)), parts=self.slices, operators=(None,) * count,
            counts=(1,) * count, weight=np.ones(len(self.t)), allowed=np.zeros(0),
            doubted=np.zeros(0, dtype=bool), elsewhere=None,
        )  # fmt: skip

    def shown(self, x: np.ndarray) -> np.ndarray:
        """Map values at the nodes (K, ...) to readings (M, ...): means over windows and bins."""
        if all(op is None for op in self.operators) and all(count == 1 for count in self.counts):
            return x
        out = np.empty((len(self.power), *x.shape[1:]))
        for samples, part, op, count in zip(self.slices, self.parts, self.operators, self.counts, strict=True):
            if op is not None:
                own = x[samples]
                out[part] = (op @ own.reshape(len(own), -1)).reshape(len(out[part]), *x.shape[1:])
            else:
                out[part] = _bin_mean(x[samples], count)
        return out

    @cached_property
    def shifted(self) -> Samples:
        """The same samples with the errors beside jumps of the acceleration added to v and a; joints at rest stay."""
        v, a = np.split(np.where(np.tile(self.v, 2) != 0, self.jumps, 0.0), 2, axis=1)
        out = replace(self, v=self.v + v, a=self.a + a)
        kept = ("gravity_torque", "warmth", "idle", "dwell")
        out.__dict__.update({name: getattr(self, name) for name in kept})
        return out

    @cached_property
    def step(self) -> float:
        """Median time [s] between readings of a run; median duration of a run if each run has one reading."""
        apart = np.concatenate([np.diff(self.at[part]) for part in self.parts])
        return float(np.median(apart if apart.size else [np.ptp(self.t[samples]) for samples in self.slices]))

    @cached_property
    def moving(self) -> np.ndarray:
        """(M,) True for readings during which a joint moves."""
        return np.asarray(self.shown((self.v != 0).any(axis=1).astype(float)) > 1e-6)

    @cached_property
    def unit(self) -> np.ndarray:
        """Unit (n,) of each joint's position: 1 rad; for joints that slide half the widest motion of one [m]."""
        slides = np.array(self.body.slides)
        spans = np.ptp(self.q[:, slides & (self.v != 0).any(axis=0)], axis=0)
        return np.where(slides, float(spans.max(initial=0.0)) / 2 or 1.0, 1.0)

    @cached_property
    def warmth(self) -> np.ndarray:
        """Temperature rise of each joint relative to its largest rise (K, n) [1]; nan if none of 0.5 K is logged."""
        first = self.temperature[np.argmin(self.t)]
        rise = np.max(self.temperature, axis=0) - first
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(rise > 0.5, (self.temperature - first) / rise, np.nan * self.temperature * 0))

    @cached_property
    def idle(self) -> np.ndarray:
        """Time [s] since the last motion of the run ended (K,); negative while moving and before."""
        return np.concatenate([idle_time(self.t[samples], self.v[samples]) for samples in self.slices])

    @cached_property
    def dwell(self) -> np.ndarray:
        """Number of standstills between motions so far in the run (K,); each counts from its middle."""
        return np.concatenate([dwells(self.t[samples], self.v[samples]) for samples in self.slices])

    @cached_property
    def run(self) -> np.ndarray:
        """Index of each node's run (K,)."""
        return np.repeat(np.arange(len(self.slices)), [s.stop - s.start for s in self.slices])

    @cached_property
    def free_torque(self) -> np.ndarray:
        """Rigid torque without gravity and payload, (K, n) N m."""
        return self.body.torque(self.q, self.v, self.a, None, np.zeros(3))

    @cached_property
    def gravity_torque(self) -> np.ndarray:
        """d tau / d gravity of the bare arm, (K, n, 3)."""
        rest = np.zeros_like(self.v)
        return np.stack([self.body.torque(self.q, rest, rest, None, unit) for unit in np.eye(3)], axis=2)

    @cached_property
    def rigid(self) -> dict[Any, tuple[np.ndarray, np.ndarray]]:
        """Cache of the rigid-body torques computed last, see `rigid_torque`."""
        return {}

    @cached_property
    def nominal_links(self) -> np.ndarray:
        """Mass, centre of mass and inertia (13 n,) of the URDF's links that have a joint of their own, link by link."""
        return np.concatenate([[x.mass, *x.lever, *x.inertia.T.ravel()] for x in self.body.plain.own_links()])

    @cached_property
    def regressors(self) -> np.ndarray:
        """d tau / d (inertial parameters of links) (K, n, 10 L), under the robot's own gravity."""
        return self.body.link_regressor(self.q, self.v, self.a)

    @cached_property
    def last_regressors(self) -> np.ndarray:
        """The same for the last link alone, which carries the payload, and for unit gravity x, y, z (K, n, 10, 4)."""
        last, out = slice(10 * self.body.last, 10 * self.body.last + 10), []
        for x in pieces(len(self.q), PIECE):
            own, by_gravity = self._by_links(x, True)
            out.append(np.concatenate([own[:, :, last, None], by_gravity[:, :, last]], axis=3))
        return np.concatenate(out)

    def _by_links(self, x: slice, tilted: bool) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by all links' parameters at some nodes, as in `by_links`."""
        q, v, a = self.q[x], self.v[x], self.a[x]
        own = self.regressors if len(self.q) <= PIECE else self.body.link_regressor(q, v, a)
        if not tilted:
            return own, np.zeros((*own.shape, 0))
        still = np.zeros_like(v)
        return own, np.stack([self.body.link_regressor(q, still, still, unit) for unit in np.eye(3)], axis=3)

    def by_links(self, live: np.ndarray, tilted: bool) -> Iterator[tuple[slice, slice, np.ndarray, np.ndarray]]:
        """Yield slices of nodes, a slice of inertial parameters that contains the indices `live`, and the derivatives
        of torque by these: under the robot's own gravity (k, n, p), and if `tilted` for unit gravity (k, n, p, 3).

        Those of all links are cached if they are not too large (a million samples at 1 kHz have some GB), those of the
        last link always; others are computed again.
        """
        first = 10 * self.body.last
        if live.min() >= first and live.max() < first + 10:
            own = self.last_regressors
            yield slice(0, len(self.q)), slice(first, first + 10), own[..., 0], own[..., 1:]
            return
        for x in pieces(len(self.q), PIECE):
            yield x, slice(None), *self._by_links(x, tilted)

    def deviating(self, basis: np.ndarray) -> np.ndarray:
        """Torque (K, n, c) per amount of the link deviations `basis` (10 L, c), under the robot's own gravity."""
        return np.concatenate([times(self._by_links(x, False)[0], basis) for x in pieces(len(self.q), PIECE)])


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a (k, n, p) times a matrix b (p, c) as one product of matrices, which is faster than k small ones."""
    return (a.reshape(-1, a.shape[2]) @ b).reshape(*a.shape[:2], -1)


def pieces(count: int, most: int) -> list[slice]:
    """Slices of at most `most` entries that cover `count` entries."""
    return [slice(first, min(first + most, count)) for first in range(0, count, most)]


def laid(parts: Sequence[slice]) -> tuple[slice, ...]:
    """Slices of the same lengths, one after the other."""
    ends = np.cumsum([0, *(p.stop - p.start for p in parts)])
    return tuple(slice(int(x), int(y)) for x, y in zip(ends[:-1], ends[1:], strict=True))


def _bin_mean(x: np.ndarray, count: int) -> np.ndarray:
    """The mean of `count` even readings in a bin of width h from the values at the bins' middles.

    x + x'' (h^2 - (h / count)^2) / 24, with second differences in place of x'' h^2.
    """
    if count == 1:
        return x
    out = x.copy()
    out[1:-1] += (x[2:] - 2 * x[1:-1] + x[:-2]) * (1 - 1 / count**2) / 24
    return out
