"""Units that headers name: converted if known; else the column is refused or left out by its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import SIX, UR, arm, lines, log, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set
from energy_opt.measured.columns import named_unit
from energy_opt.measured.importing import Imported, import_files
from energy_opt.measured.stated_units import stated_unit
from energy_opt.measured.table import Table

T, Q, V, P = arm(UR)
TORQUE = 3 * Q


def imported(folder: Path, position: str = "q{}", size: float = 1.0, power: str = "power", watts: float = 1.0,
             effort: str = "", torque: float = 1.0) -> Imported:  # fmt: skip
    """An import of one file; each header has a factor from SI units."""
    names = [form.format(k + 1) for form in (position, effort) if form for k in SIX]
    columns = [T, Q * size, *([TORQUE * torque] if effort else []), P * watts]
    path = put(folder / "a.csv", lines(",".join(["time", *names, power]), columns, "%.9f"))
    return import_files([path], folder / "set", UR)


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("power [hp]", 1 / 745.7),
        ("power_hW", 0.01),
        ("Power (PS)", 1 / 735.5),
        ("power [J/s]", 1),
        ("power_cW", 100),
        ("power [dW]", 10),
    ],
)
def test_power_in_other_units_than_watts(tmp_path: Path, header: str, factor: float) -> None:
    made = imported(tmp_path, power=header, watts=factor)
    assert max(run.power.max() for run in made.runs) == pytest.approx(P.max(), rel=1e-3)
    assert any(word.startswith("power in ") and word.endswith(": converted") for word in made.words)


@pytest.mark.parametrize(
    ("header", "factor"),
    [("q{} [mrad]", 1000), ("q{}_mrad", 1000), ("q{}_rev", 0.5 / np.pi), ("q{} [gon]", 200 / np.pi)],
)
def test_angles_in_other_units_than_radians(tmp_path: Path, header: str, factor: float) -> None:
    made = imported(tmp_path, header, factor)
    np.testing.assert_allclose(made.runs[0].position, Q[: len(made.runs[0].time)], atol=1e-6)
    assert any(word.startswith("positions are ") and word.endswith(": converted") for word in made.words)


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("tau{} [kgf cm]", 10.197162),
        ("tau{} [in-lb]", 8.8507458),
        ("tau{} [Nmm]", 1e3),
        ("tau{}_Nmm", 1e3),
        ("torque{} [kNm]", 1e-3),
    ],
)
def test_torques_in_other_units_than_newton_metres(tmp_path: Path, header: str, factor: float) -> None:
    run = imported(tmp_path, effort=header, torque=factor).runs[0]
    np.testing.assert_allclose(run.effort, TORQUE[: len(run.time)], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("header", ["power [BTU/h]", "power [0.1 W]", "power [%]", "power [counts]", "power [GW]"])
def test_power_in_an_unknown_unit_is_refused(tmp_path: Path, header: str) -> None:
    unit = header[7:-1]
    with pytest.raises(BadInput, match=f"column '.*{unit}]': '{unit}' is no unit of power; known: W, "):
        imported(tmp_path, power=header)


@pytest.mark.parametrize("unit", ["U", "%", "arcmin", "A", "counts"])
def test_angles_in_an_unknown_unit_are_refused(tmp_path: Path, unit: str) -> None:
    with pytest.raises(
        BadInput, match=f"'q1 .{unit}.*'{unit}' is no unit of position|unit '{unit}' of 'q1 .* not known"
    ):
        imported(tmp_path, f"q{{}} [{unit}]", 10.0)


def test_an_unknown_unit_without_brackets_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="'q1_arcmin': 'arcmin' is no unit of position"):
        imported(tmp_path, "q{}_arcmin", 3437.75)


@pytest.mark.parametrize("unit", ["oz in", "%", "kPa"])
def test_torques_in_an_unknown_unit_are_left_out(tmp_path: Path, unit: str) -> None:
    made = imported(tmp_path, effort=f"tau{{}} [{unit}]")
    assert made.runs[0].effort is None and f"effort is left out: its unit {unit} is not known" in made.words


def test_a_log_by_hand_does_not_take_an_unknown_unit_for_si(tmp_path: Path) -> None:
    names = [f"{joint}.position" for joint in UR.joints]
    put(tmp_path / "a.csv", lines(",".join(["time", *names, "power [BTU/h]"]), [T, Q, P]))
    rest = '[[run]]\nfile = "a.csv"\n[columns]\npower = {}\n'
    (fault,) = inspect_set(log(tmp_path, "ur5e", rest.format('"power [BTU/h]"')))[0]
    assert "column 'power [BTU/h]': 'BTU/h' is no unit of power" in fault
    given = '{ column = "power [BTU/h]", unit = "W" }'
    assert inspect_set(log(tmp_path, "ur5e", rest.format(given)))[0] == []


@pytest.mark.parametrize(
    "header",
    [
        "power (total)",
        "Leistung (gesamt)",
        "power [CH 2]",
        "power (UR5)",
        "q1 (measured)",
        "state.q[0]",
        "P_ps",
        "Leistung (Summe)",
        "Power (smoothed)",
        "power (B)",
        "Power (24V)",
        "P (10 ms)",
        "posizione (misurata)",
        "q1(t)",
    ],
)
def test_names_in_brackets_are_no_units(header: str) -> None:
    assert stated_unit("position" if header.startswith(("q", "state")) else "power", header) == ""


def test_the_name_of_a_joint_is_no_unit(tmp_path: Path) -> None:
    assert stated_unit("position", "Angle (lift)", joint="lift_joint") == ""
    table = Table(put(tmp_path / "a.csv", "time,j1_rev\n0,1\n"))
    assert named_unit("position", "j1_rev", table, "j1_rev") is None
    assert named_unit("position", "j1_rev", table, "j1") == "rev"


STATED = {
    "power": {"Power [kW] (smoothed)": "kW", "P_kW (moyenne)": "kW", "Power [W x10]": "W x10"},
    "position": {"q1 [deg.]": "deg"},
    "voltage": {"voltage (volts)": "volts"},
    "effort": {
        "tau_J[0]": "",
        "tau1 [kgf m]": "kgf m",
        "tau1 [Nm x100]": "Nm x100",
        "tau1 [rated torque %]": "rated torque %",
    },
    "velocity": {"dq1 [rad s-1]": "", "dq1 (filtered)": "", "dq1 [%]": "%"},
}


@pytest.mark.parametrize(("kind", "header"), [(kind, header) for kind, found in STATED.items() for header in found])
def test_the_unit_counts_wherever_the_header_has_it(kind: str, header: str) -> None:
    assert stated_unit(kind, header) == STATED[kind][header]
