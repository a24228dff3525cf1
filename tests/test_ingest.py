"""Logs as labs have them: other programs' tables, foreign clocks, slow meters, damage; and `import`."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.measured import check_set, inspect_set, nodes, observe, read_set
from energy_opt.measured.importing import import_files
from energy_opt.measured.layout import Csv, layout_of
from energy_opt.measured.names import cut, energy_column, joint_columns, power_column, product_columns, time_columns
from energy_opt.measured.rows import clean, held
from energy_opt.measured.table import Table
from energy_opt.robot import load_robot

FIG9 = Path(__file__).resolve().parents[2] / "shared/data/rad_ur3e_power/fig9.csv"
Z1, PANDA, UR = (load_robot(name) for name in ("z1", "panda", "ur5e"))


def motion(n: int, seconds: float, step: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Rests, moves there and back at several speeds, and rests again: times (N,) and an angle (N,) rad."""
    t = np.arange(round(seconds / step) + 1) * step
    speed = np.zeros(len(t))
    for k, (begin, rate) in enumerate(((0.1, 0.5), (0.3, 1.0), (0.45, 0.7), (0.7, 1.2), (0.8, 0.4))[:n]):
        at = (t - begin * seconds) / 0.7
        speed += (-1) ** k * rate * np.where((at > 0) & (at < 1), np.sin(np.pi * at) ** 2, 0.0)
    return t, np.cumsum(speed) * step


def lines(header: str, columns: list[np.ndarray], form: str = "%.6f", delimiter: str = ",") -> str:
    rows = [delimiter.join(form % x for x in row) for row in np.column_stack(columns)]
    return "\n".join([header, *rows]) + "\n"


def put(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def log(folder: Path, robot: str, rest: str) -> Path:
    put(folder / "log.toml", f'format = "energy-opt/log/1"\nrobot = "{robot}"\n{rest}')
    return folder


# -- tables ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "first", "second"),
    [
        ("time,p\n0,1.5\n0.5,2\n", [0, 0.5], [1.5, 2]),
        ("\ufefftime;p\r\n0,0;1,5\r\n0,5;2\r\n", [0, 0.5], [1.5, 2]),
        ("time p\n0 1.5\n0.5 2\n", [0, 0.5], [1.5, 2]),
        (" time   p\n  0   1.5 \n 0.5  2\n", [0, 0.5], [1.5, 2]),
        ("time\tp\n[s]\t[W]\n0\t+1.5\n0.5\t2e0\n", [0, 0.5], [1.5, 2]),
        ('"time","p"\n"0,0","1,5"\n"0,5","2,0"\n', [0, 0.5], [1.5, 2]),
        ("sep=;\ntime;p\n0;1.5\n\n0.5;2\n", [0, 0.5], [1.5, 2]),
        ("Meter: X\nSerial: 7\n\ntime,p\ns,W\n0,1.5\n0.5,2\n", [0, 0.5], [1.5, 2]),
        ("time,p\r0,1.5\r0.5,2\r", [0, 0.5], [1.5, 2]),
        ("time,p\n0,1.5\n0.5,2\n".encode("utf-16"), [0, 0.5], [1.5, 2]),
        ("time,p\n0,1.5\n0.5,2\n".encode("utf-16-be"), [0, 0.5], [1.5, 2]),
        ("time;p;T °\n0,0;1,5;1\n0,5;2;1\n".encode("cp1252"), [0, 0.5], [1.5, 2]),
        ("time,p\n2021-10-05T12:00:00.25Z,1.5\n2021-10-05 12:00:00.75Z,2\n", [0.25, 0.75], [1.5, 2]),
        ("time;p\n05.10.2021 23:59:59,75;1,5\n06.10.2021 00:00:00,25;2\n", [0.75, 0.25], [1.5, 2]),
        ("time,p\n23:59:59.5,1.5\n00:00:00.5,2\n", [0.5, 0.5], [1.5, 2]),
        ("time,p\n10/5/2021 11:59:59.5 AM,1.5\n10/5/2021 12:00:00 PM,2\n", [0.5, 0.0], [1.5, 2]),
    ],
)
def test_tables_of_every_kind_hold_the_same_numbers(tmp_path, raw, first, second):
    table = Table(put(tmp_path / "a.csv", raw))
    time, power = table.column("time"), table.column("p")
    np.testing.assert_allclose(time % 1.0 if time[0] > 1 else time, first, atol=1e-6)
    assert 0 < time[1] - time[0] <= 1 and power.tolist() == second and table.faults == []


