"""Errors of fits on motions held out or left out: the evidence for single effects, and the scatter of their numbers.

Evidence on the fitted motions may favour an effect that imitates another law there. A motion that was not fitted shows
this: its readings are less likely under the wrong effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from energy_opt.diagnosis.data.clusters import clusters, samples_of
from energy_opt.diagnosis.data.noise import Noise, Whitener
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.errors import Quality, quality
from energy_opt.diagnosis.evidence.odds import density, drift_of, foresight
from energy_opt.diagnosis.fit.posterior import Fit
from energy_opt.diagnosis.verdict.claims import CLAIM, Claim, written
from energy_opt.power import PowerModel

CHANCE = 2.0  # [standard deviations] by which log odds may be below their expectation
SAME = 0.3  # largest rms difference of two sets' readings that count as the same, over the white noise of a reading
AGAINST = 0.05  # largest log odds against an effect, as a share of those for it


@dataclass
class Judge:
    """The error of fits on the motions held out; without any, on training motions left out one by one.

    Attributes:
        held: runs never fitted. most: the largest plausible noise of the meter at standstill. plausible: those of
            which one rules, with the logarithms of their odds, the likeliest first.
        drifts: the likeliest fit, whose levels show how far the meter drifts.
        seen, foreseen: results on fits, by their tokens.
    """

    held: Samples | None
    plausible: tuple[tuple[float, Noise], ...]
    most: Noise
    drifts: Fit | None = None
    seen: dict[int, Quality] = field(default_factory=dict)
    foreseen: dict[int, tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]] = field(default_factory=dict)

    @property
    def noise(self) -> Noise:
        """The likeliest noise at standstill."""
        return self.plausible[0][1]

    @property
    def unseen(self) -> bool:
        """True if no standstill shows the noise: several are equally plausible."""
        return len(self.plausible) > 1 and self.plausible[0][0] == self.plausible[-1][0]

    @cached_property
    def loud(self) -> Judge:
        """The same judge under the largest plausible noise."""
        return Judge(self.held, ((0.0, self.most),), self.most, self.drifts)

    @cached_property
    def fitted(self) -> Judge:
        """The same judge of the runs that are fitted."""
        return replace(self, held=None, seen={}, foreseen={})

    def of(self, f: Fit) -> Quality:
        """Error of the model that is written for a fit."""
        if f.token not in self.seen:
            self.seen[f.token] = self.of_model(written(f), f, True)
        return self.seen[f.token]

    def of_model(self, model: PowerModel, f: Fit, level: bool = False) -> Quality:
        """Error of a model; the runs of `f` are used if none is held out. `level`: its standby has the common level."""
        samples = self.held or f.world.samples
        drift = drift_of(self.drifts, samples, level) if self.drifts is not None else np.zeros(len(samples.parts))
        return quality(model, samples, self.noise, drift)

    def gains(self, more: Fit, less: Fit) -> np.ndarray:
        """Log odds (C,) by which each motion is likelier under `more`; repeats count once."""
        if self.held is None:
            return left_out(more) - left_out(less)
        return self._foreseen(more)[1] - self._foreseen(less)[1]

    def expected(self, more: Fit, claim: Claim, less: Fit) -> float:
        """Expected sum of `gains` if the law of a claim holds: the mean over the plausible noises.

        Half of the squared difference of both fits' predictions, weighted by the uncertainty of the parameters of
        `less`. Without motions held out, the claim's own log odds.

        Args:
            more: the fit with the claimed effect. less: the fit without it.
        """
        if self.held is None:
            return claim.odds
        out = np.zeros(len(self.plausible))
        both = zip(self._foreseen(more)[0], self._foreseen(less)[0], self.whiteners, strict=True)
        for (errors, _), (others, before), noises in both:
            table = np.column_stack([others[:, 0] - errors[:, 0], others[:, 1:]])
            for k, (_, whiten) in enumerate(noises):
                apart, jacobian = np.split(whiten(table), [1], axis=1)
                pull = jacobian.T @ apart[:, 0]
                squares = float(np.sum(apart**2) - pull @ np.linalg.solve(before + jacobian.T @ jacobian, pull))
                out[k] += 0.5 * squares
        return float(np.average(out, weights=np.exp([odds for odds, _ in self.plausible])))

    @cached_property
    def whiteners(self) -> list[list[tuple[float, Whitener]]]:
        """Of each held-out cluster and plausible noise: its whitener, and the logarithm of odds and density there."""
        held, out = self.held, []
        assert held is not None
        for group in clusters(held):
            times = [held.at[held.parts[r]] for r in group]
            weights = held.weight[samples_of(held, group)]
            whole = [(odds, Whitener(noise, times, weights)) for odds, noise in self.plausible]
            out.append([(odds - 0.5 * w.log_determinant / len(group), w) for odds, w in whole])
        return out

    def _foreseen(self, f: Fit) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
        """The `foresight` of a fit, and the log density (C,) of each held-out cluster, with an open noise."""
        assert self.held is not None
        if f.token not in self.foreseen:
            tables, values = foresight(f, self.held), []
            for (table, before), noises in zip(tables, self.whiteners, strict=True):
                white = [(odds, whiten(table)) for odds, whiten in noises]
                values.append(np.logaddexp.reduce([odds + density(x[:, 0], x[:, 1:], before) for odds, x in white]))
            self.foreseen[f.token] = tables, np.array(values)
        return self.foreseen[f.token]

    def trained(self, more: Fit, less: Fit) -> np.ndarray:
        """Log odds (C,) by which each training motion is likelier under `more`, foreseen by fits without it.

        Empty if no motion is held out: `gains` has them then.
        """
        return np.zeros(0) if self.held is None else left_out(more) - left_out(less)


def by_chance_least(expected: float) -> float:
    """Lowest log odds that a true effect may have by chance, if `expected` are expected; at most 0.

    A true effect's log likelihood ratio is about normal with this mean and twice as much variance.
    """
    return min(0.0, expected - CHANCE * (2 * max(expected, 0.0) + 1) ** 0.5)


def contradicted(gains: Sequence[float]) -> bool:
    """True if some distinct motions contradict an effect that others support.

    If a law holds, a motion's odds are e^k against it with a probability of e^-k at most (Markov's inequality of
    likelihood ratios). A law that resembles another improves some motions and harms others.

    Args:
        gains: log odds for the effect by each distinct motion, which was not fitted.
    """
    against = np.minimum(gains, 0.0)
    return bool(np.min(against) < -CLAIM and -np.sum(against) > AGAINST * np.sum(np.maximum(gains, 0.0)))


def left_out(f: Fit) -> np.ndarray:
    """Logarithm (C,) of the density that the other runs foresee for the readings of each cluster of runs.

    The fit is repeated without the cluster, around the same linearisation. The density includes the uncertainty of the
    parameters, so an error within this uncertainty is no evidence against the fit.
    """
    return np.array([density(white - own @ step, own, before) for white, own, before, step in _without_clusters(f)])


def same_readings(rivals: Sequence[Fit]) -> bool:
    """True if all sets predict the same readings as the first, as a law and one that contains it do.

    An unknown law does not tell such sets apart, so they are not a sign that one of them imitates it.
    """
    first = rivals[0].prediction.reading
    weight = rivals[0].world.samples.weight ** 2
    most = (SAME * rivals[0].world.whiten.noise.white) ** 2
    return all(np.average((f.prediction.reading - first) ** 2, weights=weight) <= most for f in rivals[1:])


def scattered(f: Fit) -> Fit:
    """The fit with the covariance of `jackknifed` over clusters of runs.

    All readings of a motion share the error of an inexact law. So a covariance from the noise alone is too small.
    """
    steps = np.array([step for *_, step in _without_clusters(f)])
    return replace(f, spread=jackknifed(f.covariance, f.precision, steps))


def jackknifed(covariance: np.ndarray, precision: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """A covariance (P, P) widened to the scatter between clusters, in each direction in which this is larger.

    Args:
        covariance: (P, P) posterior by the noise of single readings. precision: (P, P) of the prior.
        steps: (C, P) change of the numbers in a fit without each cluster (Bell and McCaffrey, 2002). C of them show
            their scatter as a Student's t with C - 1 degrees of freedom, whose variance is (C - 1) / (C - 3).
    """
    count = len(steps)
    lower, steps = np.linalg.cholesky(covariance), steps - steps.mean(axis=0)
    apart = solve_triangular(lower, steps.T, lower=True)
    scatter = (count - 1) ** 2 / count / max(count - 3, 1) * apart @ apart.T
    sizes, axes = np.linalg.eigh(lower.T @ precision @ lower + scatter)
    root = lower @ axes * np.sqrt(np.maximum(sizes, 1.0))
    return np.asarray(root @ root.T)


def _without_clusters(f: Fit) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """For each cluster of runs: its white residual and Jacobian; precision and change of theta in a fit without it."""
    s, white, jacobian = f.world.samples, f.world.whiten(f.residual), f.jacobian
    whole = jacobian.T @ jacobian + f.precision
    open_ = jacobian.T @ white - f.precision @ (f.theta - f.mean)  # not zero at bounds
    for group in clusters(s):
        samples = samples_of(s, group)
        own = jacobian[samples]
        before = whole - own.T @ own
        yield white[samples], own, before, np.linalg.solve(before, open_ - own.T @ white[samples])
