"""Which effects may be claimed: a permutation test over all candidates at once, and runs left out.

Let r be the residual of the hypothesis less one effect, and S_c(b) = Q_c[b]^T r[b] the share of block b in what
candidate c explains, Q_c an orthonormal basis of its columns apart from those the hypothesis has. If r is noise whose
blocks are independent of each other, turning the signs of whole blocks changes nothing in its law, so the best score
over *all* candidates, drawn again and again with random signs, is what chance alone offers to a search that looks at
all of them. An effect is claimed only if its own score is beyond all but the stated share of these draws: the rate of
false positives holds for the set as a whole, not for each candidate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from energy_opt.diagnose.evidence import DRAWS, blocks, left_out_loss
from energy_opt.diagnose.fit import Fit
from energy_opt.diagnose.screen import basis, candidates, single_springs
from energy_opt.diagnose.search import Search, key_of

RATE = 0.01  # stated rate of false positives per set


def family_wise(found: Search, f: Fit, index: int) -> float:
    """p-value of one term of `f`: how often the best of all candidates scores as well on block-wise sign changes.

    Never below 1 / (DRAWS + 1), which is all that so many draws can say.
    """
    key = (f.loss, key_of(f.terms, f.extras), index)
    if key not in found.p_values:
        found.p_values[key] = _drawn(found, f, index)
    return found.p_values[key]


def _drawn(found: Search, f: Fit, index: int) -> float:
    samples, less = found.samples, found.without(f, index)
    taken = basis(less.jacobian) if less.jacobian.shape[1] else np.zeros((len(less.residual), 0))
    residual = less.residual - taken @ (taken.T @ less.residual)
    parts = blocks(samples)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (DRAWS, len(parts)))
    best = np.zeros(DRAWS)
    for columns, price in _family(found, less):
        apart = columns - taken @ (taken.T @ columns)
        own = basis(apart) if np.any(apart) else apart[:, :0]
        sums = np.add.reduceat(own * residual[:, None], [b.start for b in parts], axis=0)  # (B, c)
        gained = np.sum((signs @ sums) ** 2, axis=1) / samples.noise**2 / found.inflation
        np.maximum(best, gained - price, out=best)
    seen = found.score(less) - found.score(f)
    return float((1 + np.sum(best >= seen)) / (DRAWS + 1))


def _family(found: Search, less: Fit) -> Iterator[tuple[np.ndarray, float]]:
    """Columns (N, c) and price of every candidate that the search may add to `less`."""
    weight = found.samples.weight[:, None]
    for candidate in candidates(less, found.declared, found.samples):
        sprung = not candidate.term.kind.same_on_all_joints and not candidate.term.declared
        for c in single_springs(candidate, found.samples.n) if sprung else (candidate,):
            yield c.columns * weight, found.price(len(c.origin), (c.term,), 0)


def left_out_gain(found: Search, f: Fit, index: int) -> np.ndarray:
    """By how much one term lowers the loss of every run (R,) under fits to the other runs."""
    return left_out_loss(found.without(f, index), found.samples) - left_out_loss(f, found.samples)


def helps(gained: np.ndarray) -> bool:
    """Does a term help with most of the runs (R,) that it touches at all?

    Runs count, not their losses: where only one run moves a joint, the others cannot foresee that run.
    """
    touched = gained[np.abs(gained) > 1e-6]
    return bool(len(touched)) and float(np.median(touched)) > 0


def claimed(found: Search, f: Fit) -> Fit:
    """`f` less the effects that chance might explain or that do not help with runs left out, the weakest first."""
    while f.terms:
        p = [family_wise(found, f, k) for k in range(len(f.terms))]
        doubted = [x if helps(left_out_gain(found, f, k)) else 1.0 for k, x in enumerate(p)]
        if max(doubted) <= RATE:
            break
        f = found.polish(found.without(f, int(np.argmax(doubted))))
    return f