def test_dates_keep_their_zone(tmp_path):
    table = Table(put(tmp_path / "a.csv", "t,p\n2021-10-05T14:00:00+02:00,1\n2021-10-05T12:00:01Z,2\n"))
    assert table.column("t").tolist() == [1633435200.0, 1633435201.0]


def test_what_a_log_says_of_its_tables_holds(tmp_path):
    path = put(tmp_path / "a.csv", "a|b,c\n1,5|2\n")
    assert layout_of(path, Csv("|", ",")).names == ("a", "b,c") and Table(path, Csv("|", ",")).column("a")[0] == 1.5


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (b"time,p\n0,1\n0.1,\x002\n", "row 3, column p: a NUL byte"),
        (b"time,p\n0,1\n0.1," + b"7" * 200_000 + b"\n", "row 3, column p: '7777"),
        (b"time,p\n0,1\n0.1,2,3\n0.2,3\n", "row 3: 3 cells, the header has 2"),
        (b'time,p\n0,1\n0.1,"2\n0.2,3\n', "row 3: a quotation mark that does not close"),
        (b"time,p\n\n0,1\n\n0.1,oops\n" + b"0.2,1\n" * 9, "row 5, column p: 'oops' is not a number"),
        (b"time,p\n0,1\n0.1,nan\n" + b"0.2,1\n" * 9, "row 3, column p: 'nan' is not a number"),
        (b"time,p\n0,1\n0.1,inf\n" + b"0.2,1\n" * 9, "row 3, column p: 'inf' is not a number"),
        (b"\xef\xbb\xbftime,p\n0,1\n0.1,\xff\xfe\n", "row 3, column p: "),
        (b"0,1\n1,2\n", "row 1: no header"),
        (b"", "row 1: no header"),
        (b"time,p\n", "no data rows"),
        (b"time,p,p\n0,1,1\n", "'p' stands there twice"),
    ],
)
def test_damage_is_named_with_row_and_column(tmp_path, raw, expected):
    try:
        table = Table(put(tmp_path / "a.csv", raw))
        table.load(table.header)
        assert any(expected in fault for fault in table.faults), table.faults
    except BadInput as error:
        assert expected in str(error)


# -- rows --------------------------------------------------------------------------------------------------------------


def test_rows_written_twice_are_dropped_and_counted():
    t = np.arange(100) * 0.002
    again = np.sort(np.r_[np.arange(100), 7, 50])
    rows = clean(t[again], t[again, None])
    assert rows.time.tolist() == t.tolist() and "2 repeated rows dropped" in rows.remarks


def test_a_late_row_moves_to_its_free_place_and_others_go():
    t = np.arange(50) * 0.01
    x = np.arange(50.0)[:, None]
    late = t.copy()
    late[20] = late[19]  # the row's own place stays free
    np.testing.assert_allclose(clean(late, x).time, t)
    crowded = np.insert(t, 20, t[20])
    rows = clean(crowded, np.arange(51.0)[:, None])
    assert len(rows.time) == 50 and any("dropped" in word for word in rows.remarks)


def test_coarse_stamps_are_spread():
    t = np.arange(200) * 0.01
    rows = clean(np.floor(t * 10 + 1e-9) / 10, np.arange(200.0)[:, None])
    np.testing.assert_allclose(rows.time, t, atol=1e-9)
    assert len(rows.kept) == 200 and "kept" in rows.remarks[0]


def test_missing_rows_are_counted_and_gaps_cut():
    t = np.delete(np.arange(1000) * 0.01, [*range(300, 303), *range(600, 700)])
    rows = clean(t, t[:, None])
    assert (
        rows.gaps == (596,)
        and "3 rows missing in 1 places" in rows.remarks[0]
        and "1.01 s after 5.99" in rows.remarks[1]
    )


