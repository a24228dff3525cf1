"""Meters in tables of logs: their columns, kinds and clocks."""

from __future__ import annotations

import numpy as np
import pytest
from logs import PANDA, SEVEN, SIX, Z1, arm, lines, log, put

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.measured import nodes, operator, read_set
from energy_opt.measured.header import cut
from energy_opt.measured.importing import import_files
from energy_opt.measured.meter_names import energy_column, power_column, product_columns, whole_power


@pytest.mark.parametrize(
    ("header", "power", "energy", "product"),
    [
        (["Time", "Voltage", "Current", "Active Power", "Apparent Power", "Power Factor"], "Active Power", None, None),
        (["t", "P_total_W", "tau_1"], "P_total_W", None, None),
        (["t", "Leistung [kW]"], "Leistung [kW]", None, None),
        (["Temps", "Puissance apparente [VA]", "Puissance active"], "Puissance active", None, None),
        (["Tiempo", "Energía (Wh)", "Tensión [V]"], None, "Energía (Wh)", None),
        (["Ora", "Tensione [V]", "Corrente [A]"], None, None, ("Tensione [V]", "Corrente [A]")),
        (["t", "power_limit_W", "power_estimate_W", "power_meter_W"], "power_meter_W", None, None),
        (["t", "P_mech", "P_elec"], "P_elec", None, None),
        (["t", "power_percent"], None, None, None),
        (["t", "kWh"], None, "kWh", None),
        (["time", "apower", "voltage", "current", "pf"], "apower", None, None),
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


@pytest.mark.parametrize(
    ("header", "power"),
    [
        (["Base power (W)", "Shoulder power (W)", "Elbow power (W)"], None),
        (["Power_A", "Power_B", "Power_C"], None),
        (["Power_B", "Power_C", "Power_total"], "Power_total"),
        (["PC power", "Controller power"], "Controller power"),
        (["BasePower", "ArmPower"], "ArmPower"),
        (["Lamp power", "Belt power"], None),
        (["Power_VA", "cos phi"], None),
        (["Scheinleistung [kVA]", "Blindleistung [kvar]", "Wirkleistung"], "Wirkleistung"),
        (["Power import (W)", "Power export (W)"], "Power import (W)"),
        (["power_mean", "power_target"], "power_mean"),
        (["Leistung (W)", "Power (W)"], "Leistung (W)"),
    ],
)
def test_a_part_of_the_robots_power_is_not_the_whole(header: list[str], power: str | None) -> None:
    assert power_column(header) == power


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (["t", "P_L1", "P_L2", "P_L3"], ("sum", ["P_L1", "P_L2", "P_L3"])),
        (["L1 [W]", "L2 [W]", "L3 [W]", "L1 [V]"], ("sum", ["L1 [W]", "L2 [W]", "L3 [W]"])),
        (["a_act_power", "a_aprt_power", "b_act_power", "c_act_power"], ("sum", [f"{k}_act_power" for k in "abc"])),
        (["P_L1", "P_L2", "P_L3", "P_total"], ("column", ["P_total"])),
        (["P_L1", "P_L2"], ("", [])),
        (["P_L1", "P_L2", "P_L3", "P_L4"], ("", [])),
        (["Power_A", "Power_B", "Power_C"], ("", [])),
        (["Power import (W)", "Power export (W)"], ("difference", ["Power import (W)", "Power export (W)"])),
        (["Power import (W)", "t"], ("column", ["Power import (W)"])),
        (["U [V]", "I [A]"], ("product", ["U [V]", "I [A]"])),
    ],
)
def test_power_is_a_column_or_the_sum_difference_or_product_of_some(header, expected):
    assert whole_power(header) == expected


@pytest.mark.parametrize("how", ["sum", "difference"])
def test_power_of_several_columns_is_imported_with_a_word(tmp_path, how):
    t, q, _, p = arm(Z1)
    names, parts = ["P_L1 (kW)", "P_L2 (kW)", "P_L3 (kW)"], [p / 4000, p / 4000, p / 2000]
    if how == "difference":
        names, parts = ["Power import (W)", "Power export (W)"], [np.maximum(p, 90) - 30, np.maximum(90 - p, 0) + 0 * p]
    header = ",".join(["time", *(f"q{k}" for k in SIX), *names])
    put(tmp_path / "a.csv", lines(header, [t, q, *parts]))
    made = import_files([tmp_path / "a.csv"], tmp_path / "set", Z1)
    assert any(word.startswith(f"power: {(' + ' if how == 'sum' else ' - ').join(names)}") for word in made.words)
    true = p if how == "sum" else p - 30
    for run in read_set(tmp_path / "set").runs:
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time, t, true), atol=1e-2)


@pytest.mark.parametrize(
    ("file", "header", "taken"),
    [
        ("power", "%time,field.data", True),
        ("robot_power_2", "%time,field.header.seq,data", True),
        ("Leistung", "Zeit;Wert", True),
        ("meter", "time,data", False),
        ("motor_power", "time,data", False),
        ("power", "time,field.data0,field.data1", False),
        ("power", "time,voltage", False),
        ("power", "time,data [V]", False),
    ],
)
def test_a_column_that_says_nothing_is_the_power_if_the_files_name_says_so(tmp_path, file, header, taken):
    t, q, _, p = arm(Z1)
    put(tmp_path / "a.csv", lines(",".join(["time", *(f"q{k}" for k in SIX)]), [t, q]))
    mark = ";" if ";" in header else ","
    columns = [t, *[p] * header.count(mark)]
    put(tmp_path / f"{file}.csv", lines(header, columns, delimiter=mark))
    files = [tmp_path / "a.csv", tmp_path / f"{file}.csv"]
    if taken:
        made = import_files(files, tmp_path / "set", Z1)
        assert any("as the file's name says; the unit W is assumed" in word for word in made.words)
        return
    with pytest.raises(BadInput, match="nor power nor energy") as refused:
        import_files(files, tmp_path / "set", Z1)
    assert ("power data:W" in str(refused.value)) == (header == "time,data")


