"""Units that no header names: one for all files of an import, and a power that suits the arm's size."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from logs import SIX, UR, Z1, arm, lines, put

from energy_opt.errors import BadInput
from energy_opt.measured.importing import import_files
from energy_opt.robot import load_robot

T = np.arange(400) * 0.01
POSES = [[3.0, -5, 4, 2, -3, 1], [0, -90, 90, 0, 30, 0], [20, -60, 40, -30, 60, 10]]  # degrees; the first is near zero
JOINTS = ",".join(f"q{k}" for k in SIX)


def poses(folder: Path, header: str, *columns: np.ndarray) -> list[Path]:
    """A file for each pose; `columns` are multiplied by the pose's number, from 1."""
    out = []
    for k, pose in enumerate(POSES):
        noise = np.random.default_rng(k).normal(0, 1e-4, (len(T), 6))
        more = [(k + 1) * column for column in columns]
        text = lines(f"t,{JOINTS},{header}", [T, np.array(pose) + noise, *more])
        out.append(put(folder / f"pose{k}.csv", text))
    return out


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_a_pose_near_zero_is_in_degrees_as_those_of_the_other_files(tmp_path: Path, order: slice) -> None:
    made = import_files(poses(tmp_path, "power", 0 * T + 40)[order], tmp_path / "set", UR)
    found = {run.file: run.position.mean(axis=0) for run in made.runs}
    for k, pose in enumerate(POSES):
        np.testing.assert_allclose(found[f"pose{k}.csv"], np.radians(pose), atol=1e-3)
    assert any(f"position: deg in all files, as pose{k}.csv shows" in made.words for k in (1, 2))


def test_currents_are_milliamperes_in_all_files_if_they_are_in_one(tmp_path: Path) -> None:
    header = f"power,{','.join(f'current_{k}' for k in SIX)}"
    made = import_files(poses(tmp_path, header, 0 * T + 40, np.full((len(T), 6), 60.0)), tmp_path / "set", UR)
    np.testing.assert_allclose(sorted(run.current.mean() for run in made.runs), [0.06, 0.12, 0.18])


def test_power_is_in_watts_in_all_files_if_one_of_them_draws_too_much_for_kilowatts(tmp_path: Path) -> None:
    made = import_files(poses(tmp_path, "power", np.full(len(T), 1.5)), tmp_path / "set", UR)
    np.testing.assert_allclose(sorted(run.power.mean() for run in made.runs), [1.5, 3.0, 4.5])


@pytest.mark.parametrize(("header", "small"), [("power", 0.09), (",".join(f"i{k}" for k in SIX), 0.5)])
def test_files_whose_sizes_differ_as_units_do_are_refused(tmp_path: Path, header: str, small: float) -> None:
    files = []
    for k, size in enumerate((small, 1000 * small)):
        noise = np.random.default_rng(k).normal(0, 1e-4, (len(T), 6))
        columns = [T, np.full(6, 0.3) + noise, np.full((len(T), header.count(",") + 1), size)]
        files.append(put(tmp_path / f"{k}.csv", lines(f"t,{JOINTS},{header}", columns)))
    with pytest.raises(BadInput, match="import them into sets of their own"):
        import_files(files, tmp_path / "set", UR)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize(("mean", "factor"), [(3.0, 1.0), (90.0, 1e-3)])
def test_a_few_watts_of_a_small_arm_are_no_kilowatts(tmp_path: Path, mean: float, factor: float, stated: bool) -> None:
    """The arm's size is known by its limits or, without them, by its weight."""
    urdf = Path(str(Z1.urdf)).read_text()
    plain = put(tmp_path / "own.urdf", urdf if stated else re.sub(r'effort="[0-9.]+"', 'effort="0"', urdf))
    small = load_robot(plain, lock={"jointGripper": 0.0})
    t, q, _, p = arm(Z1)
    watts = p * mean / p.mean()
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},power", [t, q, watts * factor], "%.9f"))
    made = import_files([path], tmp_path / "set", small)
    assert max(run.power.max() for run in made.runs) == pytest.approx(watts.max(), rel=1e-3)
    assert np.isfinite(small.limits.effort).all() == stated


def test_a_counter_of_a_small_arm_counts_joules(tmp_path: Path) -> None:
    t, q, _, p = arm(UR)
    watts = p / p.mean()
    energy = np.concatenate([[0], np.cumsum((watts[1:] + watts[:-1]) / 2 * np.diff(t))])
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},Energy", [t, q, energy], "%.9f"))
    assert import_files([path], tmp_path / "set", UR).log["columns"]["energy"]["unit"] == "J"