def test_a_held_reading_is_told_from_a_coarse_one():
    rng = np.random.default_rng(0)
    slow = np.repeat(rng.normal(size=80), 12)
    assert held(slow).tolist() == list(range(12, 960, 12))
    assert held(np.round(np.cumsum(rng.normal(size=2000)) / 30)) is None and held(rng.normal(size=500)) is None


# -- headers -----------------------------------------------------------------------------------------------------------

SIX, SEVEN = range(6), range(7)
HEADERS = [
    (UR, ["timestamp", *(f"{a}_{b}_{k}" for a in ("target", "actual") for b in ("q", "qd", "current") for k in SIX)],
     {"position": "actual_q_5", "velocity": "actual_qd_5", "current": "actual_current_5"}),
    (PANDA, ["time", "success_rate",
             *(f"state.{s}[{k}]" for s in ("q", "q_d", "dq", "tau_J", "tau_ext_hat_filtered") for k in SEVEN)],
     {"position": "state.q[6]", "velocity": "state.dq[6]", "effort": "state.tau_J[6]"}),
    (UR, ["__time", *(f"/joint_states/{j}/{s}" for j in sorted(UR.joints) for s in ("effort", "position", "velocity"))],
     {"position": "/joint_states/wrist_3_joint/position", "effort": "/joint_states/wrist_3_joint/effort"}),
    (Z1, ["Zeit [ms]", *(f"J{k} Angle (deg)" for k in range(1, 7)), "TCP 1"], {"position": "J6 Angle (deg)"}),
    (Z1, ["t_ms", *(f"q{k}_deg" for k in range(1, 7)), *(f"qd{k}_deg_s" for k in range(1, 7))],
     {"position": "q6_deg", "velocity": "qd6_deg_s"}),
    (PANDA, ["t", *(f"A{k}" for k in range(1, 8)), *(f"Torque_A{k} [Nm]" for k in range(1, 8))],
     {"position": "A7", "effort": "Torque_A7 [Nm]"}),
    (UR, ["t", "base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"], {"position": "wrist3"}),
    (Z1, ["t", *(f"TargetJointPos{k}" for k in SIX), *(f"actualJointPos{k}" for k in SIX)],
     {"position": "actualJointPos5"}),
]  # fmt: skip


@pytest.mark.parametrize(("robot", "header", "expected"), HEADERS)
def test_joints_are_found_in_the_fields_conventions(robot, header, expected):
    found = joint_columns(header, robot.joints)
    assert {signal: by[robot.joints[-1]] for signal, by in found.items() if signal in expected} == expected
    assert len(set(found["position"].values())) == robot.n and time_columns(header)[0] == header[0]


@pytest.mark.parametrize(
    ("header", "power", "energy", "product"),
    [
        (["Time", "Voltage", "Current", "Active Power", "Apparent Power", "Power Factor"], "Active Power", None, None),
        (["t", "P_total_W", "tau_1"], "P_total_W", None, None),
        (["t", "Leistung [kW]"], "Leistung [kW]", None, None),
        (["t", "kWh"], None, "kWh", None),
        (["t", "Energy (Wh)", "q1"], None, "Energy (Wh)", None),
        (["t", "U [V]", "I [A]", "actual_current_0"], None, None, ("U [V]", "I [A]")),
        (["t", "actual_main_voltage", "actual_robot_voltage", "actual_robot_current", "actual_joint_voltage_0"],
         None, None, ("actual_robot_voltage", "actual_robot_current")),
    ],
)  # fmt: skip
def test_meters_are_found(header, power, energy, product):
    assert power_column(header) == power and energy_column(header) == energy
    assert power is not None or product_columns(header) == product
    assert cut("Leistung [kW]").unit == "kW"


# -- recorders ---------------------------------------------------------------------------------------------------------


