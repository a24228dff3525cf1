"""Rows of a log whose positions jump farther than a joint can go."""

from __future__ import annotations

import numpy as np
import pytest
from logs import PANDA, SEVEN, SIX, UR, Z1, arm, lines, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set, read_set
from energy_opt.measured.importing import import_files


@pytest.mark.parametrize("stays", [False, True])
def test_rows_whose_positions_jump(tmp_path, stays):
    t, q, _, p = arm(Z1)
    clean, k = q.copy(), len(t) // 2
    q[k : None if stays else k + 1] += np.array([0, 0, 0, 0, 0, 1.0])  # 1 rad within a sample
    path = put(tmp_path / "a.csv", lines("t," + ",".join(f"q{j}" for j in SIX) + ",power", [t, q, p]))
    import_files([path], tmp_path / "set", Z1)
    whole = read_set(tmp_path / "set")
    said = "cut at 1 row(s) where a position jumps and stays" if stays else "1 rows dropped: positions jump"
    assert any(said in remark and f"(first: row {k + 2})" in remark for remark in inspect_set(tmp_path / "set")[1])
    for run in whole.runs:
        speed = np.abs(np.diff(run.position, axis=0)) / np.diff(run.time)[:, None]
        assert speed.max() < 1.5 * (np.abs(np.diff(clean, axis=0)) / np.diff(t)[:, None]).max()


@pytest.mark.parametrize("rows", [[300], [0], [-1], [300, 301]])
def test_damaged_rows_do_not_make_radians_degrees(tmp_path, rows):
    """A reading outside of the limits: all others were taken for degrees, 57 times too small.

    A row between good ones is left out; others are named.
    """
    t, q, _, p = arm(PANDA)
    good = q.copy()
    q[rows, 3] = 6.2
    path = put(tmp_path / "a.csv", lines("t," + ",".join(f"q{j}" for j in SEVEN) + ",power", [t, q, p]))
    if rows != [300]:
        with pytest.raises(BadInput, match=f"row {rows[0] % len(t) + 2}, column q3: 6.2 rad is far outside"):
            import_files([path], tmp_path / "set", PANDA)
        return
    import_files([path], tmp_path / "set", PANDA)
    np.testing.assert_allclose(
        np.vstack([run.position for run in read_set(tmp_path / "set").runs])[:100], good[:100], atol=0.01
    )


@pytest.mark.parametrize("rate", [2, 5, 10, 100])
def test_an_angle_that_wraps_passes_on_or_the_run_is_cut_there(tmp_path, rate):
    """With 2 rows/s there is time enough for a real turn."""
    t = np.arange(40 * rate) / rate
    q = np.column_stack([np.zeros((len(t), 5)), 2.4 * np.sin(0.5 * t)])
    clean = q.copy()
    q[:, 5] = np.mod(q[:, 5] + np.pi - 2, 2 * np.pi) - np.pi + 2  # an encoder whose turn ends elsewhere
    wraps = np.flatnonzero(np.abs(np.diff(q[:, 5])) > 4)
    assert len(wraps) > 2
    path = put(tmp_path / "a.csv", lines("t [s]," + ",".join(f"q{j}" for j in SIX) + ",power", [t, q, 90 + 0 * t]))
    import_files([path], tmp_path / "set", Z1)
    measured = read_set(tmp_path / "set")
    for run in measured.runs:
        assert np.abs(np.diff(run.position, axis=0)).max() < 1.0
    if rate > 2:
        (run,) = measured.runs
        np.testing.assert_allclose(run.position, clean, atol=1e-5)
        assert any("joint6 jumps by a turn from one row to the next" in remark for remark in measured.remarks)


def test_noise_where_an_angle_wraps_costs_no_rows(tmp_path):
    """An arm at rest at half a turn: every second row or so is a turn away from its neighbours."""
    t, q, _, p = arm(UR)
    q[:, 5] += np.pi - q[0, 5] + np.random.default_rng(1).normal(0, 1e-4, len(t))
    wrapped = q.copy()
    wrapped[:, 5] = np.mod(q[:, 5] + np.pi, 2 * np.pi) - np.pi
    path = put(tmp_path / "a.csv", lines("t," + ",".join(f"q{j}" for j in SIX) + ",power", [t, wrapped, p]))
    import_files([path], tmp_path / "set", UR)
    runs = read_set(tmp_path / "set").runs
    assert sum(len(run.power) for run in runs) == len(t)
    found = np.concatenate([run.position[:, 5] for run in runs])
    assert abs(found[0]) == pytest.approx(np.pi, abs=0.01)
    assert np.ptp(found) == pytest.approx(np.ptp(q[:, 5]), abs=1e-5)
