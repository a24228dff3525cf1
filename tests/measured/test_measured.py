"""Measured sets: columns, units, clocks, cuts, differentiation, and faults named with file, row and column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt.errors import BadInput
from energy_opt.files import write_text
from energy_opt.measured import (
    Run,
    Smoothing,
    choose_smoothing,
    inspect_set,
    kinematics,
    nodes,
    operator,
    read_log,
    read_set,
)
from energy_opt.numerics.signals import standstills
from energy_opt.robot import load_robot
from energy_opt.tables import write_table

FIG9 = Path(__file__).resolve().parents[3] / "shared/data/rad_ur3e_power/fig9.csv"
JOINTS = load_robot("z1").joints


def motion(seconds: float = 3.0, step: float = 0.008, speed: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions (N, 6) of six slow sines inside z1's limits."""
    t = np.arange(round(seconds / step)) * step
    q = np.array([0.1, 1.0, -1.0, 0.1, 0.1, 0.1]) + 0.3 * np.sin(speed * np.outer(t, np.arange(1, 7) / 2))
    return t, q


def write_run(path: Path, t: np.ndarray, q: np.ndarray, power: np.ndarray | None, header: list[str] | None = None):
    names = header or ["time", *(f"{joint}.position" for joint in JOINTS)]
    columns = [t, *q.T]
    if power is not None:
        names = names if header else [*names, "power"]
        columns.append(power)
    write_table(path, names, columns)


def write_log(folder: Path, runs: str, rest: str = "") -> Path:
    write_text(folder / "log.toml", f'format = "energy-opt/log/1"\nrobot = "z1"\n{rest}\n{runs}\n')
    return folder


ONE = '[[run]]\nfile = "a.csv"\nkind = "motion"\n'


@pytest.fixture
def plain(tmp_path):
    t, q = motion()
    write_run(tmp_path / "a.csv", t, q, 30 + q[:, 1])
    return write_log(tmp_path, ONE)


def test_plain_set(plain):
    run = read_set(plain).runs[0]
    _, q = motion()
    np.testing.assert_allclose(run.position, q)
    np.testing.assert_allclose(run.power, 30 + q[:, 1])
    assert run.start == 0 and run.velocity is None and inspect_set(plain)[0] == []


def test_other_headers_and_units_mean_the_same(plain, tmp_path):
    t, q = motion()
    other = tmp_path / "other"
    other.mkdir()
    header = ["ms", *(f"q{k}" for k in range(6)), "volt"]
    write_run(other / "a.csv", 1000 * t, np.degrees(q), (30 + q[:, 1]) / 48, header)
    text = (other / "a.csv").read_text().splitlines()
    write_text(other / "a.csv", "\n".join([text[0] + ",ampere", *(line + ",48" for line in text[1:])]) + "\n")
    rules = ["[columns]", 'time = { column = "ms", unit = "ms" }', 'power = { product = ["volt", "ampere"] }']
    rules += [f'"{joint}.position" = {{ column = "q{k}", unit = "deg" }}' for k, joint in enumerate(JOINTS)]
    write_log(other, ONE + "\n".join(rules))
    a, b = read_set(plain).runs[0], read_set(other).runs[0]
    np.testing.assert_allclose(a.position, b.position)
    np.testing.assert_allclose(a.time, b.time)
    np.testing.assert_allclose(a.power, b.power)


def test_columns_may_stand_in_any_order(plain):
    table = [line.split(",") for line in (plain / "a.csv").read_text().splitlines()]
    before = read_set(plain).runs[0]
    write_text(plain / "a.csv", "\n".join(",".join(row[::-1]) for row in table) + "\n")
    after = read_set(plain).runs[0]
    np.testing.assert_array_equal(before.position, after.position)
    np.testing.assert_array_equal(before.power, after.power)


def test_a_meter_with_its_own_file_and_clock(tmp_path):
    t, q = motion()
    write_run(tmp_path / "a.csv", t, q, None)
    own = np.arange(0.003, 2.9, 0.02)
    write_table(tmp_path / "p.csv", ["time", "power"], [own, 30 + own])
    runs = '[[run]]\nfile = "a.csv"\nkind = "motion"\nstart = 12.5\npower_file = "p.csv"\n'
    run = read_set(write_log(tmp_path, runs)).runs[0]
    np.testing.assert_allclose(run.power, 30 + run.power_time)
    assert run.start == 12.5 and len(run.power) == len(own)
    turns = [f"{x:.3f}," if k % 2 else ",40" for k, x in enumerate(own)]
    write_text(tmp_path / "p.csv", "\n".join(["time,power", *turns]) + "\n")
    with pytest.raises(BadInput, match=r"p\.csv: columns time and power: no row that is used has both"):
        read_set(tmp_path)