def arm(robot, seconds: float = 8.0, step: float = 0.01) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t, q (N, n) about the middle of the limits, v, and a power that follows the motion."""
    t, x = motion(5, seconds, step)
    middle = np.clip((robot.limits.lower + robot.limits.upper) / 2, -1.5, 1.5)
    q = np.where(np.isfinite(middle), middle, 0.0) + np.outer(x, 0.5 + 0.1 * np.arange(robot.n))
    v = np.gradient(q, t, axis=0)
    return t, q, v, 60 + 40 * np.abs(v).sum(axis=1) + 10 * (v**2).sum(axis=1)


def test_libfrankas_log_with_a_meter_of_its_own(tmp_path):
    t, q, v, p = arm(PANDA, step=0.001)
    names = [f"{s}[{k}]" for s in ("state.q", "state.q_d", "state.dq", "state.tau_J") for k in SEVEN]
    put(
        tmp_path / "in/log.csv", lines("time, success_rate, " + ", ".join(names), [1000 * t, 0 * t + 1, q, q, v, 0 * q])
    )
    put(tmp_path / "in/log_power.csv", lines("time;power", [t[::10], p[::10]], delimiter=";").replace(".", ","))
    files = [str(x) for x in sorted((tmp_path / "in").iterdir())]
    assert main(["import", *files, "--out", str(tmp_path / "set"), "--quiet"]) == 0
    run = read_set(tmp_path / "set").runs[0]
    document = (tmp_path / "set/log.toml").read_text()
    assert 'robot = "panda"' in document and "ms" in document
    assert run.velocity is not None and np.ptp(run.velocity) == pytest.approx(np.ptp(v[: len(run.time)]), rel=1e-3)
    log(
        tmp_path / "in",
        "panda",
        '[columns]\npreset = "franka_state"\n[[run]]\nfile = "log.csv"\npower_file = "log_power.csv"\n',
    )
    same = read_set(tmp_path / "in").runs[0]
    np.testing.assert_allclose(same.position, q, atol=1e-6)
    np.testing.assert_allclose(np.interp(same.power_time, t, p), same.power, atol=1e-3)


def test_a_joint_states_bag_goes_by_the_names_in_the_message(tmp_path):
    """As `rostopic echo -p` prints it: nanoseconds, the driver's alphabetical order, names in the rows."""
    t, q, v, p = arm(UR)
    order = sorted(range(6), key=lambda k: UR.joints[k])
    names = [
        "%time",
        "field.header.seq",
        *(f"field.{s}{k}" for s in ("name", "position", "velocity") for k in SIX),
        "power",
    ]
    rows = [
        ",".join([f"{1_500_000_000_000_000_000 + round(1e9 * t[i])}", str(i), *(UR.joints[k] for k in order),
                  *(f"{q[i, k]:.7f}" for k in order), *(f"{v[i, k]:.7f}" for k in order), f"{p[i]:.3f}"])
        for i in range(len(t))
    ]  # fmt: skip
    put(tmp_path / "js.csv", "\n".join([",".join(names), *rows]) + "\n")
    log(tmp_path, "ur5e", 'preset = "joint_state"\n[[run]]\nfile = "js.csv"\n')
    run = read_set(tmp_path).runs[0]
    np.testing.assert_allclose(run.position, q, atol=1e-6)
    np.testing.assert_allclose(run.time, t, atol=1e-6)
    made = import_files([tmp_path / "js.csv"], tmp_path / "set", UR)
    first = read_set(made.folder).runs[0].position
    np.testing.assert_allclose(first, q[: len(first)], atol=1e-6)


@pytest.mark.parametrize("sparse", [False, True])
def test_a_slow_meter_in_the_same_table(tmp_path, sparse):
    """Held over the rows, or in every 50th row only, as merged exports have it; means over half a second."""
    t, q, _, p = arm(Z1, 30.0)
    mean = np.array([(p[k - 50 : k] + p[k - 49 : k + 1]).mean() / 2 for k in range(50, len(t), 50)])
    rows = []
    for k in range(50, len(t)):
        shown = "" if sparse and k % 50 else f"{mean[k // 50 - 1]:.4f}"
        rows.append(",".join([f"{t[k]:.3f}", *(f"{x:.6f}" for x in q[k]), shown]))
    put(tmp_path / "a.csv", "\n".join([",".join(["time", *(f"q{k}" for k in SIX), "power"]), *rows]) + "\n")
    made = import_files([tmp_path / "a.csv"], tmp_path / "set", Z1)
    assert any("means over 0.5 s" in remark for remark in made.remarks)
    for run in read_set(made.folder).runs:
        assert len(run.power) >= 4 and run.window == pytest.approx(np.full(len(run.power), 0.5), abs=0.02)
        at = nodes(run)
        expected = observe(run, at, np.interp(run.start + at, t, p))
        np.testing.assert_allclose(run.power, expected, atol=0.5)


