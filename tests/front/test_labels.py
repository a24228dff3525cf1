"""Positions with labels, as pandas has them, are matched by joint names, never by order."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.front.given import positions
from energy_opt.front.moves import path_from
from energy_opt.motion import Move

START = [0, -1.5, 1.0, -1.0, -1.57, 0.0]
GOAL = [1.0, -1.0, 1.5, -2.0, -1.57, 0.5]


class Series:
    """Values with labels: iteration gives values, as of a pandas Series."""

    def __init__(self, values, labels):
        self.values, self.labels = list(values), list(labels)

    def keys(self):
        return self.labels

    def __getitem__(self, label):
        return self.values[self.labels.index(label)]

    def __iter__(self):
        return iter(self.values)

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype)


class Table:
    """Rows below the names of columns, as a pandas DataFrame."""

    def __init__(self, rows, columns):
        self.rows, self.columns = np.array(rows), list(columns)

    def __getitem__(self, column):
        return self.rows[:, self.columns.index(column)]

    def __array__(self, dtype=None, copy=None):
        return np.array(self.rows, dtype)


@pytest.fixture(scope="module")
def robot():
    return eo.load_robot("ur5e")


def turned(values, robot):
    """The same positions in another order, with their joints' names."""
    return Series(values[::-1], robot.joints[::-1])


def test_labels_of_positions_are_joint_names(robot):
    np.testing.assert_array_equal(positions(turned(GOAL, robot), robot, "goal"), GOAL)
    np.testing.assert_array_equal(positions(Series(GOAL, range(6)), robot, "goal"), GOAL)
    for labels, says in (
        (("x", *robot.joints[1:]), "goal: unknown joint 'x'"),
        ((robot.joints[1], *robot.joints[1:]), "goal: joint shoulder_lift_joint is given twice"),
        (robot.joints[1:], "goal: no value for shoulder_pan_joint"),
    ):
        with pytest.raises(eo.BadInput, match=says):
            positions(Series(GOAL, labels), robot, "goal")


def test_columns_of_a_path_are_joint_names(robot):
    mixed = np.random.default_rng(3).permutation(6)
    rows, names = np.array([START, GOAL]), np.array(robot.joints)
    tables = Table(rows[:, mixed], names[mixed]), [turned(START, robot), turned(GOAL, robot)], Table(rows, range(6))
    line = [lambda s: turned([a + (b - a) * s for a, b in zip(START, GOAL, strict=True)], robot)]
    for given in (*tables, *line):
        path = path_from(given, robot)
        np.testing.assert_allclose([path.start, path.goal], rows, atol=1e-12)
    with pytest.raises(eo.BadInput, match="path: unknown joint 'time'"):
        path_from(Table(rows, ["time", *names[1:]]), robot)
    still = np.zeros((2, 6))
    moved = eo.Trajectory(robot.joints, [0, 1], Table(rows[:, mixed], names[mixed]), still, still)
    np.testing.assert_array_equal(moved.position, rows)


def test_where_no_joints_are_known_labels_are_refused(robot):
    with pytest.raises(eo.BadInput, match=r"start: .* has labels"):
        Move(turned(START, robot), GOAL)
    with pytest.raises(eo.BadInput, match="tau_c has labels"):
        eo.effects.CoulombFriction(tau_c=turned(np.abs(GOAL), robot))


@pytest.mark.slow
def test_joints_may_have_the_names_that_a_cad_exporter_gives(tmp_path: Path) -> None:
    """A space, as in "Revolute 1", was refused. Options, the written table, `check` and `evaluate` take it."""
    path, text = tmp_path / "arm.urdf", Path(eo.load_robot("ur5e").urdf).read_text()
    for number, joint in enumerate(eo.load_robot("ur5e").joints, start=1):
        text = text.replace(f'"{joint}"', f'"Revolute {number}"')
    path.write_text(text)
    ends = {"start": (0, -1.2, 1.2, -1.5, -1.5, 0), "goal": (0.3, -1, 1.2, -1.5, -1.5, 0)}
    words = {key: [f"Revolute {k} = {x}" for k, x in enumerate(q, start=1)] for key, q in ends.items()}
    given = {"start": ", ".join(words["start"]), "goal": " ".join(words["goal"])}
    answer = eo.optimize(path, "careful", **given, duration=1.5, mode="retime", compile="never", self_collision=False)
    answer.save(tmp_path / "out")
    table = tmp_path / "out" / "trajectory.csv"
    assert table.read_text().startswith("time,Revolute 1.position,Revolute 2.position")
    assert eo.check(table, robot=path, self_collision=False).usable
    found = eo.evaluate(table, robot=path, self_collision=False)
    assert found["motions"][0]["valid"]


def test_names_with_spaces_may_be_separated_by_commas_or_spaces() -> None:
    arm = SimpleNamespace(name="arm", n=2, joints=("Revolute 1", "Revolute 2 b"))
    for text in ("Revolute 2 b = 0.2, Revolute 1 = 0.1", "Revolute 1=0.1 Revolute 2 b=0.2,"):
        np.testing.assert_array_equal(positions(text, arm, "start"), [0.1, 0.2])
