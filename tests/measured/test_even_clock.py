"""Irregular stamps of a recorder are replaced by the controller's even clock, also if samples are missing."""

from __future__ import annotations

import numpy as np
import pytest
from logs import SIX, Z1, lines, log, put

from energy_opt.measured import read_set

STEP = 0.008


def written(folder, taken, stamps):
    """A set whose joints were at times `taken` (N,) where they are said to have been at `stamps` (N,)."""
    q = 0.4 * np.sin(np.outer(taken, 0.9 + 0.3 * np.arange(6))) + np.array([0, 1.0, -1.0, 0, 0, 0])
    header = "time," + ",".join(f"{Z1.joints[j]}.position" for j in SIX) + ",power"
    put(folder / "a.csv", lines(header, [stamps, np.round(q, 5), 60 + 5 * np.sin(3 * taken)]))
    return read_set(log(folder, "z1", '[[run]]\nfile = "a.csv"\nkind = "motion"\n'))


@pytest.mark.parametrize("seconds", [6.0, 60.0])
@pytest.mark.parametrize(("spread", "lost"), [(0.3, 0.0), (0.15, 0.01), (0.3, 0.03)])
def test_samples_go_to_their_places_on_the_clock(tmp_path, seconds, spread, lost):
    rng = np.random.default_rng(3)
    taken = np.arange(round(seconds / STEP)) * STEP
    stamps = np.maximum.accumulate(taken + spread * STEP * rng.normal(size=len(taken)))
    kept = rng.random(len(taken)) >= lost
    measured = written(tmp_path, taken[kept], stamps[kept])
    assert "even clock" in " ".join(measured.remarks)
    off = measured.runs[0].time - taken[kept]
    assert len(off) == kept.sum() and np.abs(off - np.median(off)).max() < 0.1 * STEP


def test_samples_that_were_taken_at_irregular_times_keep_their_stamps(tmp_path):
    rng = np.random.default_rng(4)
    taken = np.cumsum(STEP * rng.uniform(0.4, 1.6, 1500))
    measured = written(tmp_path, taken, taken)
    assert not measured.remarks
    np.testing.assert_allclose(measured.runs[0].time, taken, atol=1e-6)
