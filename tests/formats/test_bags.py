"""Bags that rosbags writes, of every kind, and ours read back by it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.formats import read, read_trajectory
from energy_opt.formats.bags import write_mcap
from energy_opt.front.importing import import_logs, unpack
from energy_opt.motion.trajectory import Trajectory
from energy_opt.tables import read_table

JOINTS = ("a", "b")
TIMES = [0, 500_000_000, 1_250_000_000]
Q, V = np.array([[0.1, 0.2], [0.5, 0.1], [0.7, -1 / 3]]), np.array([[0.0, 0.0], [0.3, -0.2], [0.0, 0.0]])
# MoveIt's messages, from its own definitions, cut down to what a trajectory needs
MOVEIT = """
string model_id
moveit_msgs/RobotTrajectory[] trajectory
moveit_msgs/RobotState trajectory_start
================================================================================
MSG: moveit_msgs/RobotTrajectory
trajectory_msgs/JointTrajectory joint_trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory
================================================================================
MSG: moveit_msgs/RobotState
sensor_msgs/JointState joint_state
bool is_diff
"""


def types(ros1: bool = False) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if not ros1:
        store.register(get_types_from_msg(MOVEIT, "moveit_msgs/msg/DisplayTrajectory"))
    return store


def joint_trajectory(store: Any, ros1: bool = False, scale: float = 1.0) -> Any:
    t = store.types
    stamp, duration = t["builtin_interfaces/msg/Time"], t["builtin_interfaces/msg/Duration"]
    seq = {"seq": 0} if ros1 else {}
    none = np.zeros(0)
    points = [
        t["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=scale * q[::-1].copy(), velocities=v[::-1].copy(), accelerations=none, effort=none,
            time_from_start=duration(sec=total // 10**9, nanosec=total % 10**9),
        )
        for q, v, total in zip(Q, V, TIMES, strict=True)
    ]  # fmt: skip
    header = t["std_msgs/msg/Header"](stamp=stamp(sec=7, nanosec=0), frame_id="", **seq)
    return t["trajectory_msgs/msg/JointTrajectory"](header=header, joint_names=["b", "a"], points=points)


def write_plan(path: Path, storage: StoragePlugin) -> None:
    """A state, an older plan and the plan itself, within a DisplayTrajectory."""
    store = types()
    t = store.types
    header = t["std_msgs/msg/Header"](t["builtin_interfaces/msg/Time"](sec=0, nanosec=0), "")
    state = t["sensor_msgs/msg/JointState"](header, ["a", "b"], Q[0], np.zeros(0), np.zeros(0))
    nothing = t["trajectory_msgs/msg/MultiDOFJointTrajectory"](header, [], [])
    part = t["moveit_msgs/msg/RobotTrajectory"](joint_trajectory(store), nothing)
    display = t["moveit_msgs/msg/DisplayTrajectory"]("arm", [part], t["moveit_msgs/msg/RobotState"](state, False))
    with Writer(path, version=9, storage_plugin=storage) as writer:
        for k, (topic, message) in enumerate(
            [("/joint_states", state), ("/plan", joint_trajectory(store, scale=2.0)), ("/display", display)]
        ):
            kind = message.__msgtype__
            connection = writer.add_connection(topic, kind, typestore=store)
            writer.write(connection, k, store.serialize_cdr(message, kind))


def check(curve: Trajectory) -> None:
    np.testing.assert_array_equal(curve.position, Q)
    np.testing.assert_array_equal(curve.velocity, V)
    np.testing.assert_array_equal(curve.time, [0.0, 0.5, 1.25])


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3], ids=["mcap", "sqlite3"])
def test_bags_of_ros2(tmp_path: Path, storage: StoragePlugin) -> None:
    write_plan(tmp_path / "bag", storage)
    rows = read(tmp_path / "bag")
    check(rows.of(JOINTS).trajectory())
    assert "2 planned trajectories; the last is taken" in rows.notes[0]
    (file,) = (*(tmp_path / "bag").glob("*.mcap"), *(tmp_path / "bag").glob("*.db3"))
    check(read_trajectory(file, JOINTS))


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE], ids=["file", "message"])
def test_compressed_bags(tmp_path: Path, mode: CompressionMode) -> None:
    """As `ros2 bag record --compression-mode` makes them: by the folder, or by its only file."""
    store, kind = types(), "trajectory_msgs/msg/JointTrajectory"
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/plan", kind, typestore=store)
        writer.write(connection, 0, store.serialize_cdr(joint_trajectory(store), kind))
    (file,) = (x for x in (tmp_path / "bag").iterdir() if x.name != "metadata.yaml")
    check(read_trajectory(tmp_path / "bag", JOINTS))
    check(read_trajectory(file, JOINTS))
    alone = tmp_path / file.name
    alone.write_bytes(file.read_bytes())
    with pytest.raises(BadInput, match="compressed bag" if mode is CompressionMode.FILE else "not a readable bag"):
        read_trajectory(alone, JOINTS)


def test_old_bags_without_definitions(tmp_path: Path) -> None:
    """Of ROS 2 Humble and before: sqlite3 without the table of definitions."""
    import sqlite3
    from contextlib import closing

    write_plan(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = (tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(file)) as connection, connection as base:
        base.execute("DELETE FROM message_definitions")
        base.execute("DELETE FROM topics WHERE name = '/display'")
    check(Trajectory(JOINTS, *_halved(read_trajectory(file, JOINTS))))


def _halved(curve: Trajectory) -> tuple[np.ndarray, ...]:
    """The older plan has twice the positions."""
    return curve.time, curve.position / 2, curve.velocity, curve.acceleration


def test_bags_of_ros1(tmp_path: Path) -> None:
    store = types(ros1=True)
    kind = "trajectory_msgs/msg/JointTrajectory"
    with Writer1(tmp_path / "plan.bag") as writer:
        connection = writer.add_connection("/plan", kind, typestore=store)
        writer.write(connection, 0, store.serialize_ros1(joint_trajectory(store, ros1=True), kind))
    check(read_trajectory(tmp_path / "plan.bag", JOINTS))


def test_ours_is_read_by_rosbags(tmp_path: Path) -> None:
    curve = Trajectory(JOINTS, np.array([1.0, 1.5, 2.25]), Q, V, Q / 7, effort=Q * 11)
    write_mcap(curve, tmp_path / "t.mcap")
    with AnyReader([tmp_path / "t.mcap"]) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/joint_trajectory", "trajectory_msgs/msg/JointTrajectory")
        ((_, _, raw),) = reader.messages()
        message: Any = reader.deserialize(raw, connection.msgtype)
    assert message.joint_names == list(JOINTS)
    for k, point in enumerate(message.points):
        for field, block in (("positions", Q), ("velocities", V), ("accelerations", Q / 7), ("effort", Q * 11)):
            np.testing.assert_array_equal(getattr(point, field), block[k])
        assert point.time_from_start.sec * 10**9 + point.time_from_start.nanosec == TIMES[k]
    again = read_trajectory(tmp_path / "t.mcap", ("b", "a"))
    np.testing.assert_array_equal(again.effort, Q[:, ::-1] * 11)


def test_bags_that_cannot_be_read(tmp_path: Path) -> None:
    write_plan(tmp_path / "bag", StoragePlugin.MCAP)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    data = file.read_bytes()
    for k, broken in enumerate([b"", data[:100], data[: len(data) // 2], data[:-20], b"\0" * 500]):
        (tmp_path / f"{k}.mcap").write_bytes(broken)
        with pytest.raises(BadInput, match="not a readable bag") as caught:
            read(tmp_path / f"{k}.mcap")
        assert "\n" not in str(caught.value)
    rng = np.random.default_rng(0)
    for _ in range(25):  # a byte changed anywhere: read, or refused in one line
        noisy = bytearray(data)
        noisy[rng.integers(len(noisy))] = rng.integers(256)
        (tmp_path / "noisy.mcap").write_bytes(noisy)
        try:
            read(tmp_path / "noisy.mcap")
        except BadInput as error:
            assert "\n" not in str(error)
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information: 1\n")
    with pytest.raises(BadInput, match="not a readable bag"):
        read(tmp_path / "bag")
    with pytest.raises(BadInput, match="No such file"):
        read(tmp_path / "absent.mcap")


def test_a_bag_without_a_plan_names_its_topics(tmp_path: Path) -> None:
    store = types()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/power", "std_msgs/msg/Float64", typestore=store)
        message = store.types["std_msgs/msg/Float64"](3.0)
        writer.write(connection, 0, store.serialize_cdr(message, "std_msgs/msg/Float64"))
    with pytest.raises(BadInput, match=r"no planned trajectory; its topics are /power \(std_msgs/msg/Float64\)"):
        read(tmp_path / "bag")


def recorded(
    path: Path, power: str, ros1: bool = False, parts: tuple[int, ...] = (7,)
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A bag of an arm at 50 Hz, a gripper beside it, and its power at 20 Hz as `power` says; time, positions, watts."""
    store = types(ros1)
    t = store.types
    time_of, seq = t["builtin_interfaces/msg/Time"], {"seq": 0} if ros1 else {}
    none, names = np.zeros(0), [f"panda_joint{k}" for k in range(1, 8)]
    joints = np.arange(0, 4, 0.02)
    q = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785]) + 0.2 * np.sin(joints)[:, None]
    meter = np.arange(0.01, 4, 0.05)
    watts = 90 + 5 * np.sin(meter)
    kinds = {
        "power": [("/arm/power", "std_msgs/msg/Float64", lambda w: {"data": w})],
        "pair": [("/volts", "std_msgs/msg/Float32", lambda w: {"data": 48.0}),
                 ("/bus_current", "std_msgs/msg/Float64", lambda w: {"data": w / 48})],
        "motors": [("/power_limit", "std_msgs/msg/Float64", lambda w: {"data": 500.0}),
                   ("/joint_1/motor_power", "std_msgs/msg/Float64", lambda w: {"data": w / 7}),
                   ("/robot/power_kW", "std_msgs/msg/Float64", lambda w: {"data": w / 1000})],
        "clamp": [("/clamp/position", "std_msgs/msg/Float64", lambda w: {"data": 0.1}),
                  ("/joint_1/voltage", "std_msgs/msg/Float64", lambda w: {"data": 24.0}),
                  ("/supply/voltage", "std_msgs/msg/Float64", lambda w: {"data": 48.0}),
                  ("/supply/current_mA", "std_msgs/msg/Float64", lambda w: {"data": w / 0.048})],
        "reversed": [("/power", "std_msgs/msg/Float64", lambda w: {"data": -w})],
        "one motor": [("/joint_1/motor_power", "std_msgs/msg/Float64", lambda w: {"data": w / 7})],
    }  # fmt: skip
    writer = Writer1(path) if ros1 else Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:

        def topic(name: str, kind: str) -> Any:
            return writer.add_connection(name, kind, typestore=store)

        def put(connection: Any, when: float, kind: str, fields: dict[str, Any]) -> None:
            raw = (store.serialize_ros1 if ros1 else store.serialize_cdr)(t[kind](**fields), kind)
            writer.write(connection, round(when * 1e9), raw)

        state, gripper = "sensor_msgs/msg/JointState", topic("/gripper", "sensor_msgs/msg/JointState")
        arm = topic("/joint_states", state)
        for k, (when, row) in enumerate(zip(joints, q, strict=True)):
            nanoseconds, way = round((100 + when) * 1e9), (-1) ** k  # the order of the joints changes
            header = t["std_msgs/msg/Header"](stamp=time_of(*divmod(nanoseconds, 10**9)), frame_id="", **seq)
            for end, many in zip(np.cumsum(parts).tolist(), parts, strict=True):
                own = slice(end - many, end)
                put(arm, 100.005 + when, state,
                    {"header": header, "name": names[own][::way], "position": row[own][::way].copy(), "effort": none,
                     "velocity": np.full(many, np.nan) if k == 9 else np.ones(many)})  # fmt: skip
            put(gripper, 100 + when, state,
                {"header": header, "name": ["finger"], "position": none, "velocity": none, "effort": none})  # fmt: skip
        if power == "battery":
            kind = "sensor_msgs/msg/BatteryState"
            connection = topic("/battery", kind)
            blank = dict.fromkeys(("temperature", "charge", "capacity", "design_capacity", "percentage"), np.nan)
            states = dict.fromkeys(("power_supply_status", "power_supply_health", "power_supply_technology"), 0)
            for when, w in zip(meter, watts, strict=True):
                header = t["std_msgs/msg/Header"](time_of(*divmod(round((100 + when) * 1e9), 10**9)), "", **seq)
                put(connection, 100 + when, kind, {
                    "header": header, "voltage": 24.0, "current": -w / 24, **blank, **states, "present": True,
                    "cell_voltage": np.zeros(0, np.float32), "cell_temperature": np.zeros(0, np.float32),
                    "location": "", "serial_number": "",
                })  # fmt: skip
        else:
            for name, kind, fields in kinds[power]:
                connection = topic(name, kind)
                for when, w in zip(meter, watts, strict=True):
                    put(connection, 100 + when, kind, fields(w))
    return joints, q, np.column_stack([meter, watts])


