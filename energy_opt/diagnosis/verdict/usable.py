"""Fitness of a model for planning: how well it predicts the difference of energy between two motions.

Motions between the same ends in the same time T are compared: one takes all of T, the other is `SLOWER` times as fast
and then waits. Let d_c [J] be the difference of their energies under the model, for distinct motion c of the set. The
error is stated relative to rms(d),

    sqrt(2 e^2 + h + a) / rms(d)

e: error of a motion's energy, conformal over distinct motions: a further motion has less with probability `STATED`
(Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World); two motions' errors differ by sqrt(2) e. If the
set is explained, it is the error of the likeliest hypothesis: `a` has the step from there to the model, for d itself.
h: mean square change of d by numbers that the data leave uncertain, see `hidden`. a: largest mean square difference
of d between the model and the models that explain the set as well or better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.clusters import clusters
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.errors import energy, reading_of
from energy_opt.diagnosis.evidence.odds import drift_of
from energy_opt.diagnosis.fit.posterior import Fit, fit
from energy_opt.diagnosis.hypothesis.terms import Term, chart
from energy_opt.diagnosis.verdict.claims import written
from energy_opt.diagnosis.verdict.inference import NOISE, Inference
from energy_opt.power import PowerModel

SLOWER = 1.6  # factor on the duration of the slower motion that a motion is compared with
STATED = 0.7  # share of further motions whose error does not exceed the stated one
SURE = 2.0  # standard deviations above the noise from which energy errors are more than noise
OPEN = ("coulomb_friction", "viscous_friction", "copper_loss")  # effects that may hide below the noise
# share of the squares that the claims explain, and of a reading's white noise, below which another law may be ignored
SLIGHT, FAINT = 0.01, 0.5
DIFFERENCE = 20.0  # [%] largest error of the energy difference of two motions for a model that can plan
# a torque that depends on position alone does the same work between the same ends; a meter's drift depends on time
HARMLESS = ("position", "time")


@dataclass(frozen=True)
class Foreseen:
    """How well a model predicts energy differences between motions.

    Attributes:
        percent: the error of a difference over the difference, %; None where the set has no motion.
        motions: how many distinct ones the set has.
        reason: why no statement about other motions is possible; "" if one is possible.
    """

    percent: float | None
    motions: int
    reason: str = ""

    def document(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        return {"difference_percent": self.percent, "motions": self.motions, "reason": self.reason or None}

    def usable(self, after: dict[str, Any] | None, tolerance: float) -> bool:
        """True if the difference is within `DIFFERENCE`, and the energies (as `errors.errors`) within `tolerance` %."""
        if self.percent is None or self.reason or after is None:
            return False
        return bool(self.percent <= DIFFERENCE and after["energy_percent"] <= tolerance)


def foreseen_by(found: Inference, model: PowerModel, samples: Samples, joints: Sequence[str]) -> Foreseen:
    """`foreseen` of the model that a diagnosis writes, over all of its runs.

    Args:
        model: the one that is written. samples: of the whole set, training and holdout. joints: names.
    """
    # if the residual is more than noise, it may affect errors of energy, levels and the estimated noise
    odd = any(g.signal not in HARMLESS for g in found.best.free)
    noise = None if found.verdict in ("partly", "unexplained") or odd else found.noise
    best, rivals = found.best, [written(f) for f in found.rivals[1:]]
    drift = drift_of(best, samples, centred=True)
    offset = float(np.hypot(best.nuisance.offset, best.nuisance.drift))
    out = foreseen(model, samples, noise, drift, offset, found.accepted, best, rivals)
    slight = found.verdict == "nothing_missing" or _slight(found)  # its share of the energies counts in full
    if out.motions and slight:
        out = replace(out, reason="")
    if out.reason:
        return out
    if found.misspecified and not slight:
        return replace(out, reason="a law is present that is not among the effects")
    return replace(out, reason=f"{joints[found.idle[0]]} hardly moves in the set") if found.idle else out


def _slight(found: Inference) -> bool:
    """True if what the likeliest hypothesis has beside the claims is far below the noise and the claims' part."""
    best, accepted, nothing = (f.residual * f.world.samples.weight for f in (found.best, found.accepted, found.root))
    apart, explained = np.mean((best - accepted) ** 2), np.mean(nothing**2) - np.mean(accepted**2)
    few = apart < SLIGHT * explained and apart < (FAINT * found.accepted.world.whiten.noise.white) ** 2
    return bool(few and found.after.ratio < NOISE)


