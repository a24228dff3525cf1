"""Tracing the residual of measured power to the effect that the declared model lacks.

Sets of effects are compared by their Bayesian evidence: the probability of the readings under a set, with its numbers
integrated out. `data` makes samples of the recordings and estimates the meter's noise, `hypothesis` gives effects their
priors, `fit` finds the likeliest numbers of a set, `evidence` weighs sets, `search` moves from set to set, and
`verdict` claims only what motions that were never fitted support.
"""

from energy_opt.diagnosis.diagnosis import Diagnosis, diagnose

__all__ = ["Diagnosis", "diagnose"]