@pytest.mark.parametrize(
    ("power", "ros1"),
    [("power", False), ("pair", False), ("battery", False), ("motors", False), ("clamp", False), ("power", True)],
)
def test_recordings_are_unpacked(tmp_path: Path, power: str, ros1: bool) -> None:
    bag = tmp_path / ("run.bag" if ros1 else "run")
    joints, q, meter = recorded(bag, power, ros1)
    files, notes = unpack(bag, tmp_path / "tables")
    assert [file.name for file in files] == ["run.csv", "run_power.csv"]
    arm, watts = (read_table(file) for file in files)
    assert arm["time"] == pytest.approx(joints, abs=1e-6) and "panda_joint1.velocity" not in arm
    np.testing.assert_array_equal(arm["panda_joint3.position"], q[:, 2])
    assert watts["time"] == pytest.approx(meter[:, 0], abs=1e-6)
    assert watts["power"] == pytest.approx(meter[:, 1], rel=1e-6)
    assert "7 joints" in notes[0] and notes[2].endswith("velocity is left out: no number for each joint at 1 stamps")


@pytest.mark.parametrize("parts", [(3, 4), (4, 2, 1)])
def test_joints_of_one_arm_in_several_messages_are_merged(tmp_path: Path, parts: tuple[int, ...]) -> None:
    joints, q, _ = recorded(tmp_path / "run", "power", parts=parts)
    files, notes = unpack(tmp_path / "run", tmp_path / "tables")
    arm = read_table(files[0])
    assert arm["time"] == pytest.approx(joints, abs=1e-6)
    for k in range(7):
        np.testing.assert_array_equal(arm[f"panda_joint{k + 1}.position"], q[:, k])
    said = "\n".join(notes)
    assert "7 joints, 200 messages" in said and "messages with the same stamps are merged: /joint_states, panda" in said
    assert main(["import", str(tmp_path / "run"), "--out", str(tmp_path / "set"), "--robot", "panda", "--quiet"]) == 0


def test_a_bag_is_imported_as_a_measured_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path / "run", "power")
    assert main(["import", str(tmp_path / "run"), "--out", str(tmp_path / "set"), "--robot", "panda", "--json"]) == 0
    guesses = json.loads(capsys.readouterr().out)["guesses"]  # what was read from the bag was printed only
    assert any("joint states of /joint_states: 7 joints, 200 messages" in line for line in guesses)
    assert main(["check", str(tmp_path / "set"), "--quiet"]) == 0
    write_plan(tmp_path / "plan", StoragePlugin.MCAP)
    with pytest.raises(BadInput, match="fewer than two joint states"):
        unpack(tmp_path / "plan", tmp_path)
    recorded(tmp_path / "motor", "one motor")
    with pytest.raises(BadInput, match="no power of the whole robot"):
        unpack(tmp_path / "motor", tmp_path)


def test_a_fault_of_a_bags_table_does_not_name_a_file_that_is_gone(tmp_path: Path) -> None:
    recorded(tmp_path / "run", "reversed")
    with pytest.raises(BadInput, match=r"^made of the bag, run_power\.csv: row 2, column power: is never above 0"):
        import_logs([tmp_path / "run"], out=tmp_path / "set", robot="panda")
