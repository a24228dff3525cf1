"""How many recordings of a motion are expected to tell which of the rivals is true."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from energy_opt.diagnosis.data.noise import repeated, weighted
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.evidence.odds import SPREADS, Bank
from energy_opt.diagnosis.fit.posterior import Fit
from energy_opt.diagnosis.search.effect_sets import Search
from energy_opt.diagnosis.verdict.claims import RIVAL, RIVAL_DETAIL
from energy_opt.diagnosis.verdict.inference import Inference
from energy_opt.motion.trajectory import Trajectory
from energy_opt.next_motion.motion_search import SAME
from energy_opt.next_motion.rival_models import Rival, expected_readings, samples_of, slack_under

# most recordings that are asked for: repeats share errors of the model, so that more hardly tell more
MOST = 5


@dataclass(frozen=True)
class Prospect:
    """A rival with links of some prior width: log evidence so far, and what a motion would show.

    Attributes:
        reading: (M,) W expected. by: (M, g) its derivatives by unknowns u ~ N(0, 1). noise: variance of a reading, W^2.
        weight: (M,) of readings in a single recording, see `weighted`.
    """

    value: float
    reading: np.ndarray
    by: np.ndarray
    noise: float
    weight: np.ndarray

    def after(self, reading: np.ndarray, count: int) -> float:
        """Log evidence after `count` recordings that show `reading` (M,); the noise itself is left out."""
        # the fit's noise adapts to what repeats share beside errors of clocks and speeds
        root = repeated(self.weight, count, 0.0) * (count / self.noise) ** 0.5
        d, by = root * (reading - self.reading), root[:, None] * self.by
        taken = by.T @ d
        known = np.eye(by.shape[1]) + by.T @ by
        squares = float(d @ d) - float(taken @ np.linalg.solve(known, taken))
        return self.value - 0.5 * squares - 0.5 * float(np.linalg.slogdet(known)[1])


def recordings(found: Inference, trajectory: Trajectory) -> int | None:
    """Number of recordings after which the true rival should be alone in five of six cases; None if `MOST` are too few.

    Rivals that are equal at the meter on the motion are not compared. The log odds of the claims, of which
    `RIVAL_DETAIL` counts against a decision, are taken to grow with the time that is recorded in motion.
    """
    samples = found.accepted.world.samples
    seen = sum(
        float(np.ptp(samples.at[p])) for p, kind in zip(samples.parts, samples.kinds, strict=True) if kind == "motion"
    )
    odds = max((c.odds for c in found.claims), default=0.0)
    prospects = [_prospects(found.search, f, trajectory) for f in found.rivals]
    pairs = [
        (a, b)
        for a, b in permutations(prospects, 2)
        if float(np.sqrt(np.mean((a[0].reading - b[0].reading) ** 2))) >= SAME
    ]
    for count in range(1, MOST + 1):
        reach = RIVAL + RIVAL_DETAIL * odds * (1 + count * trajectory.duration / max(seen, samples.step))
        if all(_surely(*pair, count) >= reach for pair in pairs):
            return count
    return None


def _surely(true: list[Prospect], other: list[Prospect], count: int) -> float:
    """Log odds of the true rival, less one standard deviation: a gain whose mean is g has the variance 2 g."""
    before, after = (_best(true, true[0].reading, k) - _best(other, true[0].reading, k) for k in (0, count))
    return after - (2 * max(after - before, 0.0)) ** 0.5


def _best(prospects: list[Prospect], reading: np.ndarray, count: int) -> float:
    """Log evidence of a rival after `count` recordings that show `reading` (M,), with its likeliest links."""
    return max(p.after(reading, count) for p in prospects)


def _prospects(search: Search, f: Fit, trajectory: Trajectory) -> list[Prospect]:
    """A rival under each width of the links' prior, with the other nuisances that are likeliest there."""
    bank = Bank(f, search.own(f))
    here = search.whole(bank)
    body = f.world.samples.body
    step = f.world.samples.step
    motion = samples_of(body, trajectory, step)
    out = []
    for spread in SPREADS:
        own = [n for n in bank.nuisances if n.spread == spread]
        value, best = max(((bank.nuisances[n] + bank.under(here, n)[0], n) for n in own), key=lambda row: row[0])
        slack = slack_under(f, f.model, body.n, best)
        reading, by = expected_readings(Rival(f.model, slack), motion)
        noise, blur = slack.density / step, np.where(np.tile(motion.v != 0, 2), f.world.samples.blur.max(axis=0), 0.0)
        expected = weighted(replace(motion, noise=noise**0.5, blur=blur), predict(f.model, motion), [1])
        out.append(Prospect(value, reading, by, noise, expected.weight))
    return out
