"""Angles of one file in different units: found joint by joint where velocities show them, else refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import SIX, UR, lines, put

from energy_opt.errors import BadInput
from energy_opt.measured import read_set
from energy_opt.measured.columns import ByHand
from energy_opt.measured.importing import import_files

T = np.arange(600) * 0.01
SIZE, RATE = np.array([1.2, 0.9, 1.5, 0.8, 1.1, 1.3]), 1 + 0.2 * np.arange(6)
Q = SIZE * np.sin(np.outer(T, RATE))
V = SIZE * RATE * np.cos(np.outer(T, RATE))
P = 60 + 10 * np.abs(V).sum(axis=1)
LAST = np.array([1, 1, 1, 1, 1, 180 / np.pi])  # the last joint is in degrees
NAMES = [f"q{k}" for k in SIX]
RATES = [f"dq{k}" for k in SIX]


def log_of(path: Path, names: list[str], *columns: np.ndarray) -> Path:
    return put(path, lines(",".join(["t", *names, "power"]), [T, *columns, P], "%.9f"))


@pytest.mark.parametrize("header", [NAMES, [*NAMES[:5], "q5 [deg]"], [f"q{k} [rad]" for k in SIX], "by hand"])
def test_radians_beside_degrees_are_not_taken_for_degrees(tmp_path: Path, header: list[str] | str) -> None:
    names = header if isinstance(header, list) else NAMES
    hand = ByHand(joints={UR.joints[5]: "q5:deg"} if header == "by hand" else {})
    path = log_of(tmp_path / "a.csv", names, Q * LAST)
    with pytest.raises(BadInput, match=r"'q0.*'q4.* may be in rad.* --joint .*elbow_joint=q2.*:rad"):
        import_files([path], tmp_path / "set", UR, hand=hand)
    units = dict(zip(UR.joints, [*["rad"] * 5, "deg"], strict=True))
    stated = {joint: f"{name}:{units[joint]}" for joint, name in zip(UR.joints, names, strict=True)}
    import_files([path], tmp_path / "set", UR, hand=ByHand(joints=stated))
    np.testing.assert_allclose(read_set(tmp_path / "set").runs[0].position, Q, atol=1e-8)


@pytest.mark.parametrize("unit", ["", " [rad/s]", " [rpm]"])
def test_velocities_show_each_joints_unit(tmp_path: Path, unit: str) -> None:
    rates = V * (30 / np.pi if "rpm" in unit else 1)
    path = log_of(tmp_path / "a.csv", [*NAMES, *(name + unit for name in RATES)], Q * LAST, rates)
    made = import_files([path], tmp_path / "set", UR)
    assert any(word.startswith(f"positions of {UR.joints[5]} are degrees") for word in made.words)
    (run,) = read_set(tmp_path / "set").runs
    np.testing.assert_allclose(run.position, Q, atol=1e-8)
    np.testing.assert_allclose(run.velocity, V, atol=1e-7)


def test_velocities_in_the_own_unit_of_each_joint_show_none(tmp_path: Path) -> None:
    path = log_of(tmp_path / "a.csv", [*NAMES, *RATES], Q * LAST, V * LAST)
    with pytest.raises(BadInput, match="may be in rad"):
        import_files([path], tmp_path / "set", UR)


def test_a_few_degrees_are_degrees_where_most_angles_are_and_a_line_says_so(tmp_path: Path) -> None:
    few = log_of(tmp_path / "few.csv", NAMES, np.degrees(Q) * [0.05, 1, 1, 1, 1, 1])
    made = import_files([few], tmp_path / "set", UR)
    assert any("'q0' may be in rad" in word and "--joint" in word for word in made.words)
    np.testing.assert_allclose(read_set(tmp_path / "set").runs[0].position, Q * [0.05, 1, 1, 1, 1, 1], atol=1e-8)


def test_few_degrees_are_degrees_where_another_file_shows_it(tmp_path: Path) -> None:
    few = log_of(tmp_path / "few.csv", NAMES, np.degrees(Q) * [0.03, 0.03, 0.03, 1, 1, 1])
    with pytest.raises(BadInput, match=r"few.csv: .*'q0'.* may be in rad"):
        import_files([few], tmp_path / "set", UR)
    made = import_files([few, log_of(tmp_path / "more.csv", NAMES, np.degrees(Q))], tmp_path / "set", UR)
    assert not any("may be in rad" in word for word in made.words)
    found = {run.file: run.position for run in read_set(tmp_path / "set").runs}
    np.testing.assert_allclose(found["few.csv"], Q * [0.03, 0.03, 0.03, 1, 1, 1], atol=1e-8)


def test_a_joint_that_hardly_moves_has_the_unit_of_the_others(tmp_path: Path) -> None:
    still = np.degrees(Q) * [0, 1, 1, 1, 1, 1] + [0.5, 0, 0, 0, 0, 0]
    import_files([log_of(tmp_path / "a.csv", NAMES, still)], tmp_path / "set", UR)
    np.testing.assert_allclose(read_set(tmp_path / "set").runs[0].position, np.radians(still), atol=1e-8)


@pytest.mark.parametrize("unit", ["mrad", "gon"])
def test_an_angle_without_a_unit_has_that_of_the_others_whatever_it_is(tmp_path: Path, unit: str) -> None:
    """Far outside the limits as radians, it was taken to be in degrees."""
    q, factor = Q * (0.1 if unit == "mrad" else 1.0), {"mrad": 1000.0, "gon": 200 / np.pi}[unit]
    import_files(
        [log_of(tmp_path / "a.csv", [*(f"q{k} [{unit}]" for k in SIX[:5]), "q5"], q * factor)], tmp_path / "set", UR
    )
    np.testing.assert_allclose(read_set(tmp_path / "set").runs[0].position, q, atol=1e-8)
