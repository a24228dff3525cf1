"""Logs whose columns, units, clocks and files are not plain: what `import` and `check` make of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from logs import PANDA, SEVEN, SIX, UR, Z1, arm, lines, log, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set, read_set
from energy_opt.measured.columns import ByHand
from energy_opt.measured.importing import import_files
from energy_opt.numerics.stamps import clean

JOINTS = ",".join(f"q{k}" for k in SIX)
POSITIONS = ",".join(f"{joint}.position" for joint in Z1.joints)


def test_a_counter_without_a_unit_has_the_one_that_an_arm_draws(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    energy = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(t))])
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},Energy", [t, q, energy / 3600], "%.9f"))
    made = import_files([path], tmp_path / "set", Z1)
    assert made.log["columns"]["energy"] == {"column": "Energy", "unit": "Wh"}
    assert "energy: Energy [Wh], a counter" in made.words
    measured = sum(float(run.power @ run.window) for run in made.runs)
    assert measured == pytest.approx(energy[-1], rel=0.02)


@pytest.mark.parametrize("header", ["Counter [kWh]", "total_kWh"])
def test_a_unit_of_energy_says_that_a_column_is_a_counter(tmp_path: Path, header: str) -> None:
    t, q, _, p = arm(Z1)
    energy = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(t))])
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},{header}", [t, q, energy / 3.6e6], "%.10f"))
    made = import_files([path], tmp_path / "set", Z1)
    assert made.log["columns"]["energy"] == {"column": header, "unit": "kWh"}


def test_voltage_times_current_of_an_alternating_supply_is_no_power(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    header, columns = f"t,{JOINTS},U [V],I [A],PF", [t, q, 0 * t + 230, p / 230 / 0.6, 0 * t + 0.6]
    path = put(tmp_path / "a.csv", lines(header, columns))
    with pytest.raises(BadInput, match=r"no column of power.*not understood: 'U \[V\]', 'I \[A\]', 'PF'; name"):
        import_files([path], tmp_path / "set", Z1)
    by_hand = import_files([path], tmp_path / "set", Z1, hand=ByHand(power="U [V]*I [A]"))
    assert by_hand.log["columns"]["power"] == {"product": ["U [V]", "I [A]"]}


def test_a_coarse_counter_is_read_where_it_steps_and_not_where_it_begins_anew(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    energy = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(t))])
    coarse = 50 * np.floor(energy / 50)
    coarse[t > 4] -= coarse[t > 4][0]
    put(tmp_path / "a.csv", lines(f"time,{POSITIONS},energy", [t, q, coarse]))
    counter = '[columns]\nenergy = { column = "energy", unit = "J" }\n'
    measured = read_set(log(tmp_path, "z1", f'{counter}[[run]]\nfile = "a.csv"\n'))
    (run,) = measured.runs
    said = "\n".join(measured.remarks)
    assert "read where it steps" in said and "restarts 1 times" in said
    assert (run.power > 0).all() and 0.8 * energy[-1] < run.power @ run.window < energy[-1]


def test_rows_that_arrive_in_bunches_are_spread_evenly() -> None:
    bunches, rows = 30, 10
    true = np.arange(bunches * rows) * 0.01
    stamped = np.repeat(np.arange(1, bunches + 1) * 0.1, rows) + np.tile(np.arange(rows) * 1e-4, bunches)
    found = clean(stamped, np.sin(true)[:, None])
    assert "stamps come in bunches: rows spread evenly, 10 ms apart" in found.remarks[0]
    np.testing.assert_allclose(np.diff(found.time), 0.01, atol=1e-3)


def test_equal_rows_under_coarse_stamps_are_kept() -> None:
    stamps = np.repeat(np.arange(20) * 0.1, 5)
    values = np.sin(np.arange(100) / 20)[:, None]
    values[2] = values[1]  # at rest, not a copy
    found = clean(stamps, values)
    assert len(found.time) == 100 and (np.diff(found.time) > 0).all()


def test_power_by_hand_may_be_a_voltage_times_a_current(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},x1,x2", [t, q, np.full_like(t, 48.0), p / 48.0 * 1000]))
    made = import_files([path], tmp_path / "set", Z1, hand=ByHand(power="x1*x2:mA"))
    assert made.log["columns"]["power"] == {"product": ["x1", "x2"], "unit": "mW"}
    np.testing.assert_allclose(made.runs[0].power, p[: len(made.runs[0].power)], rtol=1e-4)


@pytest.mark.parametrize(("volt", "ampere"), [(1.0, 1e3), (1e3, 1.0), (1e3, 1e3), (1.0, 1.0)])
def test_units_of_voltage_and_current_multiply(tmp_path: Path, volt: float, ampere: float) -> None:
    """Millivolts times milliamperes were read as milliwatts: 100 kW."""
    t, q, _, p = arm(UR)
    header = ",".join(["t", *(f"q{k}" for k in SIX), f"bus voltage [{'m' if volt > 1 else ''}V]"])
    header += f",bus current [{'m' if ampere > 1 else ''}A]"
    put(tmp_path / "a.csv", lines(header, [t, q, 0 * t + 48 * volt, p / 48 * ampere]))
    import_files([tmp_path / "a.csv"], tmp_path / "set", UR)
    power = np.concatenate([run.power for run in read_set(tmp_path / "set").runs])
    assert power.max() == pytest.approx(p.max(), rel=1e-3)


def test_a_full_disk_keeps_the_old_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    t, q, _, p = arm(Z1)
    new, out, copy = tmp_path / "new", tmp_path / "set", shutil.copyfile
    new.mkdir()
    import_files([put(tmp_path / "a.csv", lines(f"t,{JOINTS},power", [t, q, p]))], out, Z1)
    old = {file.name: file.read_bytes() for file in out.iterdir()}
    files = [put(new / name, lines(f"t,{JOINTS},power", [t, q, 2 * p])) for name in ("a.csv", "b.csv")]

    def full(source: Path, target: Path) -> None:
        if out in target.parents and "b.csv" in target.name:
            raise OSError(28, "No space left on device")
        copy(source, target)

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(BadInput, match="No space left on device; nothing in it was changed"):
        import_files(files, out, Z1, replace=True)
    assert {file.name: file.read_bytes() for file in out.iterdir()} == old
    (new / "job.json").write_text("{}")
    with pytest.raises(BadInput, match="holds the results of job"):
        import_files(files, new, Z1)


def test_columns_by_hand_replace_those_of_a_recorder(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    header = ",".join(f"actual_q_{k}" for k in range(6))
    path = put(tmp_path / "a.csv", lines(f"timestamp,{header},watts,clock", [t, q, p, 1e3 * t], "%.9f"))
    made = import_files([path], tmp_path / "set", Z1, hand=ByHand(time="clock:ms"))
    assert made.log["columns"] == {"preset": "ur_rtde", "time": {"column": "clock", "unit": "ms"}, "power": "watts"}
    path = put(tmp_path / "b.csv", lines(f"timestamp,{header},actual_robot_current,watts", [t, q, 0 * t, p], "%.9f"))
    made = import_files([path], tmp_path / "set 2", Z1)
    assert made.log["columns"] == {"preset": "ur_rtde", "power": "watts"}


def test_velocities_in_another_unit_are_converted_or_left_out(tmp_path: Path) -> None:
    t, q, v, p = arm(Z1)
    header = f"t,{JOINTS},{','.join(f'dq{k}' for k in SIX)},power"
    path = put(tmp_path / "a.csv", lines(header, [t, q, np.degrees(v), p]))
    made = import_files([path], tmp_path / "set", Z1)
    assert any("velocities are deg/s" in word for word in made.words)
    np.testing.assert_allclose(made.runs[0].velocity, v[: len(made.runs[0].time)], atol=1e-4)
    path = put(tmp_path / "a.csv", lines(header, [t, q, 0.3 * v[::-1], p]))
    made = import_files([path], tmp_path / "set", Z1, True)
    assert any("velocities are left out" in word for word in made.words) and made.runs[0].velocity is None


def test_positions_that_would_be_too_fast_are_degrees(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    degrees = q[:1] + 0.6 * np.sin(2 * np.pi * 5 * t)[:, None]  # within the limits, were they radians
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},power", [t, degrees, p]))
    made = import_files([path], tmp_path / "set", Z1)
    assert any("would be too fast" in word for word in made.words)
    np.testing.assert_allclose(made.runs[0].position, np.radians(degrees)[: len(made.runs[0].time)], atol=1e-6)


def test_a_counter_of_rows_in_place_of_time_does_not_make_radians_degrees(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    slow = q[:1] + np.sin(2 * np.pi * 0.3 * t)[:, None]
    path = put(tmp_path / "a.csv", lines(f"index,{JOINTS},power", [np.arange(len(t)), slow, p]))
    with pytest.raises(BadInput, match="'index' and 'q0': the joints are too fast if times are ms and positions rad"):
        import_files([path], tmp_path / "set", Z1)


def test_meters_whose_clocks_begin_at_0_are_paired_by_name(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    for k in (1, 2):
        put(tmp_path / f"motion_{k}.csv", lines(f"t,{JOINTS}", [t, q]))
        put(tmp_path / f"meter_{k}.csv", lines("t,power", [t[::4], p[::4] + k]))
    made = import_files(sorted(tmp_path.glob("*.csv")), tmp_path / "set", Z1)
    assert [(row["file"], row["power_file"]) for row in made.log["run"]] == [
        ("motion_1.csv", "meter_1.csv"), ("motion_2.csv", "meter_2.csv"),
    ]  # fmt: skip
    (tmp_path / "meter_2.csv").unlink()
    with pytest.raises(BadInput, match="it is not clear to which file of joints this meter's file belongs"):
        import_files(sorted(tmp_path.glob("*.csv")), tmp_path / "other", Z1)
    assert not (tmp_path / "other").exists()


def test_files_that_make_no_set_are_refused(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    whole = lines(f"t,{JOINTS},power", [t, q, p])
    same = [put(tmp_path / folder / "a.csv", whole) for folder in ("one", "two")]
    for files, robot, expected in (
        (same, Z1, "two files of this name"),
        ([put(tmp_path / "log.toml", whole)], Z1, "is written by the import"),
        (
            [put(tmp_path / "b.csv", lines(f"t,{JOINTS}", [t, q]))],
            Z1,
            "no column of power, energy, currents or torques",
        ),
        ([put(tmp_path / "c.csv", lines("t,x,power", [t, t, p]))], None, "no file has positions of joints"),
        (
            [put(tmp_path / "d.csv", lines(f"t,{JOINTS},power", [np.where(t > t[50], t - 0.3, t), q, p]))],
            Z1,
            f"row 53, column t: {t[51] - 0.3:.10g} comes after {t[50]:.10g}",
        ),
    ):
        with pytest.raises(BadInput, match=expected):
            import_files(files, tmp_path / "set", robot)
        assert not (tmp_path / "set").exists()
    with pytest.raises(BadInput, match="joint needs robot"):
        import_files(same[:1], tmp_path / "set", hand=ByHand(joints={"joint1": "q0"}))


def test_check_finds_what_no_arm_and_no_meter_shows(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    beyond = q.copy()
    beyond[500:, 1] = Z1.limits.upper[1] + 0.1
    put(tmp_path / "a.csv", lines(f"time,{POSITIONS},power", [t, beyond, p]))
    put(tmp_path / "b.csv", lines(f"time,{POSITIONS},power", [t, q, np.full_like(t, 88.0)]))
    log(tmp_path, "z1", "".join(f'[[run]]\nfile = "{name}.csv"\n' for name in "ab"))
    faults = "\n".join(inspect_set(tmp_path)[0])
    assert "row 502, column joint2.position" in faults and "is the unit right?" in faults
    assert "column power: is 88 W throughout; is the meter connected?" in faults
    currents = ",".join(f"{joint}.current" for joint in Z1.joints)
    put(tmp_path / "a.csv", lines(f"time,{POSITIONS},{currents}", [t, q, q]))
    found, remarks = inspect_set(log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n'))
    assert not found and any("nothing but currents and torques" in remark for remark in remarks)


NUMBERED = ("{}.position", "/joint_states/{}/position", "{}_pos_rad")


@pytest.mark.parametrize("form", NUMBERED)
def test_joints_named_as_another_robots_are_not_taken_by_their_numbers(tmp_path: Path, form: str) -> None:
    t, q, _, p = arm(PANDA)
    header = ",".join(form.format(joint) for joint in PANDA.joints)
    path = put(tmp_path / "a.csv", lines(f"t,{header},power", [t, q, p]))
    with pytest.raises(BadInput, match=r"every joint of ur5e; expected shoulder_pan_joint, .* found 't', '.*joint1"):
        import_files([path], tmp_path / "set", UR)
    assert import_files([path], tmp_path / "set").robot.name == "panda"


def test_names_of_an_unknown_arm_are_no_other_arms(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    for name, most in (("joint{}", 7), ("lab_joint_{}", 6)):
        columns = [t, np.column_stack([q, q])[:, :most], p]
        header = ",".join(f"{name.format(k + 1)}.position" for k in range(most))
        path = put(tmp_path / "a.csv", lines(f"t,{header},power", columns))
        with pytest.raises(BadInput, match="every joint of ur5e"):
            import_files([path], tmp_path / "set", UR)
        hand = ByHand(joints={joint: f"{name.format(k + 1)}.position" for k, joint in enumerate(UR.joints)})
        import_files([path], tmp_path / f"set {most}", UR, hand=hand)


def test_names_in_a_message_decide_over_numbers(tmp_path: Path) -> None:
    t, q, _, p = arm(PANDA)
    header = ",".join(f"{signal}{k}" for signal in ("name", "position") for k in SEVEN)
    names = ",".join(PANDA.joints)
    rows = [f"{a:.3f},{names},{','.join(f'{x:.6f}' for x in b)},{c:.3f}" for a, b, c in zip(t, q, p, strict=True)]
    path = put(tmp_path / "a.csv", "\n".join([f"time,{header},power", *rows]) + "\n")
    with pytest.raises(BadInput, match="every joint of ur5e"):
        import_files([path], tmp_path / "set", UR)
    log(tmp_path, "ur5e", '[columns]\npreset = "joint_state"\n[[run]]\nfile = "a.csv"\n')
    with pytest.raises(BadInput, match="no positions of shoulder_pan_joint"):
        read_set(tmp_path)


def test_the_state_of_an_arm_with_more_joints_is_refused(tmp_path: Path) -> None:
    t, q, _, p = arm(PANDA)
    put(tmp_path / "a.csv", lines(f"time,{','.join(f'q[{k}]' for k in SEVEN)},power", [t, q, p]))
    log(tmp_path, "ur5e", '[columns]\npreset = "franka_state"\n[[run]]\nfile = "a.csv"\n')
    with pytest.raises(BadInput, match="row 1: q of 7 joints; the log's robot has 6: shoulder_pan_joint"):
        read_set(tmp_path)


@pytest.mark.parametrize("form", ["fr3_joint{}", "iiwa_joint_{}.position", "/joint_states/left_joint{}/position"])
def test_an_arm_that_is_not_known_is_not_taken_for_a_known_one(tmp_path: Path, form: str) -> None:
    t, q, _, p = arm(PANDA)
    header = ",".join(form.format(k + 1) for k in SEVEN)
    path = put(tmp_path / "a.csv", lines(f"t,{header},power", [t, q, p]))
    with pytest.raises(BadInput, match=r"(say which|name the arm) with robot"):
        import_files([path], tmp_path / "set")


def test_a_robot_is_not_found_by_torques_that_are_not_its_own(tmp_path: Path) -> None:
    t, q, _, p = arm(PANDA)
    own = PANDA.body.torque(q, np.zeros_like(q), np.zeros_like(q))
    header = ",".join(f"{signal}{k}" for signal in ("q", "tau") for k in SEVEN)
    path = put(tmp_path / "a.csv", lines(f"t,{header},power", [t, q, own, p]))
    assert import_files([path], tmp_path / "panda").robot.name == "panda"
    put(path, lines(f"t,{header},power", [t, q, 0.5 * own[:, [0, 3, 2, 1, 4, 5, 6]], p]))
    with pytest.raises(BadInput, match="the columns fit panda, xarm7; say which with robot"):
        import_files([path], tmp_path / "set")


def test_a_missing_joint_is_named_and_the_rest_is_no_other_robot(tmp_path: Path) -> None:
    t, q, _, p = arm(PANDA)
    path = put(tmp_path / "a.csv", lines(f"t,{','.join(PANDA.joints[:6])},power", [t, q[:, :6], p]))
    with pytest.raises(BadInput, match="no file has positions of joints; name the arm with robot"):
        import_files([path], tmp_path / "set")
    with pytest.raises(BadInput, match="every joint of z1"):
        import_files([path], tmp_path / "set", Z1)


def test_a_measured_set_in_place_of_a_simulated_one_has_nothing_of_its_models(tmp_path: Path) -> None:
    t, q, _, p = arm(Z1)
    path = put(tmp_path / "a.csv", lines(f"t,{JOINTS},power", [t, q, p]))
    out = tmp_path / "set"
    for name in ("log.toml", "truth.toml", "declared.toml"):
        put(out / name, "")
    import_files([path], out, Z1, replace=True)
    assert {file.name for file in out.iterdir()} == {"log.toml", "a.csv"}
