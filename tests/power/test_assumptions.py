"""What nobody gave: bounds on acceleration and jerk, friction and electrical values, and that each is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt.effects import CoulombFriction
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import assumptions, assumptions_line, break_even, grouped
from energy_opt.power.known import careful, electrical, friction_range, name_hints, source_method_1, source_method_2
from energy_opt.robot import Robot, known_robots, load_robot

ARM = """<robot name="arm">
  <link name="base"/>
  {links}
</robot>"""
LINK = """<link name="l{k}"><inertial><origin xyz="0 0 0.2"/><mass value="{mass}"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin xyz="0 0 0.4"/>
    <axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="{velocity}" effort="{effort}"/></joint>"""


def arm(folder: Path, effort: float = 2000.0, velocity: float = 2.0, limits: str = "") -> Robot:
    """Two joints, of the size asked for."""
    links = [
        LINK.format(k=k, parent="base" if k == 1 else "l1", axis=axis, mass=20, velocity=velocity, effort=effort)
        for k, axis in ((1, "0 0 1"), (2, "0 1 0"))
    ]
    (folder / "arm.urdf").write_text(ARM.format(links="\n".join(links)))
    if limits:
        (folder / "limits.yaml").write_text("joint_limits:\n" + limits)
    return load_robot(folder / "arm.urdf", limits=folder / "limits.yaml" if limits else None)


@pytest.mark.parametrize("name", known_robots())
def test_no_robot_by_name_has_an_infinite_bound(name: str) -> None:
    robot = load_robot(name)
    for kind in ("velocity", "acceleration", "jerk", "effort"):
        assert np.isfinite(getattr(robot.limits, kind)).all(), kind
    for model in (source_method_1(robot), source_method_2(robot), careful(robot)):
        assert np.isfinite(model.values(robot.n)).all()
    assert any(effect.stage == "torque" and effect.dissipates for effect in careful(robot).effects)


def test_acceleration_and_jerk_are_given_else_assumed(tmp_path: Path) -> None:
    robot = arm(tmp_path, velocity=2.5)
    np.testing.assert_allclose(robot.limits.acceleration, 12.5)
    np.testing.assert_allclose(robot.limits.jerk, 1250.0)
    assert robot.sources["acceleration"] == robot.sources["jerk"] == ("assumed", "assumed")
    assert robot.sources["effort"] == robot.sources["velocity"] == ("urdf", "urdf")
    np.testing.assert_allclose(arm(tmp_path, velocity=30.0).limits.acceleration, 50.0)
    raised = arm(tmp_path, velocity=2.5, limits="  j2: {max_acceleration: 40}\n")
    np.testing.assert_allclose(raised.limits.acceleration, [12.5, 40])
    np.testing.assert_allclose(raised.limits.jerk, [1250, 4000])
    assert raised.sources["acceleration"] == ("assumed", "limits") and raised.sources["jerk"] == ("assumed", "assumed")
    freed = arm(tmp_path, velocity=2.5, limits="  j2: {has_acceleration_limits: false, max_acceleration: 0}\n")
    np.testing.assert_allclose(freed.limits.acceleration, 12.5)
    assert load_robot("panda").sources["jerk"] == ("published",) * 7


def test_electrical_values_and_friction_go_with_the_size_of_the_arm(tmp_path: Path) -> None:
    robot = arm(tmp_path, effort=2000.0, velocity=2.0)
    model = careful(robot)
    np.testing.assert_allclose(model.get("copper_loss").values["r_over_kt2"], 0.1 * 2.0 / 2000)
    np.testing.assert_allclose(model.get("standby").values["power"], 3 * np.sqrt(2 * 2000 * 2.0))
    np.testing.assert_allclose(source_method_1(robot).get("standby").values["power"], 3 * np.sqrt(8000))
    np.testing.assert_allclose(model.get("coulomb_friction").values["tau_c"], 0.04 * 2000)
    np.testing.assert_allclose(model.get("viscous_friction").values["b"] * 2.0, 0.08 * 2000)
    corners = {
        (float(m.get("coulomb_friction").full(2)[0]) / 2000, float(m.get("viscous_friction").full(2)[0]) * 2.0 / 2000)
        for _, m in friction_range(model, robot)
    }
    assert {(round(a, 9), round(b, 9)) for a, b in corners} == {(0.01, 0.02), (0.01, 0.12), (0.06, 0.02), (0.06, 0.12)}
    assert CoulombFriction(tau_c=0.06 * 50_000).full(1) == 3000  # of the largest arms: inside the effect's bounds


@pytest.mark.parametrize(
    ("of", "name", "published", "hint"),
    [
        ("ur5e", "ur5e", True, None),
        ("ur5e", "mine", False, "mine.urdf: its joints and effort limits are like those of ur5e; if it is a ur5e"),
        ("ur3e", "ur5e", False, "ur5e.urdf: its joints or effort limits are not those of ur5e; published values are"),
        ("ur3e", "mine", False, None),
    ],
)
def test_a_file_gets_published_values_by_its_name_and_says_so(
    tmp_path: Path, of: str, name: str, published: bool, hint: str | None
) -> None:
    """The same bytes under another name lost 28 J instead of 31 J, without a word; a UR3e could be called a UR5e."""
    path = tmp_path / f"{name}.urdf"
    path.write_bytes(load_robot(of).urdf.read_bytes())
    robot = load_robot(path)
    heat = electrical(robot)[1]
    assert (
        (heat.source == "published") == heat.note.endswith(f"used because the file is called {name}.urdf") == published
    )
    said = name_hints(robot)
    assert len(said) == (hint is not None) and all(line.startswith(str(hint)) for line in said)
    assert "called" not in electrical(load_robot("ur5e"))[1].note and not name_hints(load_robot("ur5e"))
    assert not name_hints(load_robot(load_robot("ur5").urdf))  # its own file, called ur5_robot.urdf


def test_a_published_value_says_which_parameter_it_is() -> None:
    """Twice the friction of a Panda's joints, the law's parameter a, was called their friction."""
    robot = load_robot("panda")
    records = assumptions(robot, [careful(robot)])
    notes = {row.note.partition(":")[0] for row in records if row.what in ("friction", "electrical values")}
    assert notes == {"standby, power", "copper loss, r_over_kt2", "sigmoid friction, a"}
    model = careful(robot)
    a = [row.value for row in records if row.what == "friction"]
    assert a == model.get("sigmoid_friction").values["a"].tolist()


def test_a_velocity_that_is_a_placeholder_measures_no_drive(tmp_path: Path) -> None:
    """1000 rad/s is kept as a limit, with a warning; a standby of 3 sqrt(effort * 1000) W belongs to no such arm."""
    fast, usual = arm(tmp_path, effort=20.0, velocity=1000.0), arm(tmp_path, effort=20.0, velocity=np.pi)
    assert fast.limits.velocity[0] == 1000
    np.testing.assert_allclose(fast.rated.velocity, usual.rated.velocity)


def test_a_user_who_slows_the_arm_changes_no_motor(tmp_path: Path) -> None:
    plain = careful(arm(tmp_path))
    slowed = arm(tmp_path, limits="  j1: {max_velocity: 0.2, max_effort: 100}\n  j2: {max_velocity: 0.2}\n")
    assert careful(slowed) == plain
    assert slowed.limits.velocity[0] == 0.2 and slowed.limits.effort[0] == 100


def test_a_saving_that_falls_with_friction_ends_where_it_is_nothing(tmp_path: Path) -> None:
    """3 J less 100 J times the share that is added to the 1 % of the effort limits that the model has."""
    robot = arm(tmp_path, effort=200.0)
    model = source_method_2(robot).replaced(CoulombFriction(tau_c=2.0))

    def saved(other: PowerModel, joules: float = 3.0) -> float:
        share = other.get("coulomb_friction").values["tau_c"][0] / 200.0
        return joules - 100 * (share - 0.01)

    assert break_even(saved, model, robot) == pytest.approx(0.03, abs=1e-5)
    assert break_even(lambda other: saved(other, 30.0), model, robot) is None  # no share below 20 %
    assert break_even(lambda other: saved(other, -1.0), model, robot) is None  # nothing is saved


def test_an_arm_without_effort_limits_is_rated_by_its_weight(tmp_path: Path) -> None:
    robot = arm(tmp_path, effort=0.0)
    lifts = 20 * 9.81 * 0.2  # N m, by the second joint, which is the only one that gravity loads
    assert np.isinf(robot.limits.effort).all() and robot.rated.estimated.all()
    assert lifts < robot.rated.effort[1] < 5 * lifts
    assert 0.1 * robot.rated.effort[1] <= robot.rated.effort[0]
    rows = [row for row in assumptions(robot, [careful(robot)]) if row.what == "effort"]
    assert [row.source for row in rows] == ["assumed"] * 2 and rows[1].value == robot.rated.effort[1]


def test_every_assumption_is_stated_with_its_source(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    rows = assumptions(robot, [source_method_2(robot), careful(robot)])
    assumed = [(row.what, row.joint) for row in rows if row.source == "assumed"]
    assert {what for what, _ in assumed} == {"acceleration", "jerk", "friction", "electrical values"}
    assert {joint for what, joint in assumed if what == "friction"} == {"j1", "j2"}
    assert assumptions_line(rows) == (
        "assumed: acceleration 10 rad/s², jerk (no source), friction, electrical values: "
        "run `diagnose` or give `--limits`, `--model`"
    )
    own = source_method_2("panda")  # a user's own values: neither friction nor electrical values are assumed
    assert "friction" not in assumptions_line(assumptions(robot, [own])) and "electrical" not in assumptions_line(
        assumptions(robot, [own])
    )
    assert all(row.source in ("published", "urdf") for row in assumptions(load_robot("panda"), [careful("panda")]))
    assert assumptions_line(assumptions(load_robot("panda"), [careful("panda")])) == ""
    assert len(grouped(rows)) < len(rows)


@pytest.mark.parametrize(("name", "creeping", "fast"), [("ur5e", 5.8, 17.9), ("ur3e", 5.8 * 54 / 150, 17.9 * 54 / 150)])
def test_friction_of_the_ur_e_series_is_the_published_one(name: str, creeping: float, fast: float) -> None:
    """Published for the UR5e at 0.01 and 3.2 rad/s; the smaller arm's goes with the effort limit."""
    curve = careful(name).get("friction_curve").values
    np.testing.assert_allclose(curve["torque"][0][[0, -1]], [creeping, fast])
    assert curve["speed"].tolist() == [0, 0.5, 1.5, 3.2]