def foreseen(
    model: PowerModel, samples: Samples, noise: Noise | None, levels: np.ndarray, offset: float, f: Fit, best: Fit,
    rivals: Sequence[PowerModel] = (),
) -> Foreseen:  # fmt: skip
    """Error of energies over a set's distinct motions, relative to the change by going faster and waiting.

    The level error that all motions share is removed: two plans of the same duration share it.

    Args:
        noise: of the meter; its share of an energy is subtracted from e^2. None subtracts nothing, if more than noise
            is left.
        levels: (R,) W of every run by the meter's drift. offset: of its level from run to run, W.
        f: the fit of the model.
        best: the likeliest hypothesis; the influence of its free functions on other motions is unknown, unless they
            follow the position or the time alone.
        rivals: further models that explain the set as well.
    """
    likeliest = written(best)
    shown = reading_of(model if noise is None else likeliest, samples)
    errors_, lasting, by_noise = [], [], []
    paces = _paces(samples)
    moving = [r for r, kind in enumerate(samples.kinds) if kind == "motion"]
    if not moving:
        return Foreseen(None, 0, "no motion was recorded")
    difference = _changes(_unmetered(model), *paces)[0][moving]
    others = [_changes(_unmetered(rival), *paces)[0][moving] - difference for rival in (*rivals, likeliest)]
    for group in (g for g in clusters(samples) if samples.kinds[g[0]] == "motion"):
        last = [float(np.ptp(samples.t[samples.slices[r]])) for r in group]
        error = [energy(*samples.single[r]) - energy(samples.single[r][0], shown[r]) - levels[r] * time
                 for r, time in zip(group, last, strict=True)]  # fmt: skip
        time = float(np.mean(last))
        errors_.append(float(np.mean(error)))
        lasting.append(time)
        if noise is not None:
            own = (noise.white**2 * samples.step + 2 * noise.wave**2 * noise.memory) * time + (offset * time) ** 2
            by_noise.append(own / len(group))
    # less the level error that all motions share
    e, times = np.array(errors_), np.array(lasting)
    squares = (e - times * (e @ times) / max(float(times @ times), 1e-9)) ** 2
    if noise is not None:
        beside = float(np.mean(squares / np.maximum(by_noise, 1e-12)))
        noise_alone = beside < 1 + SURE * (2 / len(e)) ** 0.5
        squares = np.zeros(len(e)) if noise_alone else np.maximum(squares - by_noise, 0.0)
    rank = min(int(np.ceil((len(e) + 1) * STATED)), len(e))
    apart = max((float(np.mean(other**2)) for other in others), default=0.0)
    square = 2 * float(np.sort(squares)[rank - 1]) + hidden(f) + apart
    size = max(float(np.sqrt(np.mean(difference**2))), 1e-9)
    signals = [g.signal for g in best.free if g.signal not in HARMLESS]
    reason = f"a part of the power depends on {signals[0]} by no known law" if signals else ""
    return Foreseen(100 * square**0.5 / size, len(e), reason)


def hidden(f: Fit) -> float:
    """Mean square [J^2] change of the differences of `foreseen` by numbers that the data leave uncertain.

    These are the numbers of the fit, its links, and friction and copper loss that it takes as declared: an effect that
    is too small to be seen can be large compared with a small difference.
    """
    w, n = f.world, f.world.samples.n
    charts, numbers = list(f.charts), list(f.numbers)
    for name in OPEN:
        if name not in f.names:
            new = chart(Term(name, declared=w.declared.get(name) is not None), w.declared, w.scale, n)
            charts.append(new)
            numbers.append(new.origin)
    moving = [r for r, kind in enumerate(w.samples.kinds) if kind == "motion"]
    wide = fit(w, f.nuisance, charts, numbers, amounts=f.amounts, iterations=0)
    model = _unmetered(wide.model)
    _, slopes = _changes(model, *_paces(w.samples), w.links.basis)
    where = model.places(n)
    count, none = slopes.shape[1] - len(f.amounts), slice(0, 0)
    own = [slopes[:, s] @ c.slope(z) if (s := where.get(c.term.name, none)) != none else np.zeros((len(slopes), len(z)))
           for c, z in zip(charts, numbers, strict=True)]  # fmt: skip
    by = np.column_stack([*own, slopes[:, count:], np.zeros((len(slopes), len(f.levels)))])[moving]
    return float(np.mean(np.einsum("rp,pq,rq->r", by, np.linalg.inv(wide.hessian), by)))


def _unmetered(model: PowerModel) -> PowerModel:
    return model.kept(lambda e: e.stage != "meter")


def _paces(samples: Samples) -> tuple[Samples, Samples]:
    """The motions as they are and `SLOWER` times as slow; both begin at the same time, so that no drift is between."""
    fast = samples.at_nodes()
    later = (SLOWER - 1) * np.concatenate([np.full(s.stop - s.start, samples.t[s.start]) for s in samples.slices])
    slow = replace(fast, v=samples.v / SLOWER, a=samples.a / SLOWER**2, t=samples.t * SLOWER)
    return fast.reread(t=samples.t + later), slow


def _changes(
    model: PowerModel, fast: Samples, slow: Samples, links: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Energy (R,) [J] of every run and waiting, minus that of the same path in `SLOWER` times its duration.

    Also its derivatives (R, P + c) by the values of a model without meter, and by deviations `links` (10 L, c).
    """
    tables = []
    for s in (fast, slow):
        p = predict(model, s, None, None if links is None else s.deviating(links))
        tables.append(np.column_stack([p.power, p.jacobian, p.external]))
    out = []
    for span in fast.slices:
        t = fast.t[span]
        waits = tables[0][span][-1] * (SLOWER - 1) * np.ptp(t)
        each = [np.trapezoid(table[span], t, axis=0) for table in tables]
        out.append(each[0] + waits - SLOWER * each[1])
    both = np.array(out)
    return both[:, 0], both[:, 1:]
