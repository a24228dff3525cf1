"""Tables of any dialect: cells, rows, headers in the field's conventions, recorders' files, meters and their clocks."""

from __future__ import annotations

import gzip
import io

import numpy as np
import pytest
from logs import PANDA, SEVEN, SIX, UR, Z1, arm, lines, log, put

from energy_opt.errors import BadInput
from energy_opt.measured import read_set
from energy_opt.measured.importing import import_files
from energy_opt.measured.layout import Csv, layout_of
from energy_opt.measured.names import joint_columns, time_columns
from energy_opt.measured.plausible import held_samples, update_indices
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import clean


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
        ("time,p\n0,1.5,\n0.5,2,\n", [0, 0.5], [1.5, 2]),
        ("time,p,,\n0,1.5,,\n0.5,2,,\n", [0, 0.5], [1.5, 2]),
        ("# by X\ntime,p\n# begin\n0,1.5\n# pause\n0.5,2\n# end\n", [0, 0.5], [1.5, 2]),
        ("time,p\n0,1.5\n# two, words\n0.5,2\n# end, too\n", [0, 0.5], [1.5, 2]),
        ("time p\n0 1.5\n# paused\n0.5 2\n", [0, 0.5], [1.5, 2]),
        ("time,p\n0,1.5\n0.5,2\n1.0", [0, 0.5], [1.5, 2]),
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
    stated = Csv(delimiter="|", decimal=",")
    assert layout_of(path, stated).names == ("a", "b,c") and Table(path, stated).column("a")[0] == 1.5


def archive() -> bytes:
    stream = io.BytesIO()
    np.savez(stream, time=np.arange(3.0))
    return stream.getvalue()


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (b"time,p\n0,1\n0.1,\x002\n", "row 3, column p: a NUL byte"),
        (b"time,p\n0,1\n0.1," + b"7" * 200_000 + b"\n", "row 3, column p: '7777"),
        (b"time,p\n0,1\n0.1,2,3\n0.2,3\n", "row 3: 3 cells, the header has 2"),
        (b"time,p\n0,1\n0.1,2,3", "row 3: 3 cells, the header has 2"),
        (b'time,p\n0,1\n0.1,"2\n0.2,3\n', "row 3: a quotation mark that does not close"),
        (b"time,p\n\n0,1\n\n0.1,oops\n" + b"0.2,1\n" * 9, "row 5, column p: 'oops' is not a number"),
        (b"time,p\n0,1\n0.1,nan\n" + b"0.2,1\n" * 9, "row 3, column p: 'nan' is not a number"),
        (b"time,p\n0,1\n0.1,inf\n" + b"0.2,1\n" * 9, "row 3, column p: 'inf' is not a number"),
        (b"\xef\xbb\xbftime,p\n0,1\n0.1,\xff\xfe\n", "row 3, column p: "),
        (b"0,1\n1,2\n", "row 1: no header"),
        (b"", "row 1: no header"),
        (gzip.compress(b"time,p\n0,1\n", mtime=0), "not a table of text: compressed by gzip; unpack it first"),
        (b"PK\x03\x04\x14\0\0\0", "a ZIP archive or an Excel file; unpack it, or save the sheet as CSV"),
        (b"PAR1\x15\x04\x15", "a Parquet file; write its table as CSV first"),
        (b'{"t": 0.0, "q": [1, 2]}\n{"t": 0.1, "q": [1, 2]}\n', "a JSON file; write its table as CSV first"),
        (b'[\n {"t": 0.0},\n {"t": 1.0}]\n', "a JSON file; write its table as CSV first"),
        (archive(), "a NumPy file; write its arrays as columns of a CSV file first"),
        (b"time,p\n0,1\n0.1,OVLD\n" + b"0.2,1\n" * 9, "'OVLD' is not a number; leave out rows without a reading"),
        (b"time,p\n", "no data rows"),
        (b"time,p,p\n0,1,1\n", "'p' is given twice"),
    ],
)
def test_damage_is_named_with_row_and_column(tmp_path, raw, expected):
    try:
        table = Table(put(tmp_path / "a.csv", raw))
        table.load(table.header)
        assert any(expected in fault for fault in table.faults), table.faults
    except BadInput as error:
        assert expected in str(error)


