"""Columns of joints with many empty cells: temperatures are completed, others are left out with a remark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import Z1, arm, log, put

from energy_opt.measured import inspect_set, read_set


def sparse(folder: Path, every: int, shift: int = 0) -> Path:
    """A set with temperatures in every `every`-th row and torques in every second; no positions in those rows if
    `shift` is 1.
    """
    t, q, _, p = arm(Z1)
    names = [f"{joint}.{signal}" for signal in ("position", "temperature", "effort") for joint in Z1.joints]
    rows = [",".join(["time", *names, "power"])]
    for k, stamp in enumerate(t):
        warm = [f"{30 + 0.1 * stamp + joint:.5f}" if k % every == shift else "" for joint in range(6)]
        torque = ["1.5" if k % 2 == 0 else ""] * 6
        place = ["" if shift and k % every == shift else f"{x:.6f}" for x in q[k]]
        rows.append(",".join([f"{stamp:.3f}", *place, *warm, *torque, f"{p[k]:.4f}"]))
    put(folder / "a.csv", "\n".join(rows) + "\n")
    return log(folder, "z1", '[[run]]\nfile = "a.csv"\n')


@pytest.mark.parametrize(("every", "shift"), [(100, 0), (3, 1)])
def test_temperatures_in_some_rows_are_completed(tmp_path: Path, every: int, shift: int) -> None:
    (run,) = read_set(sparse(tmp_path, every, shift)).runs
    assert run.temperature is not None
    expected = 30 + 0.1 * run.time[:, None] + np.arange(6)
    np.testing.assert_allclose(run.temperature, expected, atol=0.05)


def test_torques_in_some_rows_are_left_out_with_a_remark(tmp_path: Path) -> None:
    measured = read_set(sparse(tmp_path, 100))
    said = "a.csv: logged effort is left out: 50 % of its cells are empty"
    assert measured.runs[0].effort is None and said in measured.remarks
    assert said in inspect_set(tmp_path)[1]
