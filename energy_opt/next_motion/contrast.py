"""Node functions for distinguishing rival models: their cost, which the reshaper minimises, is their similarity.

With y_i the reading that model i expects, the cost is - sum_{i<k} w_ik mean (y_i - y_k)^2, the mean over the move and
the pause after it, so that the duration may be free. Weights and all models' values are parameters: one build serves
every pair of poses, pass and round of a search.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import casadi as ca
import numpy as np

from energy_opt.effects import BaseTilt, MeterDelay, MeterFilter, MeterGain, Payload, Signals, Smooth
from energy_opt.motion.reshape.nodes import NodeFunctions, NodeSymbols, derived, symbolic_torque
from energy_opt.next_motion.legs import PAUSE
from energy_opt.power import PowerModel, drive_terms
from energy_opt.robot import RigidBody

HARDLY = 0.005  # [s] smaller differences of lag are ignored


def contrast_functions(models: Sequence[PowerModel], body: RigidBody, strongest: np.ndarray) -> NodeFunctions:
    """The node functions of these models; their parameters are those of `contrast_parameters`.

    Args:
        strongest: (n,) index of the model whose motor torque counts at each joint.
    """
    n = body.n
    x, p = NodeSymbols.of(n), [model.symbols(n) for model in models]
    v, a = x.v, x.a
    torques: dict[tuple[str, ...], ca.SX] = {}
    shown, tau_m = [], []
    for model, own, lag in zip(models, p, _lags(models), strict=True):
        rigid = tuple(repr(model.get(kind.name)) for kind in (Payload, BaseTilt))
        if rigid not in torques:
            torques[rigid] = symbolic_torque(model, body, x.q, v, a, own, "auto")
        terms = drive_terms(model, Signals(x.q, v, a, torques[rigid], x.t), own, Smooth())
        reading = terms.power
        if lag:  # dP/dt without the term in jerk, which a node does not know
            reading -= lag * ca.jtimes(terms.power, ca.vertcat(x.q, x.q1), ca.vertcat(x.q1, x.q2)) / x.duration
        gain = model.get(MeterGain.name)
        shown.append(reading if gain is None else gain.values["gain"][0] * reading)
        tau_m.append(terms.tau_m)
    pairs = list(combinations(shown, 2))
    weights = ca.SX.sym("w", len(pairs))
    apart = ca.vertcat(*((y - other) ** 2 for y, other in pairs))
    share = x.duration / (x.duration + PAUSE)
    tau = ca.vertcat(*(tau_m[k][joint] for joint, k in enumerate(strongest)))
    return derived(-share * ca.dot(weights, apart), tau, x, ca.vertcat(*p, weights))


def contrast_parameters(models: Sequence[PowerModel], joints: int, weights: np.ndarray) -> np.ndarray:
    """The parameters of `contrast_functions`: all models' values and the pairs' weights (pairs,) [1/W^2]."""
    return np.concatenate([*(model.values(joints) for model in models), weights])


def _lags(models: Sequence[PowerModel]) -> np.ndarray:
    """Lag [s] of each model's meter relative to their mean; zeros if all lags nearly agree.

    A first-order lag counts half: it delays a slow power like a delay of the same time, and a fast one less. Only the
    search uses this approximation; motions are judged by the meter's full law.
    """
    lags = np.zeros(len(models))
    for kind, share in ((MeterDelay, 1.0), (MeterFilter, 0.5)):
        for k, model in enumerate(models):
            held = model.get(kind.name)
            lags[k] += 0.0 if held is None else share * float(held.full(1)[0])
    return np.zeros(len(models)) if np.ptp(lags) < HARDLY else lags - lags.mean()
