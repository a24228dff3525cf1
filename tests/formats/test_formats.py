"""Files of the field: tables and messages that others wrote, matched by joint name, and our own read back."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from energy_opt.errors import BadInput
from energy_opt.formats import messages, read, read_path, read_trajectory, table
from energy_opt.motion.trajectory import Trajectory

JOINTS = ("a", "b")
WAYPOINTS = np.array([[0.0, 0.1], [0.7, 0.6], [1.1, -0.2], [1.5, -0.9]])


def wave(rows: int) -> Trajectory:
    """sin(t) and t^5 / 100 - t^2 over 2 s."""
    t = np.linspace(1.0, 3.0, rows)
    q = np.column_stack([np.sin(t), t**5 / 100 - t**2])
    v = np.column_stack([np.cos(t), t**4 / 20 - 2 * t])
    a = np.column_stack([-np.sin(t), t**3 / 5 - 2])
    return Trajectory(JOINTS, t, q, v, a)


def test_csv_round_trip_matches_joints_by_name(tmp_path: Path) -> None:
    curve = replace(wave(9), effort=np.arange(18.0).reshape(9, 2) / 7, power=np.arange(9.0))
    table.write(curve, tmp_path / "t.csv")
    header = "time,a.position,b.position,a.velocity,b.velocity,a.acceleration,b.acceleration,a.effort,b.effort,power"
    assert (tmp_path / "t.csv").read_text().splitlines()[0] == header
    again = read_trajectory(tmp_path / "t.csv", ("b", "a"))
    np.testing.assert_array_equal(again.position, curve.position[:, ::-1])
    np.testing.assert_array_equal(again.acceleration, curve.acceleration[:, ::-1])
    np.testing.assert_array_equal(again.effort, curve.effort[:, ::-1])


@pytest.mark.parametrize("header", ["time,a.position,b.position", "time,a,b"])
def test_positions_alone_are_enough(tmp_path: Path, header: str) -> None:
    t = np.linspace(0, 1, 101)
    lines = [header, *(f"{x!r},{float(np.sin(x))!r},{x!r}" for x in t.tolist())]
    (tmp_path / "t.csv").write_text("\n".join(lines))
    curve = read_trajectory(tmp_path / "t.csv", JOINTS)
    np.testing.assert_allclose(curve.velocity[:, 0], np.cos(t), atol=1e-5)
    np.testing.assert_allclose(curve.acceleration[:, 0], -np.sin(t), atol=1e-2)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a.position,b.position\n0,0\n1,1\n", "waypoints without times"),
        ("time,a.position\n0,0\n1,1\n", "joint b is missing; the file has a"),
        (
            "time,a.position,a.velocity,b.position\n0,0,0,0\n1,1,1,1\n",
            "column b.velocity is missing, though a.velocity",
        ),
        ("time,power\n0,0\n1,1\n", "no column <joint>.position; columns are time, power"),
        ("time,a.position,b.position\n0,0,0\n1,1,1\n1,2,2\n", "row 4, column time: 1 does not come after 1"),
        ("time,a.position,b.position\n0,0,0\n", "one row"),
        ("time,left_a,left_b\n0,0,0\n1,1,1\n", "the file has left_a, left_b; they fit with"),
    ],
)
def test_faulty_trajectories(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(BadInput) as caught:
        read_trajectory(tmp_path / "t.csv", JOINTS)
    assert says in str(caught.value)


def test_tables_that_are_nearly_ours_say_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    for header in ("t", "Time", "timestamp", "ms"):
        path.write_text(f"{header},a,b\n0,1,2\n1,2,3\n")
        assert read(path).time is None
        said = f"expected a column time [s], or with its unit, such as time_ms; found {header!r}, which is not read"
        assert said in read(path).notes[0]
        with pytest.raises(BadInput, match=re.escape(said)):
            read_trajectory(path, JOINTS)
    path.write_text("time;a;b\n0;1,5;2\n1;2;3\n")
    with pytest.raises(BadInput, match="row 1: columns are separated by ';'; expected commas, and points in numbers"):
        read(path)
    path.write_text("time,a,b\n0,1,2\n1000000000,2,3\n")
    with pytest.raises(BadInput, match=r"lasts 1e\+09 s; expected at most 100000 \(are its times in ms, us or ns"):
        read(path)


@pytest.mark.parametrize(
    ("header", "step"),
    [
        ("time_ms", 5.0),
        ("t_ms", 5.0),
        ("timestamp [us]", 5000.0),
        ("time(s)", 0.005),
        ("Elapsed_NS", 5e6),
        ("t_s", 0.005),
    ],
)
def test_times_have_the_unit_of_their_header(tmp_path: Path, header: str, step: float) -> None:
    """They had been called waypoints without times."""
    path = tmp_path / "t.csv"
    for names in ("a,b", "a.position,b.position"):
        path.write_text(f"{header},{names}\n" + "".join(f"{k * step},{k / 10},{k}\n" for k in range(9)))
        found = read_trajectory(path, JOINTS)
        np.testing.assert_allclose(found.time, np.arange(9) * 0.005, rtol=1e-12)
        np.testing.assert_allclose(found.position[:, 1], np.arange(9.0))
        path.write_text(f"{header},{names}\n0,0,0\n2,1,1\n1,1,1\n")
        with pytest.raises(BadInput, match=re.escape(f"row 4, column {header}: 1 does not come after 2")):
            read(path)


def test_waypoints_and_trajectories_are_paths(tmp_path: Path) -> None:
    lines = ["b.position,a.position", *(f"{b!r},{a!r}" for a, b in WAYPOINTS.tolist())]
    (tmp_path / "waypoints.csv").write_text("\n".join(lines))
    path = read_path(tmp_path / "waypoints.csv", JOINTS)
    assert path(path.knots) == pytest.approx(WAYPOINTS)
    assert path.source is None
    table.write(wave(30), tmp_path / "trajectory.csv")
    path = read_path(tmp_path / "trajectory.csv", JOINTS)
    assert path.source is not None and path.source.duration == 2.0


ROS1 = {"header": {"seq": 0, "stamp": {"secs": 0, "nsecs": 0}, "frame_id": ""}}


def points(ros1: bool = False, kinds: tuple[str, ...] = ("positions", "velocities", "accelerations")) -> list[Any]:
    """Points of `wave` as a message has them, by hand; joints in the order b, a."""
    curve, out = wave(5), []
    for k, nanoseconds in enumerate([0, 500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000]):
        whole, part = divmod(nanoseconds, 10**9)
        stamp = {"secs": whole, "nsecs": part} if ros1 else {"sec": whole, "nanosec": part}
        values = {"positions": curve.position, "velocities": curve.velocity, "accelerations": curve.acceleration}
        point: dict[str, Any] = {name: values[name][k, ::-1].tolist() if name in kinds else [] for name in values}
        out.append({**point, "effort": [], "time_from_start": stamp})
    return out


def joint_trajectory(**how: Any) -> dict[str, Any]:
    return {"header": {"frame_id": "world"}, "joint_names": ["b", "a", "gripper"][:2], "points": points(**how)}


NO_DOFS = {"multi_dof_joint_trajectory": {"joint_names": [], "points": []}}
WRAPPED = {
    "JointTrajectory": joint_trajectory(),
    "RobotTrajectory": {"joint_trajectory": joint_trajectory(), **NO_DOFS},
    "DisplayTrajectory": {
        "model_id": "arm",
        "trajectory": [
            {"joint_trajectory": {**joint_trajectory(), "points": points()[:3]}, **NO_DOFS},
            {"joint_trajectory": {**joint_trajectory(), "points": points()[2:]}, **NO_DOFS},
        ],
        "trajectory_start": {"joint_state": {"name": ["b", "a"], "position": [0.0, 0.0]}},
    },
    "FollowJointTrajectory": {"goal": {"trajectory": joint_trajectory(), "path_tolerance": []}},
    "ExecuteTrajectory": {"trajectory": {"joint_trajectory": joint_trajectory(), **NO_DOFS}, "controller_names": []},
    "ROS 1 goal": {**ROS1, "goal_id": {"id": "x"}, "goal": {"trajectory": {**ROS1, **joint_trajectory(ros1=True)}}},
}


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@pytest.mark.parametrize("name", WRAPPED)
def test_messages_are_read_at_any_level_of_the_document(tmp_path: Path, name: str, suffix: str) -> None:
    file = tmp_path / f"message{suffix}"
    text = yaml.safe_dump(WRAPPED[name]) + "---\n" if suffix == ".yaml" else json.dumps(WRAPPED[name])
    file.write_text(text)
    curve, expected = read_trajectory(file, JOINTS), wave(5)
    np.testing.assert_array_equal(curve.position, expected.position)
    np.testing.assert_array_equal(curve.velocity, expected.velocity)
    np.testing.assert_array_equal(curve.acceleration, expected.acceleration)
    np.testing.assert_array_equal(curve.time, [0.0, 0.5, 1.0, 1.5, 2.0])


def test_a_plan_without_velocities_begins_and_ends_at_rest(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(joint_trajectory(kinds=("positions",))))
    curve = read_trajectory(tmp_path / "m.yaml", JOINTS)
    assert not curve.velocity[[0, -1]].any() and np.abs(curve.velocity[1:-1]).min() > 0.01


def test_points_without_times_are_waypoints_and_the_last_plan_counts(tmp_path: Path) -> None:
    first, last = joint_trajectory(), joint_trajectory()
    last["points"] = [{"positions": [b, a]} for a, b in WAYPOINTS.tolist()]
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(first) + "---\n" + yaml.safe_dump(last) + "---\n")
    rows = read(tmp_path / "m.yaml")
    np.testing.assert_array_equal(rows.of(JOINTS).position, WAYPOINTS)
    assert rows.time is None and "2 planned trajectories; the last is taken" in rows.notes[0]


def test_names_with_a_prefix(tmp_path: Path) -> None:
    message = joint_trajectory()
    message["joint_names"] = ["left_b", "left_a"]
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(message))
    with pytest.raises(BadInput, match="joint a is missing; the file has left_b, left_a; they fit with"):
        read_trajectory(tmp_path / "m.yaml", JOINTS)
    curve = read_trajectory(tmp_path / "m.yaml", JOINTS, "left_")
    assert curve.joints == JOINTS
    np.testing.assert_array_equal(curve.position, wave(5).position)


@pytest.mark.parametrize("writer", [messages.write_yaml, messages.write_json_file, messages.write_goal])
def test_written_messages_keep_every_digit(tmp_path: Path, writer: Any) -> None:
    """Read back by another library, and by us: what was written, times to the nanosecond."""
    file = tmp_path / ("m.json" if writer is messages.write_json_file else "m.yaml")
    curve = replace(wave(7), joints=("it's: a", "b"), effort=np.full((7, 2), 1e-16) * np.arange(14).reshape(7, 2))
    writer(curve, file)
    message = (json.loads if file.suffix == ".json" else yaml.safe_load)(file.read_text())
    message = message.get("trajectory", message)
    assert message["joint_names"] == list(curve.joints)
    for k, point in enumerate(message["points"]):
        assert point["positions"] == curve.position[k].tolist() and point["effort"] == curve.effort[k].tolist()
        assert point["velocities"] == curve.velocity[k].tolist()
        assert point["accelerations"] == curve.acceleration[k].tolist()
        stamp = point["time_from_start"]
        assert 0 <= stamp["nanosec"] < 10**9 and abs(stamp["sec"] + stamp["nanosec"] / 1e9 - k / 3) < 0.6e-9
    again = read_trajectory(file, curve.joints)
    np.testing.assert_array_equal(again.position, curve.position)
    np.testing.assert_allclose(again.time, curve.time - 1.0, atol=0.6e-9)


def broken(**changed: Any) -> dict[str, Any]:
    message = joint_trajectory()
    message["points"][1].update(changed)
    return message


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (broken(positions=[1.0]), "points[1].positions: 1 numbers; the message names 2 joints"),
        (broken(positions=[1.0, "x"]), "points[1].positions: 'x' is not a number"),
        (broken(positions=[1.0, True]), "points[1].positions: True is not a number"),
        (broken(positions=[1.0, float("nan")]), "points[1].positions: nan is not finite"),
        (broken(positions=[10**400, 1.0]), "is not a number"),
        (broken(positions=[1.0, "..."]), "ros2 topic echo --full-length"),
        (broken(velocities=[]), "points[1].velocities is missing"),
        (broken(time_from_start={"sec": 0, "nanosec": 0}), "points[1].time_from_start: 0 s does not come after 0 s"),
        (broken(time_from_start={"s": 0}), "points[1].time_from_start: expected {sec, nanosec}; found s"),
        ({"joint_names": ["a", "a"], "points": points()}, "joint_names: a is given twice"),
        ({"joint_names": ["a", "b"], "points": []}, "points is not a list of points"),
        ({"joint_limits": {}}, "no planned trajectory"),
        (["just", "words"], "no planned trajectory"),
    ],
)
def test_faulty_messages_are_named(tmp_path: Path, message: Any, says: str) -> None:
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(message))
    with pytest.raises(BadInput, match=r"m\.yaml: ") as caught:
        read(tmp_path / "m.yaml")
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_parts_of_a_display_trajectory_must_follow_each_other(tmp_path: Path) -> None:
    message = json.loads(json.dumps(WRAPPED["DisplayTrajectory"]))
    message["trajectory"][1]["joint_trajectory"]["points"][0]["positions"][0] += 0.1
    (tmp_path / "m.json").write_text(json.dumps(message))
    with pytest.raises(BadInput, match="does not begin where the one before it ends"):
        read(tmp_path / "m.json")


def test_files_of_unknown_kind(tmp_path: Path) -> None:
    (tmp_path / "t.xyz").write_text("1 2 3")
    with pytest.raises(BadInput, match=r"known are \.csv, \.yaml, \.yml, \.json"):
        read(tmp_path / "t.xyz")


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".csv"])
def test_noise_is_read_or_refused_with_the_file(tmp_path: Path, suffix: str) -> None:
    """Bytes of a good file changed, cut out or doubled: rows, or lines that name the file."""
    rng, file = np.random.default_rng(1), tmp_path / f"noisy{suffix}"
    if suffix == ".csv":
        table.write(wave(5), file)
    else:
        writer = messages.write_yaml if suffix == ".yaml" else messages.write_json_file
        writer(wave(5), file)
    good, refused = file.read_bytes(), 0
    for _ in range(60):
        noisy = bytearray(good)
        at = int(rng.integers(len(noisy)))
        if rng.random() < 0.5:
            noisy[at] = int(rng.integers(256))
        elif rng.random() < 0.5:
            del noisy[at : at + int(rng.integers(1, 40))]
        else:
            noisy[at:at] = noisy[at : at + int(rng.integers(1, 40))]
        file.write_bytes(noisy)
        try:
            read_trajectory(file, JOINTS)
        except BadInput as error:
            refused += 1
            assert all(line.startswith(str(file)) for line in str(error).splitlines())
    assert refused > 10
