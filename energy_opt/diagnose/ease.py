"""Numbers of a hypothesis freed of usual sizes that do not fit: how wide the law before the data is, the data say.

Before the data a joint's number is about a usual size, and the joints' shares are alike within `OWN` of it. Where an
effect is several times as large as usual, that share is too narrow: it draws the joints towards each other with a
certainty that nobody has, and intervals come out short. So the width is one more unknown, chosen by the evidence with
the numbers integrated out (MacKay, Neural Computation 1992, calls it the evidence for a regulariser), never narrower.
"""

from __future__ import annotations

import numpy as np

from energy_opt.diagnose.fit import Fit, fit

WIDTHS = (1.0, 2.0, 4.0, 8.0, 16.0)  # times a usual width
ROUNDS = 2  # over the effects, as one's width may change another's


def eased(f: Fit) -> Fit:
    """The hypothesis fitted anew, every effect with the width that is likeliest; itself where the usual ones are."""
    loose = [k for k, c in enumerate(f.charts) if c.term.name not in f.world.scale.told]
    gradient = f.jacobian.T @ f.world.whiten(f.residual)
    times = np.ones(len(f.charts))
    for _ in range(ROUNDS if len(loose) > 1 else 1):
        for k in loose:
            tried = [np.where(np.arange(len(times)) == k, width, times) for width in WIDTHS]
            times = tried[int(np.argmax([_evidence(f, gradient, own) for own in tried]))]
    if (times == 1).all():
        return f
    charts = [c.wider(float(width)) for c, width in zip(f.charts, times, strict=True)]
    return fit(f.world, f.nuisance, charts, list(f.numbers), list(f.free), f.amounts)


def _evidence(f: Fit, gradient: np.ndarray, times: np.ndarray) -> float:
    """Logarithm of the evidence with effects' widths so many times as wide, around the fit, but for a constant."""
    precision = f.precision.copy()
    at = 0
    for z, width in zip(f.numbers, times, strict=True):
        own = slice(at, at + len(z))
        precision[own, own] /= width**2
        at += len(z)
    off = f.theta - f.mean
    hessian = f.hessian - f.precision + precision
    pull = gradient - precision @ off
    gained = 0.5 * float(pull @ np.linalg.solve(hessian, pull)) - 0.5 * float(off @ precision @ off)
    return gained + 0.5 * float(np.linalg.slogdet(precision)[1] - np.linalg.slogdet(hessian)[1])