def test_voltage_and_current_of_a_phase_are_not_the_whole_supply() -> None:
    assert product_columns(["Voltage_A", "Current_A", "Voltage_B", "Current_B"]) is None
    robots = ["robot_voltage", "pc_voltage", "pc_current", "robot_current"]
    assert product_columns(robots) == ("robot_voltage", "robot_current")
    assert energy_column(["Energy_A", "Energy_B"]) is None


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
    for run in read_set(tmp_path / "set").runs:
        assert len(run.power) >= 4 and run.window == pytest.approx(np.full(len(run.power), 0.5), abs=0.02)
        at = nodes(run)
        expected = operator(run, at) @ np.interp(run.start + at, t, p)
        np.testing.assert_allclose(run.power, expected, atol=0.5)


def test_a_meters_clock_is_found_and_reported(tmp_path):
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


@pytest.mark.parametrize(
    ("second", "lasts", "third", "moved"),
    [(0.8, 3, 0.8, 0.8), (1.8, 3, 0.8, 0.8), (0.8, 20, 0, 0.0), (0.8, 3, 200, 0.0)],
)
def test_runs_that_are_too_short_to_show_the_meters_clock_have_that_of_the_others(
    tmp_path, second, lasts, third, moved
):
    """Two runs show a meter that is 0.8 s ahead; a third one is too short, or its clocks agree. Or the two differ: then
    the law of the two shows the third one's clock.

    Or the third one's meter did not run during the motion.
    """
    rng, rest = np.random.default_rng(3), ""
    for k, (seconds, ahead) in enumerate([(30, 0.8), (30, second), (lasts, third)]):
        t, q, _, p = arm(Z1, seconds)
        own = np.arange(0.0, seconds, 0.1)
        put(tmp_path / f"{k}.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints), [t, q]))
        drawn = np.full(len(own), p[0]) if ahead > seconds else np.interp(own, t, p)
        put(tmp_path / f"p{k}.csv", lines("time,power", [own + ahead, drawn + rng.normal(0, 2, len(own))]))
        rest += f'[[run]]\nfile = "{k}.csv"\npower_file = "p{k}.csv"\n'
    log(tmp_path, "z1", rest + "[meter]\nwindow = 0\n")
    if third > lasts:  # it was "moved as in other runs", and had no reading left
        with pytest.raises(BadInput, match="its clock runs from 200 to 202"):
            read_set(tmp_path)
        return
    measured = read_set(tmp_path)
    assert measured.runs[2].clock == ("estimated" if moved else "shared")
    assert measured.runs[2].power_time[0] == pytest.approx(third - moved, abs=0.1)
    assert any("as in other runs" in x for x in measured.remarks) == bool(moved and second == 0.8)


def test_counters_totals_and_no_meter(tmp_path):
    t, q, _, p = arm(Z1)
    energy = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(t))])
    header = "time," + ",".join(f"{j}.position" for j in Z1.joints)
    put(tmp_path / "a.csv", lines(header + ",wh", [t, q, 7 + energy / 3600], "%.9f"))
    log(tmp_path, "z1", '[columns]\nenergy = { column = "wh", unit = "Wh" }\n[[run]]\nfile = "a.csv"\n')
    run = read_set(tmp_path).runs[0]
    assert run.meter == "energy" and float(run.power @ run.window) == pytest.approx(energy[-1], rel=1e-4)
    log(tmp_path, "z1", f'[[run]]\nfile = "a.csv"\nenergy = {energy[-1]}\n')
    run = read_set(tmp_path).runs[0]
    assert run.meter == "total" and (operator(run, t) @ p)[0] * t[-1] == pytest.approx(energy[-1], rel=1e-6)
    amps = header + "," + ",".join(f"{j}.current" for j in Z1.joints)
    put(tmp_path / "a.csv", lines(amps, [t, q, q]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')
    assert read_set(tmp_path, meter=False).runs[0].current is not None
    with pytest.raises(BadInput, match="no run has a reading of power"):
        read_set(tmp_path)


@pytest.mark.parametrize(("first", "usable"), [(1.0, True), (4.0, False)])
def test_a_slow_meter_within_a_short_run_is_on_its_clock(tmp_path, first, usable):
    t = np.arange(300) * 0.01
    names = ",".join(f"{joint}.position" for joint in Z1.joints)
    put(tmp_path / "a.csv", lines(f"time,{names}", [t, np.full((300, 6), 0.3)]))
    put(tmp_path / "p.csv", lines("time,power", [first + np.arange(2), np.array([60.0, 61.0])]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\nkind = "static"\npower_file = "p.csv"\n')
    if usable:
        assert read_set(tmp_path).runs[0].power.tolist() == [60.0, 61.0]
    else:
        with pytest.raises(BadInput, match=r"from 4 to 5 s, .*they hardly overlap"):
            read_set(tmp_path)