def test_a_locked_joint_takes_its_published_values_along() -> None:
    robot = load_robot("ur5e", lock={"shoulder_pan_joint": 0.0})
    np.testing.assert_allclose(source_method_2(robot).get("copper_loss").values["r_over_kt2"][:2], [0.0018, 0.0019])
    np.testing.assert_allclose(careful(robot).get("friction_curve").values["torque"][:, 0], [6.6, 5.1, 1.4, 1.2, 1.3])


def test_the_break_even_of_an_arm_of_tonnes_is_sought(tmp_path: Path) -> None:
    """Friction of a fifth of 900 kN m had been refused as implausible, after all the work."""
    robot = arm(tmp_path, effort=9e5)
    assert break_even(lambda other: 1.0, source_method_2(robot), robot) is None


def test_notes_state_the_unit_of_a_sliding_joint(tmp_path: Path) -> None:
    """It said 50 rad/s² of joints that slide, too."""
    arm(tmp_path)
    text = (tmp_path / "arm.urdf").read_text().replace('name="j1" type="revolute"', 'name="j1" type="prismatic"')
    (tmp_path / "arm.urdf").write_text(text)
    robot = load_robot(tmp_path / "arm.urdf")
    found = {row.joint: row.note for row in assumptions(robot, []) if row.what == "acceleration"}
    assert found["j1"].endswith("no more than 50 m/s²") and found["j2"].endswith("no more than 50 rad/s²")
