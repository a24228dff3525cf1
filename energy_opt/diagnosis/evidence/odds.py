"""Evidence of sets of effects, linearised around one fitted hypothesis.

Let A be the whitened columns of the blocks (present effects, candidates, free functions), U those of links and run
levels with prior precision L, and r the whitened residual if all effects, links and levels are set to change nothing.
Integrating links and levels out gives

    G = A^T A - A^T U (U^T U + L)^{-1} U^T A,     g = A^T r - A^T U (U^T U + L)^{-1} U^T r

and a set S of blocks with amounts x ~ N(m, P^{-1}) has the evidence

    log Z(S) = x*^T h - 1/2 x*^T H x* - 1/2 m^T P m + 1/2 log |P| - 1/2 log |H|,   H = G_SS + P,  h = g_S + P m

(x*: the best amounts within bounds). Once G is known, a set costs microseconds to milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag, solve_triangular
from scipy.linalg.lapack import dposv

from energy_opt.diagnosis.data.clusters import clusters, samples_of
from energy_opt.diagnosis.data.noise import MISFITS, NORMAL_MEDIAN, WAVES, Noise, Whitener, no_less, weighed
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.fit.candidates import Candidate
from energy_opt.diagnosis.fit.posterior import DRIFTS, Fit, Free, Nuisance, World, columns_of, linearised, slopes
from energy_opt.diagnosis.hypothesis.links import Links
from energy_opt.numerics.box import bounded_step

SPREADS = (0.003, 0.025, 0.05, 0.085)  # relative deviations of links from their URDF that are compared
SPREAD_ODDS = (0.2, 0.2, 0.3, 0.3)  # prior probabilities of these: most arms are off by 3 to 10 %
# (Run levels over the white noise of a reading; slow drift over the arm's level; its correlation time [s]; smooth?)
# Smooth drifts are included because a meter may drift as slowly as an arm warms up; otherwise warm-ups are claimed.
LEVELS = (
    (0.03, 3e-4, DRIFTS, False), (0.3, 3e-3, DRIFTS, False), (0.3, 0.012, DRIFTS, False), (1.5, 0.012, DRIFTS, False),
    (0.03, 3e-3, DRIFTS / 2, True), (0.03, 3e-3, DRIFTS, True),
    (0.03, 0.012, DRIFTS / 2, True), (0.03, 0.012, DRIFTS, True),
)  # fmt: skip
STEADY = 50.0  # [W] added to the arm's level for its drift, as meters of small arms drift by as much
DRIFT = 0.025  # largest drift of a meter as a share of the arm's level
SURE = 2.0  # standard deviations of von Neumann's ratio below which neighbouring levels count as independent
FEW_LEVELS = 4  # least runs to recognise a drift
JUMP = 6.0  # a change between neighbouring runs above this multiple of the usual change is a step, not drift
LEVEL_ODDS = (0.35, 0.15, 0.15, 0.1, 0.05, 0.05, 0.075, 0.075)

# log evidence of a set whose equations rounding makes indefinite: its columns are too alike; finite, as sums need it
NEVER = -1e300

Subset = frozenset[int]


@dataclass(frozen=True)
class Block:
    """Columns that enter or leave a set together, with amounts x (c,).

    Attributes:
        white: (M, c) whitened derivatives of the readings by the amounts.
        precision, mean, low, high: (c, c), (c,) of the amounts' normal prior, and their bounds.
        odds: logarithm of the prior odds.
        source: where it comes from; an integer is the index of an effect or free function of the fit.
        present: (c,) amounts in the fit; None if the fit does not have the block.
    """

    name: str
    white: np.ndarray
    precision: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    odds: float
    source: Candidate | Free | int
    present: np.ndarray | None = None

    def lean(self) -> Block:
        """The block without its columns: a bank needs only their products, and banks are kept in memory."""
        source = self.source
        if not isinstance(source, int):
            source = replace(source, columns=np.zeros((0, source.columns.shape[1])))
        return replace(self, white=np.zeros((0, self.white.shape[1])), source=source)


@dataclass(frozen=True)
class Weighed:
    """Log evidence times odds of a set (over all nuisances), the likeliest nuisance, and the amounts there."""

    value: float
    nuisance: Nuisance
    amounts: tuple[np.ndarray, ...]


@dataclass
class Bank:
    """Blocks around a fit, ready to be weighed in any combination.

    Attributes:
        fit: where all columns were linearised. blocks: those of the fit, of candidates and of free functions.
        seen, glanced: cached results of `weigh` and `glance`, by set.
    """

    fit: Fit
    blocks: Sequence[Block]
    seen: dict[Subset, Weighed] = field(default_factory=dict)
    glanced: dict[Subset, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        f = self.fit
        whites = {id(b.white): b.white for b in self.blocks}  # variants may share their columns
        ends = np.cumsum([0, *(w.shape[1] for w in whites.values())])
        places = {key: np.arange(a, b) for key, a, b in zip(whites, ends[:-1], ends[1:], strict=True)}
        self._rows = [places[id(b.white)] for b in self.blocks]
        a = np.column_stack(list(whites.values())) if whites else np.zeros((len(f.residual), 0))
        ds, os = len(f.amounts), len(f.levels)
        u = f.jacobian[:, f.jacobian.shape[1] - ds - os :]
        r = f.world.whiten(f.residual) + u @ np.concatenate([f.amounts, f.levels])
        for b in self.blocks:
            if b.present is not None:
                r = r + b.white @ b.present
        self._logs = [float(np.linalg.slogdet(b.precision)[1]) for b in self.blocks]
        self._aa, self._au, self._uu = a.T @ a, a.T @ u, u.T @ u
        self._ar, self._ur, self._rr = a.T @ r, u.T @ r, float(r @ r)
        self._grids: dict[Nuisance, tuple[np.ndarray, np.ndarray, float]] = {}
        white = f.world.whiten.noise.white
        self.nuisances = {
            Nuisance(s, o * white, d * (f.world.scale.level + STEADY), over, smooth): float(np.log(p * w))
            for s, p in zip(SPREADS, SPREAD_ODDS, strict=True)
            for (o, d, over, smooth), w in zip(LEVELS, LEVEL_ODDS, strict=True)
        }
        self.likely: list[Nuisance] = list(self.nuisances)
        self.blocks = [b.lean() for b in self.blocks]

    def _under(self, nuisance: Nuisance) -> tuple[np.ndarray, np.ndarray, float]:
        """X with G = A^T A - X^T X, the vector g, and the log evidence of links and levels alone."""
        if nuisance not in self._grids:
            before = self.fit.world.before(nuisance)
            lower = np.linalg.cholesky(self._uu + before)
            x, y = (solve_triangular(lower, z, lower=True, check_finite=False) for z in (self._au.T, self._ur))
            worth = 0.5 * float(y @ y) + 0.5 * float(np.linalg.slogdet(before)[1]) - float(np.log(np.diag(lower)).sum())
            self._grids[nuisance] = x, self._ar - x.T @ y, worth - 0.5 * self._rr
        return self._grids[nuisance]

    def under(self, chosen: Iterable[int], nuisance: Nuisance) -> tuple[float, np.ndarray]:
        """Log evidence times odds of a set under one nuisance, and the best amounts, block after block.

        Args:
            chosen: indices of blocks. nuisance: one of `nuisances`, whose own odds do not count here.
        """
        chosen = sorted(chosen)
        taken, small, worth = self._under(nuisance)
        index = np.concatenate([self._rows[k] for k in chosen] or [np.zeros(0, int)]).astype(int)
        blocks = [self.blocks[k] for k in chosen]
        odds = sum(b.odds for b in blocks)
        if not len(index):
            return worth + odds, np.zeros(0)
        precision = np.zeros((len(index), len(index)))
        at = 0
        for b in blocks:
            end = at + len(b.mean)
            precision[at:end, at:end] = b.precision
            at = end
        mean = np.concatenate([b.mean for b in blocks])
        low, high = np.concatenate([b.low for b in blocks]), np.concatenate([b.high for b in blocks])
        own = taken[:, index]
        h = self._aa[np.ix_(index, index)] - own.T @ own + precision
        g = small[index] + precision @ mean
        lower, x, failed = dposv(h, g, lower=1)
        if failed:
            return NEVER, np.zeros(len(index))
        if (x < low - 1e-9).any() or (x > high + 1e-9).any():
            x = bounded_step(h, g, np.minimum(low, 0.0), np.maximum(high, 0.0))
        determinant = sum(self._logs[k] for k in chosen) / 2
        value = float(x @ g - 0.5 * x @ h @ x - 0.5 * mean @ precision @ mean)
        return worth + odds + value + determinant - float(np.log(np.diag(lower)).sum()), x

    def glance(self, chosen: Subset) -> float:
        """Quick log evidence of a set, for comparing many: under the nuisance that is likeliest for the fit itself.

        If it is larger, the value with the same link spread and the least meter drift is used: a fit without an effect
        may explain the effect by a drift of the meter.
        """
        if chosen not in self.glanced:
            first = self.likely[0]
            stays = min((n for n in self.nuisances if n.spread == first.spread), key=lambda n: n.drift)
            self.glanced[chosen] = max(
                self.nuisances[n] + self.under(chosen, n)[0] for n in dict.fromkeys((first, stays))
            )
        return self.glanced[chosen]

    def weigh(self, chosen: Subset) -> Weighed:
        """Log evidence of a set over all nuisances in `likely`."""
        if chosen not in self.seen:
            under = [(self.nuisances[n] + (found := self.under(chosen, n))[0], n, found[1]) for n in self.likely]
            best = max(under, key=lambda row: row[0])
            total = best[0] + float(np.log(sum(np.exp(row[0] - best[0]) for row in under)))
            cuts = np.cumsum([self.blocks[k].white.shape[1] for k in sorted(chosen)])[:-1]
            self.seen[chosen] = Weighed(total, best[1], tuple(np.split(best[2], cuts)) if chosen else ())
        return self.seen[chosen]

    def unlike(self, effect: int, block: int) -> float:
        """Share of the squares of an effect of the fit that another block's columns cannot represent.

        Args:
            effect, block: indices of blocks; the first one is in the fit.
        """
        present, effect_at, free = self.blocks[effect].present, self._rows[effect], self._rows[block]
        assert present is not None
        own = float(present @ self._aa[np.ix_(effect_at, effect_at)] @ present)
        gram, both = self._aa[np.ix_(free, free)], self._aa[np.ix_(free, effect_at)] @ present
        gram = gram + 1e-6 * float(np.trace(gram)) / len(gram) * np.eye(len(gram))
        return 1 - float(both @ np.linalg.solve(gram, both)) / max(own, 1e-12)


def links_odds(bank: Bank) -> float:
    """Logarithm of the odds that links deviate from their URDF, for the effects that a bank's fit has."""
    here = frozenset(k for k, b in enumerate(bank.blocks) if isinstance(b.source, int))
    worth = {n: bank.nuisances[n] + bank.under(here, n)[0] for n in bank.nuisances}
    exact = max(value for n, value in worth.items() if n.spread == SPREADS[0])
    return max(value for n, value in worth.items() if n.spread != SPREADS[0]) - exact