def test_a_meters_clock_is_found_and_said(tmp_path):
    t, q, _, p = arm(Z1, 60.0)
    own = np.arange(0.0, 50.0, 0.1)
    true = 4.0 + own * (1 + 1.5e-3)  # the joints' time of a reading
    rng = np.random.default_rng(3)
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints), [t, q]))
    put(tmp_path / "p.csv", lines("time,power", [own, np.interp(true, t, p) + rng.normal(0, 2, len(own))]))
    folder = log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\npower_file = "p.csv"\n[meter]\nwindow = 0\n')
    measured = read_set(folder)
    run = measured.runs[0]
    assert run.clock == "estimated" and "correlation" in measured.remarks[0] and "ppm" in measured.remarks[0]
    np.testing.assert_allclose(run.power_time, true[: len(run.power_time)], atol=0.03)
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\npower_file = "p.csv"\npower_start = 4.0\n[meter]\nwindow = 0\n')
    stated = read_set(folder).runs[0]
    assert stated.clock == "stated" and stated.power_time[0] == 4.0
    put(tmp_path / "p.csv", lines("time,power", [own, np.interp(own - 0.1, t, p)]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\npower_file = "p.csv"\n[meter]\nwindow = 0\n')
    assert read_set(folder).runs[0].clock == "shared"  # a tenth of a second is the meter's delay, which the fit finds


def test_counters_totals_and_no_meter_at_all(tmp_path):
    t, q, _, p = arm(Z1)
    energy = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(t))])
    header = "time," + ",".join(f"{j}.position" for j in Z1.joints)
    put(tmp_path / "a.csv", lines(header + ",wh", [t, q, 7 + energy / 3600], "%.9f"))
    log(tmp_path, "z1", '[columns]\nenergy = { column = "wh", unit = "Wh" }\n[[run]]\nfile = "a.csv"\n')
    run = read_set(tmp_path).runs[0]
    assert run.meter == "energy" and float(run.power @ run.window) == pytest.approx(energy[-1], rel=1e-4)
    log(tmp_path, "z1", f'[[run]]\nfile = "a.csv"\nenergy = {energy[-1]}\n')
    run = read_set(tmp_path).runs[0]
    assert run.meter == "total" and observe(run, t, p)[0] * t[-1] == pytest.approx(energy[-1], rel=1e-6)
    amps = header + "," + ",".join(f"{j}.current" for j in Z1.joints)
    put(tmp_path / "a.csv", lines(amps, [t, q, q]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')
    assert read_set(tmp_path, meter=False).runs[0].current is not None
    with pytest.raises(BadInput, match="no run has a reading of power"):
        read_set(tmp_path)


# -- import ------------------------------------------------------------------------------------------------------------


def test_degrees_milliseconds_kilowatts_are_converted_and_said(tmp_path, capsys):
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
    assert check_set(tmp_path / "set") == []
    whole = read_set(tmp_path / "set")
    first = whole.runs[0]
    np.testing.assert_allclose(first.position, q[: len(first.time)], atol=1e-6)
    np.testing.assert_allclose(first.power, p[: len(first.power)], atol=1e-3)
    assert main(["import", str(path), "--robot", "z1", "--out", str(tmp_path / "set"), "--quiet"]) == 2


def test_files_are_paired_and_runs_ordered(tmp_path):
    for k, begin in ((2, 100.0), (10, 0.0)):
        t, q, _, p = arm(Z1)
        put(tmp_path / f"motion_{k}.csv", lines("t," + ",".join(f"q{j}" for j in SIX), [1.7e9 + begin + t, q]))
        put(tmp_path / f"meter_{k}.csv", lines("t,power", [1.7e9 + begin + t[::4], p[::4] + k]))
    made = import_files(sorted(tmp_path.glob("*.csv")), tmp_path / "set", Z1)
    rows = [(row["file"], row["power_file"], row["start"]) for row in made.log["run"]]
    assert rows == [("motion_10.csv", "meter_10.csv", 0.0), ("motion_2.csv", "meter_2.csv", 100.0)]
    assert made.runs[0].power[0] == pytest.approx(70) and read_set(made.folder).clock


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
    ],
)
def test_what_cannot_be_imported_is_said_and_nothing_written(tmp_path, capsys, text, expected):
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


