"""The likeliest numbers of a hypothesis.

A hypothesis is a set of effects with numbers z and of free functions with weights w. Every hypothesis also contains
links that deviate from their URDF (amounts d), and a level that differs from run to run (o). With the noise made white,

    phi = 1/2 |y - f(z, d, o) - F w|^2 + 1/2 (theta - mean)^T precision (theta - mean),    theta = (z, w, d, o)

is minimised by Gauss-Newton steps within bounds. Laplace's integral of exp(-phi) over theta is the evidence (see
`evidence`). It grows with the fit, and falls with every number that the data had to determine.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from energy_opt.diagnosis.data.clusters import shared_functions
from energy_opt.diagnosis.data.noise import Noise, Shared, Whitener
from energy_opt.diagnosis.data.predict import Prediction, predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.hypothesis.links import Links
from energy_opt.diagnosis.hypothesis.terms import Chart, Scale
from energy_opt.numerics.box import bounded_step
from energy_opt.power import PowerModel

ITERATIONS = 12
ENOUGH = 0.05  # the fit ends if a step lowers phi by less
DRIFTS = 150.0  # [s] correlation time of a meter's drift
MOST_HELD = 400e6  # [bytes] most memory for cached predictions and Jacobians


@dataclass(frozen=True)
class Nuisance:
    """Prior widths of nuisances: `spread` of links [1], `offset` from run to run [W], slow `drift` over the set [W].

    `over`: correlation time of the drift [s]. `smooth`: True for a smooth drift, as by the meter's temperature; False
    for a random walk. Either way all runs share a level error: a meter may be off from the start.
    """

    spread: float
    offset: float
    drift: float = 0.01
    over: float = DRIFTS
    smooth: bool = False

    def levels(self, times: np.ndarray) -> np.ndarray:
        """Covariance (R, R) [W^2] of the levels of runs at `times`."""
        apart = np.abs(np.subtract.outer(times, times)) / self.over
        slow = np.exp(-(apart**2)) if self.smooth else np.exp(-apart)
        return np.asarray(self.offset**2 * np.eye(len(times)) + self.drift**2 * slow)


@dataclass(frozen=True)
class Free:
    """A free function: columns (M, c) [W per unit weight], weights ~ N(0, size^2)."""

    signal: str
    columns: np.ndarray
    size: float


class Recent:
    """Cache of predictions and Jacobians of recent fits, up to `MOST_HELD` bytes; others are computed again."""

    def __init__(self) -> None:
        self._held: OrderedDict[int, tuple[Prediction, np.ndarray]] = OrderedDict()
        self._size = 0

    def get(self, token: int) -> tuple[Prediction, np.ndarray] | None:
        """Prediction and Jacobian of a fit, None if no longer cached."""
        if token in self._held:
            self._held.move_to_end(token)
        return self._held.get(token)

    def put(self, token: int, value: tuple[Prediction, np.ndarray]) -> None:
        """Keep prediction and Jacobian (`value`) of the fit with this token, and drop the oldest."""
        self._held[token] = value
        self._size += _bytes(value)
        while self._size > MOST_HELD and len(self._held) > 1:
            self._size -= _bytes(self._held.popitem(last=False)[1])


def _bytes(value: tuple[Prediction, np.ndarray]) -> int:
    return sum(x.nbytes for x in (*vars(value[0]).values(), value[1]))


class Stopped(Exception):
    """A stop was requested; the search holds the fits so far."""


@dataclass(frozen=True)
class World:
    """Data and settings that all hypotheses share."""

    samples: Samples
    declared: PowerModel
    scale: Scale
    links: Links
    whiten: Whitener
    offsets: np.ndarray = field(repr=False)  # (M, R) 1 at the readings of run r
    shared: Shared = field(repr=False)
    given: tuple[str, ...] = ()  # effects of the declared model that are free in every hypothesis and not reported
    stopped: Callable[[], bool] = lambda: False  # called before each fit; True requests a stop
    recent: Recent = field(default_factory=Recent, repr=False)
    priors: dict[Nuisance, np.ndarray] = field(default_factory=dict, repr=False)  # those of `before`

    def go_on(self) -> None:
        """Raise `Stopped` if a stop was requested."""
        if self.stopped():
            raise Stopped

    @classmethod
    def of(cls, samples: Samples, declared: PowerModel, scale: Scale, links: Links, noise: Noise) -> World:
        """The samples with what all fits share: levels of runs, model errors of repeated motions, and the noise.

        Args:
            scale: usual sizes for priors. links: directions of link deviations at these samples.
        """
        offsets = np.zeros((len(samples.power), len(samples.parts)))
        for r, part in enumerate(samples.parts):
            offsets[part, r] = 1.0
        shared = shared_functions(samples)
        return cls(samples, declared, scale, links, whitener(samples, noise, shared), offsets, shared)

    def before(self, nuisance: Nuisance) -> np.ndarray:
        """Prior precision (c, c) of link amounts and run levels; computed once for each nuisance."""
        from scipy.linalg import block_diag

        if nuisance not in self.priors:
            times = np.array([self.samples.at[p].mean() for p in self.samples.parts])
            links = nuisance.spread**-2 * np.eye(self.links.basis.shape[1])
            self.priors[nuisance] = block_diag(links, np.linalg.inv(nuisance.levels(times)))
        return self.priors[nuisance]

    def under(self, noise: Noise) -> World:
        """The same data under another noise."""
        return replace(self, whiten=whitener(self.samples, noise, self.shared))


def whitener(samples: Samples, noise: Noise, shared: Shared) -> Whitener:
    """The map that makes a noise white on these readings; `shared`: functions that repeats of a motion share."""
    return Whitener(noise, [samples.at[p] for p in samples.parts], samples.weight, shared)


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        charts, numbers: of its effects. free, weights: of its free functions. amounts, levels: of links and runs.
        model: the declared model with the effects' values. residual: (M,) what remains, W, levels and free functions
            taken out. mean, precision: of theta's prior. hessian: of phi.
        token: number of the fit, by which results on it are cached. spread: (P, P) covariance of theta if not the
            inverse of `hessian`.
    """

    world: World
    nuisance: Nuisance
    charts: tuple[Chart, ...]
    numbers: tuple[np.ndarray, ...]
    free: tuple[Free, ...]
    weights: np.ndarray
    amounts: np.ndarray
    levels: np.ndarray
    model: PowerModel
    residual: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    hessian: np.ndarray
    token: int = field(default_factory=count().__next__)
    spread: np.ndarray | None = None

    @property
    def prediction(self) -> Prediction:
        """Readings predicted by the model with its link deviations."""
        return self._linearised()[0]

    @property
    def jacobian(self) -> np.ndarray:
        """Whitened derivatives (M, P) of the readings by theta."""
        return self._linearised()[1]

    def _linearised(self) -> tuple[Prediction, np.ndarray]:
        held = self.world.recent.get(self.token)
        if held is None:
            _, p, _, white = linearised(self.world, self.charts, columns_of(self.world, self.free), self.theta)
            held = p, white[:, 1:]
            self.world.recent.put(self.token, held)
        return held

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, in order."""
        return tuple(c.term.name for c in self.charts)

    @property
    def theta(self) -> np.ndarray:
        """All fitted numbers (P,): of the effects, of free functions, of links, of levels."""
        return np.concatenate([*self.numbers, self.weights, self.amounts, self.levels])

    @property
    def places(self) -> list[slice]:
        """Where the numbers of each effect are in theta."""
        ends = np.cumsum([0, *map(len, self.numbers)]).tolist()
        return list(map(slice, ends, ends[1:]))

    @property
    def covariance(self) -> np.ndarray:
        """Posterior covariance (P, P) of theta."""
        return np.linalg.inv(self.hessian) if self.spread is None else self.spread

    @property
    def deviations(self) -> list[np.ndarray]:
        """Posterior standard deviations (P,) of every effect's values, ordered as in `Chart.values`."""
        spread, out = self.covariance, []
        for c, z, part in zip(self.charts, self.numbers, self.places, strict=True):
            slope = c.slope(z)
            out.append(np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", slope, spread[part, part], slope), 0.0)))
        return out

    @property
    def link_covariance(self) -> np.ndarray:
        """Posterior covariance (c, c) of the link amounts."""
        end = len(self.theta) - len(self.levels)
        return self.covariance[end - len(self.amounts) : end, end - len(self.amounts) : end]

    @property
    def level_deviations(self) -> np.ndarray:
        """Posterior standard deviations (R,) [W] of the runs' levels."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[len(self.theta) - len(self.levels) :], 0.0))

    @property
    def count(self) -> int:
        """Number of fitted numbers of the effects."""
        return sum(len(z) for z in self.numbers)

    def full_model(self, links: bool = True) -> PowerModel:
        """The model, with its link deviations if `links` is True."""
        if not links or not np.any(self.amounts):
            return self.model
        return self.model.replaced(self.world.links.effect(self.amounts, self.world.samples))


def fit(
    world: World, nuisance: Nuisance, charts: Sequence[Chart], starts: Sequence[np.ndarray],
    free: Sequence[Free] = (), amounts: np.ndarray | None = None, iterations: int = ITERATIONS,
) -> Fit:  # fmt: skip
    """Fit a hypothesis from `starts` (z of each chart), and `amounts` of links (None: zero).

    With no `iterations` of Gauss-Newton's method, it is only linearised there. Other numbers start at zero.
    """
    mean, precision, low, high = _before(world, nuisance, charts, free)
    drawn = columns_of(world, free)
    if amounts is None:
        amounts = np.zeros(world.links.basis.shape[1])
    theta = np.concatenate([*starts, np.zeros(drawn.shape[1]), amounts, np.zeros(len(world.samples.parts))])
    theta = np.clip(theta, low, high)

    def state(theta: np.ndarray) -> tuple[PowerModel, Prediction, np.ndarray, np.ndarray, float]:
        model, p, residual, white = linearised(world, charts, drawn, theta)
        off = theta - mean
        phi = 0.5 * float(white[:, 0] @ white[:, 0]) + 0.5 * float(off @ precision @ off)
        return model, p, residual, white, phi

    model, p, residual, white, phi = state(theta)
    for _ in range(iterations):  # full steps first; shorter ones where a full one does not lower phi
        jacobian, r = white[:, 1:], white[:, 0]
        hessian = jacobian.T @ jacobian + precision
        step = bounded_step(hessian, jacobian.T @ r - precision @ (theta - mean), low - theta, high - theta)
        for share in (1.0, 0.4, 0.1, 0.02):
            trial = np.clip(theta + share * step, low, high)
            new = state(trial)
            if np.isfinite(new[4]) and new[4] < phi:
                break
        else:
            break
        gained = phi - new[4]
        theta, (model, p, residual, white, phi) = trial, new
        if gained < ENOUGH:
            break
    jacobian = white[:, 1:]
    hessian = jacobian.T @ jacobian + precision
    numbers, weights, amounts, levels = _parts(world, charts, drawn, theta)
    found = Fit(
        world, nuisance, tuple(charts), numbers, tuple(free), weights, amounts, levels, model, residual, mean,
        precision, hessian,
    )  # fmt: skip
    world.recent.put(found.token, (p, jacobian))
    return found


def columns_of(world: World, free: Sequence[Free]) -> np.ndarray:
    """Columns (M, c) of all free functions."""
    return np.column_stack([f.columns for f in free]) if free else np.zeros((len(world.samples.power), 0))


def linearised(
    world: World, charts: Sequence[Chart], drawn: np.ndarray, theta: np.ndarray
) -> tuple[PowerModel, Prediction, np.ndarray, np.ndarray]:
    """Model and prediction at theta, the residual (M,), and residual and Jacobian by theta made white (M, 1 + P).

    Args:
        drawn: columns (M, w) of the free functions. theta: (P,).
    """
    s, links, model = world.samples, world.links, world.declared
    numbers, weights, amounts, levels = _parts(world, charts, drawn, theta)
    for c, z in zip(charts, numbers, strict=True):
        model = c.into(model, z)
    p = predict(model, s, links.torques @ amounts, links.torques)
    residual = s.power - p.reading - drawn @ weights - world.offsets @ levels
    by_theta = slopes(world, model, charts, numbers, drawn, p)
    return model, p, residual, world.whiten(np.column_stack([residual, by_theta]))


def _parts(
    world: World, charts: Sequence[Chart], drawn: np.ndarray, theta: np.ndarray
) -> tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray, np.ndarray]:
    """The parts of theta: numbers of each effect, weights of free functions, amounts of links, levels of runs."""
    sizes = [*(len(c.mean) for c in charts), drawn.shape[1], world.links.basis.shape[1]]
    *numbers, weights, amounts, levels = np.split(theta, np.cumsum(sizes))
    return tuple(numbers), weights, amounts, levels


def slopes(
    world: World, model: PowerModel, charts: Sequence[Chart], numbers: Sequence[np.ndarray], drawn: np.ndarray,
    p: Prediction,
) -> np.ndarray:  # fmt: skip
    """Derivatives (M, P) [W] of the readings by theta, from the prediction `p` of a model with these `numbers`."""
    where = model.places(world.samples.n)
    own = [p.jacobian[:, where[c.term.name]] @ c.slope(z) for c, z in zip(charts, numbers, strict=True)]
    return np.column_stack([*own, drawn, p.external, world.offsets])


def _before(
    world: World, nuisance: Nuisance, charts: Sequence[Chart], free: Sequence[Free]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Prior mean, prior precision and bounds of theta."""
    from scipy.linalg import block_diag

    weights = np.concatenate([np.full(f.columns.shape[1], f.size**-2) for f in free] or [np.zeros(0)])
    unbounded = len(weights) + world.links.basis.shape[1] + len(world.samples.parts)
    mean = np.concatenate([*(c.mean for c in charts), np.zeros(unbounded)])
    low = np.concatenate([*(c.lower for c in charts), np.full(unbounded, -np.inf)])
    high = np.concatenate([*(c.upper for c in charts), np.full(unbounded, np.inf)])
    return mean, block_diag(*(c.precision for c in charts), np.diag(weights), world.before(nuisance)), low, high