def density(white: np.ndarray, jacobian: np.ndarray, before: np.ndarray) -> float:
    """Logarithm of the density of white errors (m,) with uncertain parameters, whose Jacobian is `jacobian` (m, p).

    `before`: their precision (p, p). Constants of m alone are left out.
    """
    after, pull = before + jacobian.T @ jacobian, jacobian.T @ white
    squares = float(white @ white - pull @ np.linalg.solve(after, pull))
    return -0.5 * (squares + float(np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]))


def foresight(f: Fit, held: Samples) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each held-out cluster of runs, errors and Jacobian (m, 1 + p) [W] under a fit, and the precision (p, p).

    Repeats count once. The level of a run follows from those of the runs fitted, as far as meters drift slowly.
    """
    w = f.world
    links = Links(w.links.basis, held.deviating(w.links.basis))
    there = World.of(held, w.declared, w.scale, links, w.whiten.noise)
    times = [np.array([s.at[p].mean() for p in s.parts]) for s in (w.samples, held)]
    count = len(times[0])
    levels = f.nuisance.levels(np.concatenate(times))
    slope = np.linalg.solve(levels[:count, :count], levels[:count, count:]).T
    open_levels = levels[count:, count:] - slope @ levels[:count, count:]
    theta, drawn = np.concatenate([*f.numbers, f.amounts, slope @ f.levels]), np.zeros((len(held.power), 0))
    model, p, residual, _ = linearised(there, f.charts, drawn, theta)
    by_theta = slopes(there, model, f.charts, f.numbers, drawn, p)
    own = len(theta) - len(held.parts)
    table = np.column_stack([residual, by_theta[:, :own], by_theta[:, own:] @ slope, by_theta[:, own:]])
    before = block_diag(f.hessian, np.linalg.inv(open_levels))
    return [(len(group) ** -0.5 * table[samples_of(held, group)], before) for group in clusters(held)]


def noise_of(f: Fit) -> Noise:
    """The noise with the largest evidence for a fit's residual (empirical Bayes); its parameters are integrated out.

    First the correlated noise is found with the old discrepancy, then the discrepancy.
    """
    s, count = f.world.samples, len(f.residual)
    times = [s.at[p] for p in s.parts]
    old = f.world.whiten.noise
    by_theta = slopes(f.world, f.model, f.charts, f.numbers, columns_of(f.world, f.free), f.prediction)
    raw = np.column_stack([f.residual, by_theta])
    here = [w for w in WAVES if 0.2 * old.wave <= w * old.white <= 5 * max(old.wave, 0.6 * old.white)] or list(WAVES)

    def worth(wave: float, memory: float, misfit: float) -> tuple[float, float]:
        whiten = Whitener(Noise(1.0, wave, memory, misfit), times, s.weight, f.world.shared)
        w = whiten(raw)
        white = max(float(w[:, 0] @ w[:, 0]) / count, 1e-12)
        hessian = w[:, 1:].T @ w[:, 1:] / white + f.precision
        value = -0.5 * count * np.log(white) - 0.5 * whiten.log_determinant - 0.5 * float(np.linalg.slogdet(hessian)[1])
        return value, white**0.5

    held = old.misfit / old.white
    options = weighed(lambda wave, memory: worth(wave, memory, held), s.noise, count, here)
    found = max(options, key=lambda row: row[0])[1]
    wave, memory = found.wave / found.white, found.memory
    if not f.world.shared.motions:
        return found
    _, white, misfit = max((*no_less(*worth(wave, memory, m), s.noise, count), m) for m in MISFITS)
    return Noise(white, wave * white, memory, misfit * white)


def drift_of(f: Fit, samples: Samples, centred: bool) -> np.ndarray:
    """Change of level (R,) [W] of the given runs by the meter's drift, interpolated from the fitted runs.

    Only the part that neighbouring runs share counts as drift, up to `DRIFT`, and no steps: a switched load is a cause
    of its own. `centred`: relative to the runs' common level, which a model's standby contains.
    """
    own = np.array([f.world.samples.at[part].mean() for part in f.world.samples.parts])
    order = np.argsort(own)
    levels = without_steps(own[order], f.levels[order])
    middle = float(np.mean(levels))
    levels = levels - middle
    whole = float(np.mean(levels**2))
    if len(levels) < FEW_LEVELS or whole == 0:
        return np.zeros(len(samples.parts))
    common = 1 - float(np.mean(np.diff(levels) ** 2)) / 2 / whole
    common = common**0.5 if common > SURE / len(levels) ** 0.5 else 0.0
    most = most_drift(f)
    at = np.array([samples.at[part].mean() for part in samples.parts])
    moved = common * np.interp(at, own[order], levels) + (0.0 if centred else middle)
    return np.asarray(np.clip(moved, -most, most))


def most_drift(f: Fit) -> float:
    """Largest drift [W] of a meter of the arm."""
    return DRIFT * (f.world.scale.level + STEADY)


def drifts_most(f: Fit) -> bool:
    """True if a fit explains the levels of its runs by as large a drift of the meter as there is."""
    return bool((np.abs(drift_of(f, f.world.samples, centred=False)) >= most_drift(f)).any())


def without_steps(time: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Levels (R,) [W] of runs at ascending times (R,) [s] without their steps, shifted to the least mean square.

    A step is a change far above the median change; changes are divided by the root of the time that passed, as in a
    random walk.
    """
    if len(levels) < FEW_LEVELS:
        return levels
    changes = np.diff(levels)
    pace = np.abs(changes) / np.sqrt(np.maximum(np.diff(time), 1e-6))
    usual = float(np.median(pace)) / NORMAL_MEDIAN
    steps = np.concatenate([[0.0], np.cumsum(np.where(pace > JUMP * usual, changes, 0.0))])
    own = levels - steps
    return np.asarray(min((own + s for s in steps), key=lambda x: float(np.mean(x**2))))
