"""How far a model is from the measured power and energy, over all readings of some runs, and beside the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.diagnosis.clusters import clusters
from energy_opt.diagnosis.data import Samples
from energy_opt.diagnosis.fit import Fit, fit
from energy_opt.diagnosis.hypothesis import Term, chart
from energy_opt.diagnosis.noise import Noise, Shared, Whitener
from energy_opt.diagnosis.predict import Prediction, predict
from energy_opt.power import PowerModel

DRAWS = 999
SLOWER = 1.6  # times as slow is the motion that one is compared with
STATED = 0.7  # of further motions, of which the stated error is not exceeded
SHARE = 0.9  # of the squares above the noise, that claims must take away to be claimed where more than noise is left
OPEN_NOISE = 0.25  # of the noise's variance, by which it is not known
SURE = 2.0  # standard deviations above the noise, below which errors of energies are noise
OPEN = ("coulomb_friction", "viscous_friction", "copper_loss")  # may hide below the noise
UNSEEN = 0.5  # of the difference, that errors within the noise may be where a model counts as tested
DIFFERENCE = 20.0  # [%] of the difference of energy between two motions, within which a model can plan


@dataclass(frozen=True)
class Quality:
    """A model's error beside noise of the same kind of readings.

    Attributes:
        motion, rest, rmse: rms error of single readings while the arm moves and while it stands, and of all, W;
            0 where there are none.
        noise_motion, noise_rest: what the noise alone would leave there, W.
        noise: the same over all readings.
        squares: (C,) mean square error of every distinct motion or pose, the meter's noise made white with variance 1:
            noise with memory counts for as little as it says.
        counts: (C,) how many readings a repeat of each has.
    """

    motion: float
    rest: float
    noise_motion: float
    noise_rest: float
    rmse: float
    noise: float
    squares: np.ndarray
    counts: np.ndarray

    @property
    def ratio(self) -> float:
        """The error over the noise, in motion, at rest or in all, whichever is worst."""
        return max(self.motion / self.noise_motion, self.rest / self.noise_rest, self.rmse / self.noise)

    def document(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        moving, resting = (
            {"power_rmse": rms or None, "noise": noise, "ratio": rms / noise if rms else None}
            for rms, noise in ((self.motion, self.noise_motion), (self.rest, self.noise_rest))
        )
        return {"motion": moving, "rest": resting}


def mostly_explained(before: Quality, after: Quality, unknown: bool) -> bool:
    """Is `SHARE` of the squares above the noise gone, over all motions and without any one of them (of three or more)?

    A law that no effect has is followed by effects that resemble it: most of it, or all of it in a single motion.

    Args:
        unknown: a function that is no effect's is likelier; else what is left may be noise that is not quite known.
    """
    spare = (1 - SHARE) * (before.squares - 1) - (after.squares - 1 - (0.0 if unknown else OPEN_NOISE))
    return bool(np.sum(spare) >= (max(np.max(spare), 0.0) if len(spare) > 2 else 0.0))


def quality(model: PowerModel, samples: Samples, noise: Noise, drift: np.ndarray) -> Quality:
    """The error of a model on some runs.

    Args:
        noise: of the meter at standstill. drift: (R,) of its level in each run, W.
    """
    now = predict(model, samples)
    shown = reading_of(model, samples, now)
    levels = Shared(np.concatenate([np.full(p.stop - p.start, x) for p, x in zip(samples.parts, drift, strict=True)])
                    [:, None], tuple((np.arange(p.start, p.stop), 1) for p in samples.parts))  # fmt: skip
    whiten = Whitener(replace(noise, misfit=1.0), [samples.at[p] for p in samples.parts], samples.weight, levels)
    white = whiten(samples.power - now.reading) ** 2
    squares, moving, allowed = [], [], []
    usual = samples.floor**2 + noise.wave**2
    runs = zip(samples.slices, samples.parts, shown, samples.single, drift, strict=True)
    for rows, part, own, (time, power), level in runs:
        squares.append((power - own) ** 2)
        live = (samples.v[rows] != 0).any(axis=1).astype(float)
        moving.append(np.interp(time, samples.t[rows], live) > 0.5)
        allowed.append(usual + level**2 + np.interp(time, samples.at[part], samples.allowed[part]))
    every, live, expected = (np.concatenate(x) for x in (squares, moving, allowed))

    def rms(x: np.ndarray, where: np.ndarray) -> float:
        return float(np.sqrt(np.mean(x[where]))) if where.any() else 0.0

    each = [[(np.mean(own := white[samples.parts[r]]), len(own)) for r in group] for group in clusters(samples)]
    own, counts = np.array([np.mean(group, axis=0) for group in each]).T
    least, always = usual**0.5, np.ones(len(live), dtype=bool)
    return Quality(
        rms(every, live), rms(every, ~live), rms(expected, live) or least, rms(expected, ~live) or least,
        rms(every, always), rms(expected, always), own, counts,
    )  # fmt: skip


def reading_of(model: PowerModel, samples: Samples, p: Prediction | None = None) -> list[np.ndarray]:
    """The model's power [W] at every single reading of every run; `p` is its prediction at the samples."""
    p, out = p or predict(model, samples), []
    for rows, part, op, (time, _) in zip(samples.slices, samples.parts, samples.operators, samples.single, strict=True):
        if op is None:
            out.append(np.interp(time, samples.t[rows], p.power[rows]))
        elif len(time) == part.stop - part.start:
            out.append(p.reading[part])
        else:  # instants of which neighbours were averaged
            out.append(np.interp(time, samples.t[rows], p.metered[rows]))
    if any(e.stage == "meter" for e in model.effects):
        out = [
            np.interp(time, samples.at[part], p.reading[part]) if op is None else shown
            for part, op, (time, _), shown in zip(samples.parts, samples.operators, samples.single, out, strict=True)
        ]
    return out


