"""`import`: logs as labs have them to a measured set, real recordings among them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from logs import PANDA, SIX, Z1, arm, lines, log, put

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set, nodes, operator, read_set
from energy_opt.measured.importing import import_files
from energy_opt.measured.table import Table
from energy_opt.robot import load_robot

FIG9 = Path(__file__).resolve().parents[3] / "shared/data/rad_ur3e_power/fig9.csv"


def test_degrees_milliseconds_kilowatts_are_converted_and_reported(tmp_path, capsys):
    t, q, v, p = arm(Z1)
    header = "ms;" + ";".join(
        [*(f"Achse {k}" for k in range(1, 7)), *(f"Achse {k} speed" for k in range(1, 7)), "Leistung"]
    )
    text = lines(header, [1000 * t, np.degrees(q), np.degrees(v), p / 1000], "%.7f", ";").replace(".", ",")
    path = put(tmp_path / "a.csv", text)
    assert main(["import", str(path), "--robot", "z1", "--out", str(tmp_path / "set"), "--json"]) == 0
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert "degrees" in printed.err and "deg/s" in printed.err and "kW" in printed.err
    assert document["log"]["columns"]["time"] == {"column": "ms", "unit": "ms"}
    assert inspect_set(tmp_path / "set")[0] == []
    whole = read_set(tmp_path / "set")
    first = whole.runs[0]
    np.testing.assert_allclose(first.position, q[: len(first.time)], atol=1e-6)
    np.testing.assert_allclose(first.power, p[: len(first.power)], atol=1e-3)
    assert main(["import", str(path), "--robot", "z1", "--out", str(tmp_path / "set"), "--quiet"]) == 2


def test_files_in_different_units_are_named_in_words(tmp_path):
    t, q, _, p = arm(Z1)
    names = ",".join(f"{joint}.position" for joint in Z1.joints)
    files = [
        put(tmp_path / f"{unit}.csv", lines(f"time,{names},power", [t, factor * q, p]))
        for unit, factor in (("deg", 180 / np.pi), ("rad", 1.0))
    ]
    with pytest.raises(BadInput, match=r"joint1\.position' in rad, in .* it is column 'joint1\.position' in deg"):
        import_files(files, tmp_path / "set", Z1)


def test_a_reading_far_beyond_the_others_is_dropped_and_named(tmp_path):
    t, q, _, p = arm(Z1)
    names = ",".join(f"{joint}.position" for joint in Z1.joints)
    damaged = p.copy()
    damaged[[40, 90, 160]] = 1e6, -65535.0, 0.0
    put(tmp_path / "a.csv", lines(f"time,{names},power", [t, q, damaged]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')
    measured = read_set(tmp_path)
    assert np.abs(measured.runs[0].power).max() < 2 * p.max() and len(measured.runs[0].power) == len(p) - 3
    assert any(
        "3 readings are left out: the power jumps and returns at once (first: row 42)" in x for x in measured.remarks
    )


@pytest.mark.parametrize(("most", "step"), [(130.0, 0.0), (130.0, 0.5), (np.inf, 0.0), (np.inf, 0.5), (np.inf, 10.0)])
def test_readings_at_the_end_of_a_meters_range_are_left_out(tmp_path, most, step):
    t, q, _, p = arm(Z1)
    p = np.minimum(p + np.random.default_rng(1).normal(size=len(p)), most)
    p = np.round(p / step) * step if step else p
    names = ",".join(f"{joint}.position" for joint in Z1.joints)
    put(tmp_path / "a.csv", lines(f"time,{names},power", [t, q, p]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')
    measured = read_set(tmp_path)
    kept = p < most
    assert measured.runs[0].power == pytest.approx(p[kept], abs=1e-5) and kept.mean() > 0.5
    assert any("the meter's range seems to end there" in x for x in measured.remarks) == (not kept.all())


def test_files_are_paired_and_runs_ordered(tmp_path):
    for k, begin in ((2, 100.0), (10, 0.0)):
        t, q, _, p = arm(Z1)
        put(tmp_path / f"motion_{k}.csv", lines("t," + ",".join(f"q{j}" for j in SIX), [1.7e9 + begin + t, q]))
        put(tmp_path / f"meter_{k}.csv", lines("t,power", [1.7e9 + begin + t[::4], p[::4] + k]))
    made = import_files(sorted(tmp_path.glob("*.csv")), tmp_path / "set", Z1)
    rows = [(row["file"], row["power_file"], row["start"]) for row in made.log["run"]]
    assert rows == [("motion_10.csv", "meter_10.csv", 0.0), ("motion_2.csv", "meter_2.csv", 100.0)]
    assert made.runs[0].power[0] == pytest.approx(70) and read_set(tmp_path / "set").clock


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time,b\n0,2\n1,2\n", "neither joints' positions nor power"),
        ("time,q0,q1,q2,q3,q4,q5,power\n" + "0,0,1,-1,0,0,0,5\n" * 9, "no column of times that increase"),
        (
            "time,q0,q1,q2,q3,q4,q5,power\n" + "".join(f"{k},0,1,-1,0,0,x,5\n" for k in range(9)),
            "column q5: 'x' is not",
        ),
        ("time,q0,q1,q2,q3,q4,q5,power\n" + "".join(f"{k / 9},0,1,-1,0,0,0,0\n" for k in range(9)), "is 0 throughout"),
        (
            "time,q0,q1,q2,q3,q4,q5,power\n" + "".join(f"{k / 9},0,1,-1,0,0,0,{-5 - k}\n" for k in range(9)),
            "column power: is never above 0; is its sign reversed?",
        ),
        (  # a whole recording shorter than the tenth of a second over which speeds are taken
            "time_ms,q0,q1,q2,q3,q4,q5,power\n" + "".join(f"{k / 100},{k / 1e6},1,-1,0,0,0,5\n" for k in range(60)),
            "is the time's unit right?",
        ),
    ],
)
def test_unusable_files_are_reported_and_nothing_is_written(tmp_path, capsys, text, expected):
    path = put(tmp_path / "a.csv", text)
    assert main(["import", str(path), "--robot", "z1", "--out", str(tmp_path / "set")]) == 2
    error = capsys.readouterr().err
    assert expected in error and "a.csv" in error and not (tmp_path / "set").exists()


def test_several_arms_have_such_columns(tmp_path):
    path = put(
        tmp_path / "a.csv", "time,q0,q1,q2,q3,q4,q5,power\n" + "".join(f"{k / 9},0,1,-1,0,0,0,5\n" for k in range(9))
    )
    with pytest.raises(BadInput, match="say which with"):
        import_files([path], tmp_path / "set")


def test_other_readers_refuse_degrees(tmp_path, capsys):
    words = ["optimize", "--robot", "panda", "--out", str(tmp_path / "out")]
    assert main([*words, "--start", "0,-45,0,-135,0,90,45", "--goal", "0,0,0,-90,0,90,0"]) == 2
    assert "-45 rad for panda_joint2" in capsys.readouterr().err
    header = "time," + ",".join(f"{joint}.position" for joint in PANDA.joints)
    path = put(tmp_path / "move.csv", f"{header}\n0,0,-45,0,-135,0,90,45\n2,0,0,0,-90,0,90,0\n")
    assert main([*words, "--path", str(path)]) == 2 and main(["check", str(path)]) == 2
    assert capsys.readouterr().err.count("look like degrees") == 2


def test_many_turns_of_a_joint_without_limits_are_not_refused(tmp_path, capsys):
    kinova = load_robot("kinova")
    t = np.linspace(0.0, 300.0, 301)
    q = np.tile([0.0, 2, 2, 0, 2, 0], (len(t), 1))
    q[:, 0] = 100 * (3 * (t / 300) ** 2 - 2 * (t / 300) ** 3)
    header = ",".join(f"{joint}.position" for joint in kinova.joints)
    path = put(tmp_path / "turns.csv", lines(f"time,{header}", [t, q], "%.9f"))
    assert main(["evaluate", str(path), "--robot", "kinova", "--out", str(tmp_path / "eval")]) == 0
    assert "rad for j2s6s200_joint_1 is 15.9 turns; if" in capsys.readouterr().err
    goal = ["--start", "0,2,2,0,2,0", "--goal", "1e6,2,2,0,2,0", "--out", str(tmp_path / "out")]
    assert main(["optimize", "--robot", "kinova", *goal]) == 2
    assert "goal: a position of 1e+06; expected at most 10000 rad" in capsys.readouterr().err
    power = ",".join(["time", *(f"{joint}.position" for joint in kinova.joints), "power"])
    put(tmp_path / "a.csv", lines(power, [t, q, 60 + t], "%.9f"))
    log(tmp_path, "kinova", '[[run]]\nfile = "a.csv"\n')
    np.testing.assert_allclose(read_set(tmp_path).runs[0].position[-1, 0], 100, atol=1e-6)


@pytest.mark.skipif(not FIG9.is_file(), reason="the shared recording is not here")
def test_a_real_recording_in_one_command(tmp_path):
    """The arm is found by its torques; the set is read as the preset written by hand."""
    assert main(["import", str(FIG9), "--out", str(tmp_path / "set"), "--quiet"]) == 0
    measured = read_set(tmp_path / "set")
    assert measured.robot.name == "ur3e" and sum(len(r.power) for r in measured.runs) == 888
    assert (
        measured.runs[0].current is not None and measured.payload is not None and inspect_set(tmp_path / "set")[0] == []
    )


@pytest.mark.skipif(not FIG9.is_file(), reason="the shared recording is not here")
@pytest.mark.parametrize("offset", [0.0, 12.0])
def test_a_real_recording_with_a_meter_of_one_hertz(tmp_path, offset):
    table = Table(FIG9)
    t = table.column("timestamp")
    p = table.column("actual_robot_voltage") * table.column("actual_robot_current")
    ends = np.arange(24, len(t), 25)
    mean = np.array([p[k - 24 : k + 1].mean() for k in ends])
    names = [f"actual_q_{k}" for k in SIX]
    put(tmp_path / "joints.csv", lines(",".join(["timestamp", *names]), [t, *(table.column(x) for x in names)], "%.9f"))
    put(tmp_path / "meter.csv", lines("Time [s],Power [W]", [t[ends] - t[0] + offset, mean]))
    import_files([tmp_path / "joints.csv", tmp_path / "meter.csv"], tmp_path / "set", load_robot("ur3e"))
    measured = read_set(tmp_path / "set")
    stamps = np.concatenate([run.start + run.power_time for run in measured.runs])
    assert len(stamps) >= 33 and all(len(run.power) >= 4 for run in measured.runs)
    assert all(run.window == pytest.approx(np.full(len(run.power), 1.0), abs=0.01) for run in measured.runs)
    assert measured.runs[0].clock == ("estimated" if offset else "shared")
    assert np.abs(stamps - (t[ends] - t[0])[: len(stamps)]).max() < (0.15 if offset else 1e-6)
    for run in measured.runs:
        at = nodes(run)
        assert math.isfinite(float((operator(run, at) @ np.ones(len(at))).sum()))


def odd_headers(tmp_path, more=""):
    """Six joints, stamps and power under headers that say nothing."""
    t, q, _, p = arm(Z1)
    names = ["A", *(f"k{'abcdef'[j]}" for j in range(6)), "leistungsaufnahme_x", *([more] if more else [])]
    columns = [1000 * t, q, p, *([p / 2] if more else [])]
    return put(tmp_path / "odd.csv", lines(",".join(names), columns)), t, q, p


def test_columns_named_by_hand(tmp_path, capsys):
    path, _, q, p = odd_headers(tmp_path)
    words = ["import", str(path), "--robot", "z1", "--out", str(tmp_path / "set")]
    assert main(words) == 2  # and says which headers it did not understand
    assert "not understood: 'A', 'ka'" in capsys.readouterr().err
    hand = [f"--joint={joint}=k{'abcdef'[j]}:rad" for j, joint in enumerate(Z1.joints)]
    assert main([*words, "--time", "A:ms", "--power", "leistungsaufnahme_x:W", *hand]) == 0
    first = read_set(tmp_path / "set").runs[0]
    np.testing.assert_allclose(first.position, q[: len(first.time)], atol=1e-6)
    np.testing.assert_allclose(first.power, p[: len(first.power)], atol=1e-3)
    assert first.time[-1] < 100


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--time", "B"], "--time B: no such column"),
        (["--power", "A:parsec"], "--power A:parsec: 'parsec' is no unit of power"),
        (["--joint", "joint9=A"], "--joint joint9: no such joint"),
        (["--joint", "joint1"], "JOINT=COLUMN"),
        (["--joint", "joint1=ka"], "no column for the position of joint2, joint3"),
        (["--time", "ka"], "--time ka: its values do not increase"),
    ],
)
def test_columns_that_cannot_be_meant(tmp_path, capsys, options, expected):
    path, *_ = odd_headers(tmp_path)
    hand = [f"--joint={joint}=k{'abcdef'[j]}" for j, joint in enumerate(Z1.joints)] if "--time" in options else []
    words = ["import", str(path), "--robot", "z1", "--out", str(tmp_path / "set"), *hand, *options]
    assert main(words) == 2 and expected in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("header", "taken"),
    [
        (["motor_power_3"], None),
        (["motor_power_1", "motor_power_2", "motor_power_3"], None),
        (["joint2 power [W]"], None),
        (["gripper_power"], None),
        (["motor_power_3", "robot_power"], "robot_power"),
        (["motor_power_total", "motor_power_3"], "motor_power_total"),
        (["power_1", "power_2"], None),
        (["CH1 power (W)"], "CH1 power (W)"),
        (["robot_voltage", "robot_current", "power"], ["robot_voltage", "robot_current"]),
        (["voltage", "current", "power", "pf"], "power"),
        (["robot_voltage", "robot_current", "power", "frequency"], "power"),
        (["motor_voltage_2", "motor_current_2"], None),
    ],
)
def test_a_single_motors_power_is_not_the_robots(tmp_path, header, taken):
    t, q, _, p = arm(Z1)
    tau = [5 * q] if taken is None else []  # a set without a meter has torques
    names = ["t", *(f"q{j}" for j in range(6)), *(f"tau_{j}" for j in range(6) if tau), *header]
    columns = [t, q, *tau, *(np.sqrt(p) if "voltage" in h or "current" in h else p for h in header)]
    path = put(tmp_path / "a.csv", lines(",".join(names), columns))
    made = import_files([path], tmp_path / "set", Z1)
    power = made.log["columns"].get("power")
    found = None if power is None else power if isinstance(power, str) else power.get("product", power.get("column"))
    assert found == taken
    unknown = next(word for word in made.words if "understood" in word)
    assert taken is not None or all(repr(name) in unknown.partition("not understood")[2] for name in header)


@pytest.mark.parametrize("other", ["computed_torque", "tau_model", "estimated_torque", "target_torque"])
def test_of_measured_and_computed_torque_the_measured_is_taken(tmp_path, other):
    t, q, _, p = arm(Z1)
    for k, (first, second) in enumerate(((other, "measured_torque"), ("torque", other))):
        names = ["t", "power", *(f"q{j}" for j in range(6))]
        names += [f"{first}_{j}" for j in range(6)] + [f"{second}_{j}" for j in range(6)]
        path = put(tmp_path / f"a{k}.csv", lines(",".join(names), [t, p, q, 5 * q, 3 * q]))
        made = import_files([path], tmp_path / f"set{k}", Z1)
        effort = made.log["columns"][f"{Z1.joints[0]}.effort"]
        name = effort if isinstance(effort, str) else effort["column"]
        assert not name.startswith(other)


def test_a_run_of_standstill_is_static_for_all_its_noise(tmp_path):
    t, q, _, p = arm(Z1)
    noise = 0.0015 * np.random.default_rng(0).standard_normal(q.shape)
    names = "t,power," + ",".join(f"q{j}" for j in range(6))
    moving = put(tmp_path / "moving.csv", lines(names, [t, p, q + noise]))
    still = put(tmp_path / "still.csv", lines(names, [t, p, q[:1] + noise]))
    made = import_files([moving, still], tmp_path / "set", Z1)
    assert np.ptp(noise, axis=0).max() > 0.008
    assert {row["file"]: row["kind"] for row in made.log["run"]} == {"moving.csv": "motion", "still.csv": "static"}


def test_a_held_pose_is_not_the_end_of_a_meters_range(tmp_path):
    """Of sixty poses held still, the one of the highest power was left out: many readings of it were the same."""
    rng = np.random.default_rng(1)
    held = np.repeat(np.arange(60), rng.integers(40, 60, 60))
    t, q = 0.02 * np.arange(len(held)), rng.uniform(-0.3, 0.3, (60, 6))[held] + [0, 1, -1, 0, 0, 0]
    p = np.append(rng.uniform(60, 130, 59), 140.0)[rng.permutation(60)][held]
    names = ",".join(f"{joint}.position" for joint in Z1.joints)
    for k in range(0, 60, 10):
        rows = (held >= k) & (held < k + 10)
        put(tmp_path / f"{k}.csv", lines(f"time,{names},power", [t[rows] - t[rows][0], q[rows], p[rows]]))
    log(tmp_path, "z1", "".join(f'[[run]]\nfile = "{k}.csv"\n' for k in range(0, 60, 10)))
    measured = read_set(tmp_path)
    assert max(run.power.max() for run in measured.runs) == 140 and not any("range" in x for x in measured.remarks)