def test_what_is_left_out_of_a_table_is_said(tmp_path):
    """A recorder that was ended in the middle of a row, and a remark of its user."""
    table = Table(put(tmp_path / "a.csv", "time,p\n0,1\n# paused\n1,2\n2,"[:-1]))
    assert len(table) == 2 and table.row_number(1) == 4
    assert table.remarks == [
        "1 row(s) that begin with # or % are taken for comments",
        "the last row is incomplete: left out",
    ]


def test_what_is_left_out_of_a_meters_file_is_said(tmp_path):
    t, q, _, p = arm(Z1)
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints), [t, q]))
    put(tmp_path / "p.csv", lines("time,power", [t, p]) + "# the end, at last\n")
    measured = read_set(log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\npower_file = "p.csv"\npower_start = 0\n'))
    assert measured.remarks == ("p.csv: 1 row(s) that begin with # or % are taken for comments",)


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


def test_stamps_with_too_few_digits_are_refused(tmp_path):
    """Of 1.7e9 s with nine digits two stamps are left: rows spread between them moved at half the speed or twice."""
    t, q, _, p = arm(Z1, 12.0)
    stamps = np.round(1.7e9 + t, -1)
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power", [stamps, q, p]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')
    with pytest.raises(BadInput, match="column time: 1201 rows have two different times or one"):
        read_set(tmp_path)


def test_missing_rows_are_counted_and_gaps_cut():
    t = np.delete(np.arange(1000) * 0.01, [*range(300, 303), *range(600, 700)])
    rows = clean(t, t[:, None])
    assert (
        rows.gaps == (596,)
        and "3 rows missing in 1 places" in rows.remarks[0]
        and "1.01 s after 5.99" in rows.remarks[1]
    )


def test_rows_that_repeat_the_positions_of_a_slower_source_are_held():
    t = 0.008 * np.arange(400)
    moves = np.column_stack([np.round(np.sin(np.clip(t - 0.8, 0, 1.6)), 4), np.zeros(400)])
    assert not held_samples(moves).any()
    stale = held_samples(moves[2 * (np.arange(400) // 2)])
    np.testing.assert_array_equal(stale, np.arange(400) % 2 == 1)


def test_irregular_stamps_of_rows_on_an_even_clock_are_replaced_and_irregular_rows_are_not():
    t = 0.008 * np.arange(400)
    late = t + np.random.default_rng(1).uniform(0, 0.003, len(t))
    rows = clean(late, np.column_stack([np.sin(t), np.zeros(400)]))
    np.testing.assert_allclose(np.diff(rows.time), 0.008, atol=1e-5)
    assert "late or early" in rows.remarks[0] and not rows.gaps
    rounded = clean(np.round(t, 2), np.column_stack([np.sin(t), np.zeros(400)]))  # some share a stamp
    np.testing.assert_allclose(np.diff(rounded.time), 0.008, atol=1e-5)
    assert len(rounded.kept) == 400 and "late or early" in rounded.remarks[0]
    kept = clean(late, np.column_stack([np.sin(late), np.zeros(400)]))
    np.testing.assert_array_equal(kept.time, late)
    assert not kept.remarks


def test_held_readings_differ_from_coarse_ones():
    rng = np.random.default_rng(0)
    slow = np.repeat(rng.normal(size=80), 12)
    assert update_indices(slow).tolist() == list(range(12, 960, 12))
    assert (
        update_indices(np.round(np.cumsum(rng.normal(size=2000)) / 30)) is None
        and update_indices(rng.normal(size=500)) is None
    )


# -- headers -----------------------------------------------------------------------------------------------------------

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
    found = joint_columns(header, robot)
    assert {signal: by[robot.joints[-1]] for signal, by in found.items() if signal in expected} == expected
    assert len(set(found["position"].values())) == robot.n and time_columns(header)[0] == header[0]


# -- recorders ---------------------------------------------------------------------------------------------------------


def test_columns_of_a_joint_states_bag_follow_the_names_in_the_message(tmp_path):
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
    import_files([tmp_path / "js.csv"], tmp_path / "set", UR)
    first = read_set(tmp_path / "set").runs[0].position
    np.testing.assert_allclose(first, q[: len(first)], atol=1e-6)