# -- sets --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def plain(tmp_path):
    t, q, _, p = arm(Z1)
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power", [t, q, p]))
    return log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("time,", "time,x,", "cells, the header has"),
        ("\n0.010000,", "\n1e300,", "cannot be a time"),
        ("\n0.010000,0.000000", "\n0.010000,1e30", "column joint1.position: 1e+30 cannot be a position"),
    ],
)
def test_values_that_no_arm_has(plain, old, new, expected):
    text = (plain / "a.csv").read_text()
    assert old in text
    put(plain / "a.csv", text.replace(old, new, 1))
    assert any(expected in fault for fault in check_set(plain))


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1000.0), ("s", 0.001), ("us", 1000.0)])
def test_stamps_in_another_unit_are_doubted(plain, unit, factor):
    t, q, _, p = arm(Z1)
    put(
        plain / "a.csv",
        lines("time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power", [t * factor, q, p], "%.9f"),
    )
    if unit == "ms":
        assert "s between rows; is the time's unit right" in check_set(plain)[0]
    log(plain, "z1", f'[columns]\ntime = {{ column = "time", unit = "{unit}" }}\n[[run]]\nfile = "a.csv"\n')
    assert bool(check_set(plain)) == (unit != "ms")


def test_files_stay_in_the_set(plain, tmp_path, capsys):
    outside = put(tmp_path.parent / f"{tmp_path.name}_x.csv", (plain / "a.csv").read_text())
    for name in (str(outside), f"../{outside.name}"):
        log(plain, "z1", f'[[run]]\nfile = "{name}"\n')
        assert "lies outside" in check_set(plain)[0] and "joint1" not in check_set(plain)[0]
        assert main(["check", str(plain), "--quiet"]) == 2
        assert main(["check", str(plain), "--quiet", "--allow-outside"]) == 0
    assert inspect_set(plain, allow_outside=True)[0] == []
    capsys.readouterr()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[[run]]\nfile = "a.csv"\npower_fil = "p.csv"\n', "did you mean 'power_file'?"),
        ('[[run]]\nfile = "a.csv"\nstart = "1.0"\n', "start = '1.0'"),
        ('[[run]]\nfile = "a.csv"\nenergy = true\n', "energy = True"),
        ('[[run]]\nfile = "a.csv"\npower_start = 1\n', "without a power_file"),
        ('[[run]]\nfile = "a.csv"\n[meter]\nwindow = "0.1"\n', "window = '0.1'"),
        ('[[run]]\nfile = "a.csv"\n[meter]\nwindo = 0.1\n', "did you mean 'window'?"),
        ('[[run]]\nfile = "a.csv"\n[csv]\ndecimal = ";"\n', "decimal = ';'"),
        ('[[run]]\nfile = "a.csv"\n[csv]\ndelimiter = 3\n', "delimiter = 3"),
        ('[[run]]\nfile = "a.csv"\n[csv]\ndelimiter = "\\u0000"\n', "delimiter = "),
        ('[[run]]\nfile = "a.csv"\n[columns]\npower = { product = ["u", 3] }\n', "product a list of headers"),
        ('[[run]]\nfile = "a.csv"\n[columns]\npower = { column = "u", unt = "W" }\n', "did you mean 'unit'?"),
        ('[[run]]\nfile = "a.csv"\n[columns]\npreset = ["x"]\n', "known: ur_rtde, franka_state, joint_state"),
    ],
)
def test_keys_and_kinds_of_values_are_held(plain, text, expected):
    assert expected in check_set(log(plain, "z1", text))[0]