def energy(time: np.ndarray, power: np.ndarray) -> float:
    """J of readings [W] at some times [s]; of a single reading its own value."""
    return float(np.trapezoid(power, time)) if len(time) > 1 else float(power.sum())


def errors(model: PowerModel, samples: Samples, runs: Sequence[int]) -> dict[str, Any] | None:
    """Mean energy error per run [%] and power RMSE [W] over the given runs, with bootstrap intervals over motions."""
    if not runs:
        return None
    samples = samples.part(runs)
    percent, squares, count = [], [], []
    for shown, (time, power) in zip(reading_of(model, samples), samples.single, strict=True):
        measured = energy(time, power)
        percent.append(abs(energy(time, shown) - measured) / abs(measured) * 100)
        squares.append(float(np.sum((power - shown) ** 2)))
        count.append(len(power))
    groups = clusters(samples)
    by_motion = [sum(squares[r] for r in g) / sum(count[r] for r in g) for g in groups]
    return {
        "energy_percent": float(np.mean(percent)),
        "power_rmse": float(np.sqrt(sum(squares) / sum(count))),
        "energy_percent_ci95": bootstrap_interval([float(np.mean([percent[r] for r in g])) for g in groups]),
        "power_rmse_ci95": [max(x, 0.0) ** 0.5 for x in bootstrap_interval(by_motion)],
        "runs": len(percent),
        "motions": len(groups),
    }


def bootstrap_interval(values: Sequence[float], seed: int = 0) -> list[float]:
    """95 % interval of the mean of values per motion, by resampling motions."""
    x = np.asarray(values, dtype=float)
    rng = np.random.default_rng(seed)
    means = x[rng.integers(0, len(x), (DRAWS, len(x)))].mean(axis=1)
    return [float(v) for v in np.quantile(means, [0.025, 0.975])]


@dataclass(frozen=True)
class Foreseen:
    """How well a model foresees what a plan changes: energies of motions of the same ends in the same time.

    Attributes:
        percent: error of the difference of energy between going evenly and going `SLOWER` times as fast and waiting,
            over that difference, %: with probability `STATED` a further motion has less.
        motions: how many distinct ones the set has.
    """

    percent: float | None
    motions: int


