"""Power that settles after a stop, as an error of every law of power.

The laws state what a joint at rest takes: the motor bears the load. Just after a stop, friction or a controller's error
bears a part of it, which changes over some tenths of a second. A reading s seconds after a joint's stop has this error:

    e = u exp(-s / lasts),   u ~ N(0, size^2) for each stop

Its shape is not exact. So readings after stops have less weight: as if each had an error of this size, and all after
one stop the same, as in repeats of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from energy_opt.diagnosis.data.noise import Noise, Shared, Whitener
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.power import PowerModel

LASTS = (0.15, 0.3, 0.6)  # [s] grid of the time constant of settling
TOGETHER = 0.1  # [s] joints that stop within this time stop together
# wave over white noise and memory [s] of noise that may rule in place of settling
SLOW = ((0.0, 1.0), (0.6, 0.25), (0.6, 1.0), (2.0, 0.25), (2.0, 1.0))
SIZES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # grid of the size over the white noise of a reading
SUPPOSED = 4.0  # the same of a search that supposes settling
LEAST = 7.0  # least gain of log evidence for settling: a thousand to one


@dataclass(frozen=True)
class Settling:
    """Size [W] of settling, and its time constant [s]."""

    size: float = 0.0
    lasts: float = LASTS[0]

    def is_alike(self, other: Settling) -> bool:
        """True if the sizes are about the same."""
        return self.size == other.size == 0 or abs(self.size - other.size) < 0.3 * other.size


def stops(samples: Samples, lasts: float) -> Shared:
    """exp(-s / lasts) of the readings, s seconds after the latest stop of a joint: a column for each stop of a run."""
    found: list[list[np.ndarray]] = []
    for span in samples.slices:
        t, moving = samples.t[span], samples.v[span] != 0
        last = np.maximum.accumulate(np.where(moving, np.arange(len(t))[:, None], -1), axis=0)
        stopped = np.where(moving, -1, last).max(axis=1)  # node at which the last of the joints at rest stopped
        changes = [k for k in np.flatnonzero(np.diff(stopped, prepend=-1)).tolist() if stopped[k] >= 0]
        begins = [a for a, b in pairwise([*changes, len(t)]) if b == len(t) or t[b] - t[a] > TOGETHER]
        decays = [np.where((t >= t[a]) & (stopped >= 0), np.exp(-(t - t[a]) / lasts), 0.0) for a in begins]
        found.append([x * (t < end) for x, end in zip(decays, [*t[begins[1:]], np.inf], strict=False)])
    columns = np.zeros((len(samples.t), max(map(len, found), default=0)))
    for span, own in zip(samples.slices, found, strict=True):
        for k, column in enumerate(own):
            columns[span, k] = column
    runs = [np.arange(part.start, part.stop) for part in samples.parts]
    each = tuple((run, len(own)) for run, own in zip(runs, found, strict=True) if own and len(run))
    return Shared(samples.shown(columns), each)


def settling_of(residual: np.ndarray, white: float, plain: Samples) -> tuple[Settling, float]:
    """The settling with the largest evidence for a residual, none if it is not sure that there is any; its evidence.

    Args:
        residual: (M,) W. white: [W] noise of the readings. plain: samples with the weights that they have without
            settling.
    """
    times, count = [plain.at[p] for p in plain.parts], len(residual)

    def worth(size: float, after: Shared) -> float:
        """Log evidence of settling, which is `size` times as large as the white noise, with the likeliest noise."""
        found = []
        for wave, memory in SLOW:
            whiten = Whitener(Noise(1.0, wave, memory, size), times, plain.weight, after)
            own = max(float(np.sum(whiten(residual) ** 2)) / count, 1e-12)
            found.append(-0.5 * count * (1 + np.log(own)) - 0.5 * whiten.log_determinant)
        return max(found)

    after = {lasts: stops(plain, lasts) for lasts in LASTS}
    none = worth(0.0, after[LASTS[0]])
    value, size, lasts = max((worth(size, columns), size, lasts) for lasts, columns in after.items() for size in SIZES)
    return (Settling(size * white, lasts), value - LEAST) if value - none > LEAST else (Settling(), none)


def settling_at(model: PowerModel, held: Samples, white: float) -> Settling:
    """The same for held-out runs under a model, each with a level of its own; `white`: [W] noise of the readings."""
    residual = held.power - predict(model, held).reading
    levels = [np.full(p.stop - p.start, np.median(residual[p]) if p.stop > p.start else 0.0) for p in held.parts]
    return settling_of(residual - np.concatenate(levels), white, held)[0]


def with_settling(plain: Samples, settling: Settling, repeats: Sequence[int]) -> Samples:
    """The samples with less weight after stops; `repeats`: (R,) of each run's motion."""
    if settling.size == 0:
        return plain
    after = stops(plain, settling.lasts)
    variance = (settling.size * after.columns.max(axis=1, initial=0.0)) ** 2
    alike = max(settling.lasts / plain.step, 1.0) * np.repeat(repeats, [p.stop - p.start for p in plain.parts])
    weight = 1 / np.sqrt(plain.weight**-2.0 + alike * variance / plain.noise**2)
    # the mean square over few stops may be larger by chance: by one standard deviation
    chance = 1 + (2 / max(sum(count for _, count in after.motions), 1)) ** 0.5
    return plain.reread(weight=weight, allowed=plain.allowed + chance * variance)
