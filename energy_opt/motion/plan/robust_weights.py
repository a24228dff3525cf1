"""Weights of the models, and which corner takes a model's place, in the next solve of a robust plan."""

from __future__ import annotations

from typing import Literal

import numpy as np

from energy_opt.motion.plan.robust_models import UnderJudges

Kind = Literal["mean", "worst"]
GROWTH = 9.0  # factor of the weight of the model whose excess over the evenly slowed move is largest
SLIGHT = 0.1  # share of the largest excess: models that exceed theirs by less are not replaced by a corner
STEP = 1.0  # step of the log weights, per standard deviation of the models' energies above their mean


def next_weights(
    kind: Kind, weights: np.ndarray, answer: UnderJudges, places: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """Weights of the next solve, and for each model the judge to plan with: the one under which the move costs most.

    Args:
        kind, weights, answer: of the last solve.
        places: of the models, then of the corners that may take a model's place: the number of their model.
    """
    totals = answer.totals
    if kind == "mean":
        costlier = answer.costlier()
        excess = np.where(costlier, answer.excess(), 0.0)
        worst = _worst_judges(np.where(excess < SLIGHT * excess.max(), 0.0, excess), len(weights), places)
        return weights * GROWTH ** (excess[worst] / excess.max()), worst
    worst = _worst_judges(totals, len(weights), places)
    spread = totals[worst].std()
    if spread > 0:
        weights = weights * np.exp(STEP * (totals[worst] - totals[worst].mean()) / spread)
    return weights, worst


def _worst_judges(values: np.ndarray, count: int, places: np.ndarray) -> list[int]:
    """For each model, the judge of largest value among itself and its corners; itself if none is larger."""
    return [max(np.flatnonzero(places == k).tolist(), key=lambda i: (values[i], i == k)) for k in range(count)]
