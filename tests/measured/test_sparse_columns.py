"""Columns of joints with many empty cells: temperatures are completed, others are left out with a remark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import SIX, Z1, arm, log, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set, read_set
from energy_opt.measured.importing import import_files


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


def merged(path: Path, lost: int = -1) -> Path:
    """Rows of joints, and between them rows of power, as of an outer merge; the first joint's cell of row `lost` is
    empty.
    """
    t, q, _, p = arm(Z1)
    joints = [(x, [f"{a:.6f}" for a in angles], "") for x, angles in zip(t, q, strict=True)]
    meter = [(x + 0.0031, [""] * 6, f"{power:.4f}") for x, power in zip(t[::5], p[::5], strict=True)]
    rows = [[f"{x:.4f}", *angles, power] for x, angles, power in sorted([*joints, *meter])]
    rows[lost][1] = "" if lost >= 0 else rows[lost][1]
    header = ",".join(["t", *(f"q{k}" for k in SIX), "power"])
    return put(path, "\n".join([header, *map(",".join, rows)]) + "\n")


def test_a_table_that_joins_two_sources_is_read_with_the_stamps_of_each(tmp_path: Path) -> None:
    """A sixth of the rows has no positions, and all readings of power: this was refused."""
    import_files([merged(tmp_path / "a.csv")], tmp_path / "set", Z1)
    t, q, _, p = arm(Z1)
    runs = read_set(tmp_path / "set").runs
    assert sum(len(run.power) for run in runs) > 0.95 * len(p[::5])
    for run in runs:
        np.testing.assert_allclose(run.position[:, 2], np.interp(run.start + run.time, t, q[:, 2]), atol=1e-3)
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time - 0.0031, t[::5], p[::5]), atol=1e-3)


def test_a_lost_reading_in_such_a_table_is_named(tmp_path: Path) -> None:
    path = merged(tmp_path / "a.csv", lost=8)  # a row of joints
    with pytest.raises(BadInput, match="row 10, column q0: '' is empty"):
        import_files([path], tmp_path / "set", Z1)