@pytest.mark.parametrize(
    ("row", "column", "cell", "expected"),
    [
        (7, 3, "oops", "row 7, column joint3.position: 'oops' is not a number"),
        (9, 7, "", "row 9, column power: '' is empty"),
        (11, 0, "0.0", "row 11, column time: time 0 s does not come after"),
        (5, 2, "nan", "row 5, column joint2.position"),
    ],
)
def test_faults_name_file_row_and_column(plain, row, column, cell, expected):
    lines = (plain / "a.csv").read_text().splitlines()
    cells = lines[row - 1].split(",")
    cells[column] = cell
    lines[row - 1] = ",".join(cells)
    write_text(plain / "a.csv", "\n".join(lines) + "\n")
    faults = inspect_set(plain)[0]
    assert any("a.csv" in fault and expected in fault for fault in faults), faults
    with pytest.raises(BadInput, match="row"):
        read_set(plain)


def test_every_fault_is_listed(plain):
    lines = (plain / "a.csv").read_text().splitlines()
    for row in (4, 8):
        cells = lines[row - 1].split(",")
        cells[1] = "x"
        lines[row - 1] = ",".join(cells)
    write_text(plain / "a.csv", "\n".join(lines) + "\n")
    assert len(inspect_set(plain)[0]) == 2
    with pytest.raises(BadInput, match="1 more fault"):
        read_set(plain)


def test_gaps_units_and_kinds_are_doubted(plain):
    t, q = motion()
    write_run(plain / "a.csv", np.where(t > 1.5, t + 1.0, t), q, 30 + q[:, 1])
    measured = read_set(plain)
    assert [len(r.time) for r in measured.runs] == [188, 187] and "cut at 1 gap" in measured.remarks[0]
    assert all(np.allclose(r.power, 30 + r.position[:, 1]) for r in measured.runs)
    write_run(plain / "a.csv", t, np.degrees(q), 30 + q[:, 1])
    assert any("row 2, column joint1.position" in x and "look like degrees" in x for x in inspect_set(plain)[0])
    write_run(plain / "a.csv", t, q, 30 + q[:, 1])
    write_log(plain, ONE.replace("motion", "static"))
    assert any("called static" in fault for fault in inspect_set(plain)[0])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[[run]]\nfile = "a.csv"\nkind = "fast"', "kind = 'fast'"),
        ('[[run]]\nkind = "static"', "file is missing"),
        (ONE + "colour = 1", "unknown key 'colour'"),
        (ONE + '[columns]\npreset = "none"', "known: ur_rtde"),
        (ONE + '[columns]\ntime = { column = "t", unit = "moon" }', "'moon' is no unit of time; known: s, ms"),
        (ONE + '[columns]\n"elbow.position" = "x"', "no joint 'elbow'"),
        (ONE + '[segment]\nat = "noon"', "standstill"),
        ("", "no [[run]] table"),
    ],
)
def test_faults_of_the_log_itself(plain, text, expected):
    assert expected in inspect_set(write_log(plain, text))[0][0]


def test_a_folder_without_a_log_says_what_to_write(tmp_path):
    write_text(tmp_path / "rec.csv", "timestamp,actual_q_0\n0,0\n")
    with pytest.raises(BadInput, match="ur_rtde"):
        read_log(tmp_path)


def test_a_recording_is_cut_at_standstill(tmp_path):
    t = np.arange(0, 12, 0.008)
    ramp = np.clip((t - 1) / 2, 0, 1) - np.clip((t - 4) / 2, 0, 1) + np.clip((t - 9) / 2, 0, 1)
    q = np.array([0.1, 1.0, -1.0, 0.1, 0.1, 0.1]) + 0.5 * (3 * ramp**2 - 2 * ramp**3)[:, None]
    assert len(standstills(t, q)) == 4
    write_run(tmp_path / "a.csv", t, q, 30 + t)
    runs = read_set(write_log(tmp_path, ONE + '[segment]\nat = "standstill"')).runs
    assert [r.kind for r in runs].count("motion") == 3 and any(r.kind == "static" for r in runs)
    for run in runs:
        np.testing.assert_allclose(run.power, 30 + run.start + run.power_time)


def test_differentiation_is_accurate_and_has_no_phase(plain):
    t, q = motion(4.0, speed=2.0)
    noisy = np.round(q / 2e-5) * 2e-5
    write_run(plain / "a.csv", t, noisy, 30 + q[:, 1])
    run = read_set(plain).runs[0]
    smoothing = choose_smoothing([run])
    assert 3e-6 < smoothing.position_noise < 1.2e-5  # 2e-5 / sqrt(12) is 5.8e-6
    inner = np.arange(0.4, 3.6, 0.01)
    k = kinematics(run, inner, smoothing)
    rate = np.arange(1, 7)
    np.testing.assert_allclose(k.v, 0.3 * rate * np.cos(np.outer(inner, rate)), atol=2e-3)
    np.testing.assert_allclose(k.a, -0.3 * rate**2 * np.sin(np.outer(inner, rate)), atol=0.1)


