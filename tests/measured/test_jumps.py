"""Rows of a log whose positions jump farther than a joint can go."""

from __future__ import annotations

import numpy as np
import pytest
from logs import SIX, Z1, arm, lines, put

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