def test_no_damage_makes_a_traceback(plain):
    rng = np.random.default_rng(5)
    whole = (plain / "a.csv").read_bytes()[:6000]
    for _ in range(120):
        raw = bytearray(whole)
        for _ in range(rng.integers(1, 4)):
            at, kind = int(rng.integers(len(raw))), rng.integers(5)
            if kind == 0:
                raw[at] = int(rng.integers(256))
            elif kind == 1:
                del raw[at : at + int(rng.integers(1, 200))]
            elif kind == 2:
                raw[at:at] = rng.choice([b'"', b"\n", b",", b";", b"1e300", b"nan", b"\r", b" ", b"\0\0"])
            elif kind == 3:
                raw = raw[: max(at, 2)]
            else:
                raw[at : at + 4] = b"\xff\xfe\xfd\xfc"
        put(plain / "a.csv", bytes(raw))
        for fault in check_set(plain):
            assert "\n" not in fault and len(fault) < 1000


def test_a_tenth_hertz_of_a_million_rows_takes_linear_time(tmp_path):
    """Two sizes: four times the rows take about four times the time (process time, generous)."""
    import time

    seconds = []
    for count in (20_000, 80_000):
        t = np.arange(count) * 0.002
        q = np.array([0.1, 1.0, -1.0, 0.1, 0.1, 0.1]) + 0.3 * np.sin(np.outer(t, np.arange(1, 7) / 3))
        header = "time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power"
        folder = log(tmp_path / str(count), "z1", '[[run]]\nfile = "a.csv"\n')
        put(folder / "a.csv", lines(header, [t, q, 60 + np.abs(q[:, 1])]))
        begun = time.process_time()
        assert len(read_set(folder).runs[0].time) == count
        seconds.append(time.process_time() - begun)
    assert seconds[1] < 8 * seconds[0] + 0.2


@pytest.mark.skipif(not FIG9.is_file(), reason="the shared recording is not here")
def test_a_real_recording_in_one_command(tmp_path):
    """The arm is found by its torques; the set is read as the preset written by hand."""
    assert main(["import", str(FIG9), "--out", str(tmp_path / "set"), "--quiet"]) == 0
    measured = read_set(tmp_path / "set")
    assert measured.robot.name == "ur3e" and sum(len(r.power) for r in measured.runs) == 888
    assert measured.runs[0].current is not None and measured.payload is not None and check_set(tmp_path / "set") == []


@pytest.mark.skipif(not FIG9.is_file(), reason="the shared recording is not here")
@pytest.mark.parametrize("offset", [0.0, 12.0])
def test_a_real_recording_with_a_meter_of_one_hertz(tmp_path, offset):
    table = Table(FIG9)
    t = table.column("timestamp")
    p = table.product(["actual_robot_voltage", "actual_robot_current"])
    ends = np.arange(24, len(t), 25)
    mean = np.array([p[k - 24 : k + 1].mean() for k in ends])
    names = [f"actual_q_{k}" for k in SIX]
    put(tmp_path / "joints.csv", lines(",".join(["timestamp", *names]), [t, *(table.column(x) for x in names)], "%.9f"))
    put(tmp_path / "meter.csv", lines("Time [s],Power [W]", [t[ends] - t[0] + offset, mean]))
    made = import_files([tmp_path / "joints.csv", tmp_path / "meter.csv"], tmp_path / "set", load_robot("ur3e"))
    measured = read_set(made.folder)
    stamps = np.concatenate([run.start + run.power_time for run in measured.runs])
    assert len(stamps) >= 33 and all(len(run.power) >= 4 for run in measured.runs)
    assert all(run.window == pytest.approx(np.full(len(run.power), 1.0), abs=0.01) for run in measured.runs)
    assert measured.runs[0].clock == ("estimated" if offset else "shared")
    assert np.abs(stamps - (t[ends] - t[0])[: len(stamps)]).max() < (0.15 if offset else 1e-6)
    for run in measured.runs:
        at = nodes(run)
        assert math.isfinite(float(observe(run, at, np.ones(len(at))).sum()))
