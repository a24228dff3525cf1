"""Sets with more readings than a fit asks for: neighbours are averaged, and beyond that runs are left out evenly.

The meter's noise remembers some tenths of a second and numbers are few, so some minutes of readings fix them; a
model is still evaluated at every node, so that fast motion between averaged readings is not lost.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from energy_opt.measured import MeasuredSet, Run
from energy_opt.measured.meter import nodes

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

BIN = 0.03  # [s] readings closer than this are averaged
MOST_READINGS = 10_000  # that enter a fit: five minutes of a fast meter; of more, neighbours are averaged
MOST_NODES = 40_000  # at which models are evaluated: twenty minutes of a fast meter
FEW_RUNS = 8  # of which none is left out; each is cut short instead


def per_bin(run: Run) -> int:
    """How many of a run's meter readings make a sample."""
    return max(1, int(BIN / float(np.median(np.diff(run.power_time))) + 0.5)) if len(run.power) > 1 else 1


def shortened(measured: MeasuredSet) -> MeasuredSet:
    """The set less what is beyond `MOST_NODES`: runs left out evenly, or the ends of few long ones; with a remark."""
    counts = [len(nodes(r)) if r.window.any() else len(r.power) // per_bin(r) for r in measured.runs]
    share = MOST_NODES / max(sum(counts), 1)
    if share >= 1:
        return measured
    runs = measured.runs
    if share * len(runs) >= FEW_RUNS:
        kept = tuple(r for k, r in enumerate(runs) if int((k + 1) * share) > int(k * share))
        how = f"{len(kept)} of {len(runs)} runs, spread evenly, are looked at"
    else:
        kept = tuple(_first(run, share) for run in runs)
        how = f"the first {100 * share:.0f} % of each run are looked at"
    remark = f"The set is longer than {MOST_NODES} samples, the most that are fitted: {how}."
    return replace(measured, runs=kept, remarks=(*measured.remarks, remark))


def _first(run: Run, share: float) -> Run:
    """The first share of a run."""
    end = run.time[0] + share * (run.time[-1] - run.time[0])
    rows, read = run.time <= end, run.power_time <= end
    signals = {name: values[rows] for name, values in run.joint_signals()}
    index = run.rows[rows] if len(run.rows) == len(run.time) else run.rows
    return replace(
        run, time=run.time[rows], rows=index, power_time=run.power_time[read], power=run.power[read],
        window=run.window[read], logged=run.logged_at(rows), **signals,
    )  # fmt: skip


def group_size(readings: int) -> int:
    """How many neighbouring readings are averaged to one, of so many."""
    return -(-readings // MOST_READINGS)


def averaged(count: int, group: int, inner: csr_matrix) -> tuple[csr_matrix, csr_matrix]:
    """Matrices from `count` readings to means of `group` neighbours, and from their nodes to these.

    Args:
        inner: (count, K), from the nodes to the readings.
    """
    from scipy.sparse import csr_matrix

    whole = count // group
    index = np.arange(whole * group)
    mean = csr_matrix((np.full(len(index), 1 / group), (index // group, index)), shape=(whole, count))
    return mean, (mean @ inner).tocsr()


def group_weight(weight: np.ndarray, group: int) -> np.ndarray:
    """Trust in means of `group` neighbours whose variances grow by 1 / weight^2: variances add up."""
    whole = len(weight) // group
    return np.asarray(np.mean(weight[: whole * group].reshape(whole, group) ** -2.0, axis=1) ** -0.5)
