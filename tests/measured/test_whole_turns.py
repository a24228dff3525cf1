"""Angles that are one turn outside their limits, as of a recorder that counts from -180 to 180 degrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import PANDA, SEVEN, SIX, lines, log, motion, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set, read_set
from energy_opt.measured.columns import ByHand
from energy_opt.measured.importing import import_files
from energy_opt.measured.plausible import continued, spikes
from energy_opt.robot import load_robot

KINOVA = load_robot("kinova")  # joints 2, 3 and 5 have limits about pi, the others none
T, X = motion(5, 8.0)
Q = np.array([1.0, 3.9, 2.2, 0.3, 4.8, -0.5]) + np.outer(X, [1, 0.5, 1.5, 1, 0.3, 1])
WRAPPED = np.mod(Q + np.pi, 2 * np.pi) - np.pi
P = 40 + 5 * np.abs(np.gradient(Q, T, axis=0)).sum(axis=1)
TURNED = KINOVA.joints[4]


def close_to(folder: Path, expected: np.ndarray) -> None:
    """Every sample of the set is one of the expected positions; a joint without limits may be turns away."""
    for run in read_set(folder).runs:
        at = np.searchsorted(T, run.start + run.time - 1e-6)
        off = run.position - expected[at]
        free = ~np.isfinite(KINOVA.limits.lower)
        off[:, free] -= 2 * np.pi * np.rint(off[0, free] / (2 * np.pi))
        np.testing.assert_allclose(off, 0, atol=1e-5)


def test_a_set_with_an_angle_one_turn_outside_is_read(tmp_path: Path) -> None:
    names = [f"{joint}.position" for joint in KINOVA.joints]
    shifted = Q - 2 * np.pi * (np.arange(6) == 4)
    put(tmp_path / "a.csv", lines(",".join(["time", *names, "power"]), [T, shifted, P]))
    log(tmp_path, "kinova", '[[run]]\nfile = "a.csv"\n')
    faults, remarks = inspect_set(tmp_path)
    assert faults == [] and f"a.csv: the angle of {TURNED} is one turn outside its limits" in remarks[0]
    close_to(tmp_path, Q)


@pytest.mark.parametrize(("unit", "factor"), [("[deg]", 180 / np.pi), ("[rad]", 1.0)])
def test_wrapped_angles_with_a_unit_are_imported(tmp_path: Path, unit: str, factor: float) -> None:
    names = [f"{joint} {unit}" for joint in KINOVA.joints]
    path = put(tmp_path / "a.csv", lines(",".join(["t", *names, "power"]), [T, WRAPPED * factor, P]))
    import_files([path], tmp_path / "set", KINOVA)
    close_to(tmp_path / "set", Q)


@pytest.mark.parametrize("by_hand", [False, True])
def test_wrapped_angles_without_a_unit_are_no_degrees(tmp_path: Path, by_hand: bool) -> None:
    """Joints with limits were taken for degrees, and the command that the message named made a wrong set."""
    path = put(tmp_path / "a.csv", lines(",".join(["t", *(f"q{k}" for k in SIX), "power"]), [T, WRAPPED, P]))
    stated = {joint: f"q{k}:rad" for k, joint in enumerate(KINOVA.joints)} if by_hand else {}
    made = import_files([path], tmp_path / "set", KINOVA, hand=ByHand(joints=stated))
    assert not any("deg" in word for word in made.words)
    close_to(tmp_path / "set", Q)


def test_a_unit_given_by_hand_is_final(tmp_path: Path) -> None:
    """Positions far outside as radians became degrees, though the user said rad."""
    q = np.array([0, 0, 0, 2.0, 0, 1.5, 0]) + np.outer(X, 0.2 * np.ones(7))  # joint 4 has only negative positions
    path = put(tmp_path / "a.csv", lines(",".join(["t", *(f"q{k}" for k in SEVEN), "power"]), [T, q, P]))
    hand = ByHand(joints={joint: f"q{k}:rad" for k, joint in enumerate(PANDA.joints)})
    with pytest.raises(BadInput, match=r"row \d+, column q3: .* rad is far outside"):
        import_files([path], tmp_path / "set", PANDA, hand=hand)


def test_a_stated_unit_is_not_asked_for(tmp_path: Path) -> None:
    degrees = np.degrees(np.array([0, 0, 0, 2.0, 0, 1.5, 0]) + np.outer(X, 0.2 * np.ones(7)))
    path = put(tmp_path / "a.csv", lines(",".join(["t", *(f"q{k} [deg]" for k in SEVEN), "power"]), [T, degrees, P]))
    with pytest.raises(BadInput, match=r"column q3 \[deg\]: .* is the column another joint's") as caught:
        import_files([path], tmp_path / "set", PANDA)
    assert "degrees" not in str(caught.value)


def test_small_angles_in_degrees_are_no_turned_radians(tmp_path: Path) -> None:
    """Angles of 7 degrees became 0.72 rad, as 7 rad less a turn."""
    ur5e = load_robot("ur5e")
    degrees = 7 + np.outer(X, [1, -1, 1, -1, 1, -1])
    path = put(tmp_path / "a.csv", lines(",".join(["t", *(f"q{k}" for k in SIX), "power"]), [T, degrees, P]))
    assert any("are degrees" in word for word in import_files([path], tmp_path / "set", ur5e).words)
    for run in read_set(tmp_path / "set").runs:
        assert np.abs(np.degrees(run.position) - 7).max() < 3


def test_turns_do_not_add_up_where_a_gap_hides_a_wrap() -> None:
    """Every second wrap was lost in a gap of 0.5 s, and the angle was taken to turn on and on."""
    time = np.arange(0, 40, 0.01)
    angle = np.pi + 0.5 * np.sin(2 * np.pi * time / 8)  # crosses pi every 4 s, upwards at 0, 8 ...
    kept = np.abs((time + 4) % 8 - 4) > 0.25
    time, angle = time[kept], np.column_stack([angle[kept]] * 6)
    found, wrapped = continued(time, np.mod(angle + np.pi, 2 * np.pi) - np.pi, load_robot("ur5e"))
    assert wrapped.any() and np.ptp(found - angle) < 1e-9


def test_a_reading_off_by_nearly_a_turn_is_a_spike() -> None:
    time = np.arange(0, 5, 0.05)
    position = np.column_stack([0.5 * np.sin(time)] * 6)
    position[40, 5] += 5.7
    assert np.flatnonzero(spikes(time, position, load_robot("ur3e"))).tolist() == [40]
