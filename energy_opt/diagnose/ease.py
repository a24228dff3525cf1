"""Numbers of a hypothesis freed of usual sizes that do not fit: how wide the law before the data is, the fit says.

Before the data a joint's number is about a usual size, and the joints' shares are alike within `OWN` of it. Where an
effect is several times as large as usual, that is too narrow: it draws the joints towards each other with a certainty
that nobody has, and intervals come out short. So the law is as wide as the numbers that came of it are large, by their
mean square over the one expected, never narrower; as they grow with it, a few times over.
"""

from __future__ import annotations

import numpy as np

from energy_opt.diagnose.fit import Fit, fit

TURNS = 3
ENOUGH = 1.1  # times as wide, below which a law stays as it is


def eased(f: Fit) -> Fit:
    """The hypothesis fitted anew under laws as wide as its numbers ask for; itself where the usual ones are."""
    told = f.world.scale.told
    usual, eased = f.charts, f
    widths = np.ones(len(usual))
    for _ in range(TURNS):
        wanted = np.ones(len(usual))
        for k, (c, z) in enumerate(zip(usual, eased.numbers, strict=True)):
            if c.term.name not in told:  # what is told is no guess
                sizes = ((z - c.mean) ** 2 / np.diag(np.linalg.inv(c.precision)))[~c.shapes]
                wanted[k] = max(1.0, float(np.sqrt(sizes.mean()))) if len(sizes) else 1.0
        if (wanted <= ENOUGH * widths).all():
            break
        widths = wanted
        charts = [c.wider(width) for c, width in zip(usual, widths, strict=True)]
        eased = fit(f.world, f.nuisance, charts, list(eased.numbers), list(f.free), eased.amounts)
    return eased