def foreseen(
    model: PowerModel, samples: Samples, noise: Noise, offset: float, f: Fit, rivals: Sequence[PowerModel] = ()
) -> Foreseen:
    """The error of energies over a set's distinct motions, beside what going faster and waiting changes there.

    A motion's error is e = measured - model [J] less the common level, which two plans of the same time share; the
    errors of two plans differ by about sqrt(2) |e|. What the meter's noise adds to an energy is taken off first, in
    squares, and all of it where it is no more than noise; what may hide below the noise is added, see `hidden`, and by
    how much the alternative that is farthest off has other differences. The difference is the model's own, in rms over
    the motions, and the error is stated conformally over them. Where an error of `UNSEEN` times the difference would be
    noise, the set does not test the model, and that error is stated.

    Args:
        noise: of the meter. offset: of its level from run to run, W. f: the fit that the model is of.
        rivals: models that explain the set as well.
    """
    shown = reading_of(model, samples)
    errors_, lasting, changes = [], [], []
    paces = _paces(samples)
    difference, _ = _changes(_unmetered(model), *paces)
    moving = [r for r, kind in enumerate(samples.kinds) if kind == "motion"]
    others = [(_changes(_unmetered(rival), *paces)[0] - difference)[moving] for rival in rivals]
    for group in clusters(samples):
        if samples.kinds[group[0]] != "motion":
            continue
        error = [energy(*samples.single[r]) - energy(samples.single[r][0], shown[r]) for r in group]
        errors_.append(float(np.mean(error)))
        lasting.append(float(np.mean([np.ptp(samples.t[samples.slices[r]]) for r in group])))
        changes.append(float(np.mean([difference[r] for r in group])))
    if not errors_:
        return Foreseen(None, 0)
    e, time = np.array(errors_), np.array(lasting)
    e = e - time * (e @ time) / max(float(time @ time), 1e-9)
    by_noise = (noise.white**2 * samples.step + 2 * noise.wave**2 * noise.memory) * time + (offset * time) ** 2
    size = max(float(np.sqrt(np.mean(np.square(changes)))), 1e-9)
    beside = float(np.mean(e**2 / np.maximum(by_noise, 1e-12)))
    noise_alone = beside < 1 + SURE * (2 / len(e)) ** 0.5
    own = np.zeros(len(e)) if noise_alone else np.sort(np.maximum(e**2 - by_noise, 0.0))
    rank = min(int(np.ceil((len(own) + 1) * STATED)), len(own))
    apart = max((float(np.mean(other**2)) for other in others), default=0.0)
    square = 2 * own[rank - 1] + hidden(f) + apart
    unseen = 2 * float(np.mean(by_noise)) * (2 / len(e)) ** 0.5
    if unseen > (UNSEEN * size) ** 2:
        square = max(square, unseen)
    return Foreseen(100 * float(np.sqrt(square)) / size, len(own))


def hidden(f: Fit) -> float:
    """Mean square [J^2] of what numbers that the data leave open change in the differences of `foreseen`.

    The numbers of the fit, its links, and those of friction and copper loss that it takes as they are declared: an
    effect that is too small to be seen can be large beside a small difference.
    """
    w, n = f.world, f.world.samples.n
    charts, numbers = list(f.charts), list(f.numbers)
    for name in OPEN:
        if name not in f.names:
            new = chart(Term(name, declared=w.declared.get(name) is not None), w.declared, w.scale, n)
            charts.append(new)
            numbers.append(new.origin)
    moving = [r for r, kind in enumerate(w.samples.kinds) if kind == "motion"]
    if not moving:
        return 0.0
    wide = fit(w, f.nuisance, charts, numbers, amounts=f.amounts, iterations=0)
    model = _unmetered(wide.model)
    _, slopes = _changes(model, *_paces(w.samples), w.links.basis)
    where = dict(zip((e.name for e in model.effects), model.slices(n), strict=True))
    count, none = slopes.shape[1] - len(f.amounts), slice(0, 0)
    own = [slopes[:, s] @ c.slope(z) if (s := where.get(c.term.name, none)) != none else np.zeros((len(slopes), len(z)))
           for c, z in zip(charts, numbers, strict=True)]  # fmt: skip
    by = np.column_stack([*own, slopes[:, count:], np.zeros((len(slopes), len(f.levels)))])[moving]
    return float(np.mean(np.einsum("rp,pq,rq->r", by, np.linalg.inv(wide.hessian), by)))


def _unmetered(model: PowerModel) -> PowerModel:
    return replace(model, effects=tuple(e for e in model.effects if e.stage != "meter"))


def _paces(samples: Samples) -> tuple[Samples, Samples]:
    """The motions as they are and `SLOWER` times as slow."""
    fast = samples.at_nodes()
    return fast, replace(fast, v=samples.v / SLOWER, a=samples.a / SLOWER**2, t=samples.t * SLOWER)


def _changes(
    model: PowerModel, fast: Samples, slow: Samples, links: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Energy (R,) [J] of every run, then waiting, less that of going evenly in `SLOWER` times its time.

    And its derivatives (R, P + c) by the values of a model without meter, and by deviations `links` (10 L, c).
    """
    tables = []
    for s in (fast, slow):
        p = predict(model, s, None, None if links is None else s.deviating(links))
        tables.append(np.column_stack([p.power, p.jacobian, p.pushed]))
    out = []
    for rows in fast.slices:
        t = fast.t[rows]
        waits = tables[0][rows][-1] * (SLOWER - 1) * np.ptp(t)
        each = [np.trapezoid(table[rows], t, axis=0) for table in tables]
        out.append(each[0] + waits - SLOWER * each[1])
    both = np.array(out)
    return both[:, 0], both[:, 1:]


def usable(ahead: Foreseen, after: dict[str, Any] | None, tolerance: float) -> bool:
    """Is the difference foreseen within `DIFFERENCE`, and energies (as `errors`) within `tolerance` %?"""
    known = ahead.percent is not None and after is not None
    return bool(known and ahead.percent <= DIFFERENCE and after["energy_percent"] <= tolerance)  # type: ignore[operator, index]