def test_the_cutoff_follows_the_motion(plain):
    cutoffs = []
    for speed in (0.3, 6.0):
        t, q = motion(4.0, speed=speed)
        write_run(plain / "a.csv", t, np.round(q / 2e-5) * 2e-5, 30 + q[:, 1])
        run = read_set(plain).runs[0]
        cutoffs.append(kinematics(run, t[50:-50], choose_smoothing([run])).cutoffs)
    assert (cutoffs[0] <= cutoffs[1]).all() and cutoffs[0].max() < cutoffs[1].max()


def test_logged_velocity_is_used_and_cross_checked(plain):
    t, q = motion()
    v = np.gradient(q, t, axis=0)
    names = ["time", *(f"{j}.position" for j in JOINTS), *(f"{j}.velocity" for j in JOINTS), "power"]
    write_table(plain / "a.csv", names, [t, *q.T, *v.T, 30 + t])
    assert inspect_set(plain)[0] == []
    run = read_set(plain).runs[0]
    np.testing.assert_allclose(kinematics(run, t[5:-5], Smoothing(1e-6, 1e-6)).v, v[5:-5], atol=2e-2)
    write_table(plain / "a.csv", names, [t, *q.T, *(3 * v).T, 30 + t])
    assert any("differs from the slope" in fault for fault in inspect_set(plain)[0])


@pytest.mark.skipif(not FIG9.is_file(), reason="the shared recording is not here")
def test_a_real_recording_by_preset(tmp_path):
    (tmp_path / "fig9.csv").write_bytes(FIG9.read_bytes())
    text = '[[run]]\nfile = "fig9.csv"\nkind = "motion"\n[columns]\npreset = "ur_rtde"\n[segment]\nat = "standstill"\n'
    write_text(tmp_path / "log.toml", 'format = "energy-opt/log/1"\nrobot = "ur3e"\n' + text)
    assert inspect_set(tmp_path)[0] == []
    measured = read_set(tmp_path)
    assert len(measured.runs) > 10 and measured.payload is not None and measured.payload.mass == 1.07
    power = np.concatenate([r.power for r in measured.runs])
    assert 30 < power.min() < power.max() < 70


def run_with_windows(window, stamps):
    time = np.linspace(0, 10, 501)
    still = np.zeros((501, 1))
    return Run("a", "motion", 0.0, time, still, None, None, None, None, stamps, np.zeros(len(stamps)), window=window)


def test_a_slow_meter_sees_the_mean_over_its_window():
    stamps = np.array([1.0, 2.0, 3.5, 9.0])
    run = run_with_windows(np.array([1.0, 0.5, 1.5, 0.0]), stamps)
    at = nodes(run)
    assert np.diff(at).max() <= 0.02 + 1e-12
    # p = t^2: its mean over [a, b] is (b^3 - a^3) / 3 (b - a)
    expected = [1 / 3, (8 - 1.5**3) / 1.5, (3.5**3 - 8) / 4.5, 81.0]
    np.testing.assert_allclose(operator(run, at) @ (at**2), expected, atol=1e-4)
    uneven = np.r_[0, np.sort(np.random.default_rng(0).uniform(0, 10, 40)), 10]
    matrix = operator(run, uneven)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    # exact for what is linear between the nodes, whichever nodes
    np.testing.assert_allclose(matrix @ (3 * uneven + 2), 3 * (stamps - run.window / 2) + 2, atol=1e-9)
    slopes = operator(run, at) @ np.column_stack([at, at**2])
    np.testing.assert_allclose(slopes[:, 1], operator(run, at) @ (at**2))


def test_starts_that_make_runs_overlap_are_named_and_not_used(tmp_path):
    t, q = motion()
    for name in "ab":
        write_run(tmp_path / f"{name}.csv", t, q, 30 + q[:, 1])
    entries = '[[run]]\nfile = "a.csv"\nstart = 100.0\n[[run]]\nfile = "b.csv"\nstart = {}\n'
    _, remarks = inspect_set(write_log(tmp_path, entries.format(101.5)))
    (said,) = [remark for remark in remarks if "start of b.csv" in remark]
    assert "101.5 s" in said and "a.csv ends at 103 s" in said
    measured = read_set(tmp_path)
    assert not measured.clock
    assert measured.runs[1].start == pytest.approx(measured.runs[0].start + t[-1])
    write_log(tmp_path, entries.format(102.5))  # rounded to a second: within what is accepted
    assert read_set(tmp_path).clock and not any("start of" in remark for remark in inspect_set(tmp_path)[1])
