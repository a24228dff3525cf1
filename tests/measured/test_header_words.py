"""Words of headers that must not make a column the measured position or torque of a joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import UR, arm, lines, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set
from energy_opt.measured.header import known_unit
from energy_opt.measured.importing import import_files
from energy_opt.measured.names import joint_columns, time_columns

MEASURED = [
    (["Sollwinkel A{k} [°]", "Istwinkel A{k} [°]", "Sollmoment A{k} [Nm]"], {"position": "Istwinkel A{k} [°]"}),
    (["Achse{k}_Sollposition", "Achse{k}_Istposition"], {"position": "Achse{k}_Istposition"}),
    (["Achse {k} Sollwert [°]", "Achse {k} Istwert [°]"], {"position": "Achse {k} Istwert [°]"}),
    (["qref{k}", "qact{k}", "qerr{k}"], {"position": "qact{k}"}),
    (["consigna_{k}_pos", "joint_{k}"], {"position": "joint_{k}"}),
    (["J{k} PWM", "J{k} Angle (deg)"], {"position": "J{k} Angle (deg)"}),
    (["J{k} Load", "J{k} Pos"], {"position": "J{k} Pos"}),
    (["a{k}", "v{k}", "q{k}"], {"position": "q{k}", "velocity": "v{k}"}),
    (["v{k}", "i{k}", "q{k}"], {"position": "q{k}", "current": "i{k}"}),
    (["v{k} [V]", "q{k}"], {"position": "q{k}"}),
    (["J{k} Smoothness", "J{k}"], {"position": "J{k}"}),
    (["J{k} PWM", "J{k} Load", "Axis {k} temperature"], {"temperature": "Axis {k} temperature"}),
    (["J{k} [A]", "J{k} (deg/s)", "J{k} [deg]", "J{k} [W]"],
     {"current": "J{k} [A]", "velocity": "J{k} (deg/s)", "position": "J{k} [deg]"}),
    (["A{k} [Grad]", "M{k} [Nm]"], {"position": "A{k} [Grad]", "effort": "M{k} [Nm]"}),
    (["q{k}", "T{k}_Nm"], {"position": "q{k}", "effort": "T{k}_Nm"}),
    (["q{k}", "M{k} [A]", "T{k} [°C]"], {"position": "q{k}"}),
    (["position_error_{k}"], {}),
    (["Articulation {k} consigne [°]", "Articulation {k} mesurée [degrés]", "Couple axe {k} [Nm]", "Vitesse axe {k}"],
     {"position": "Articulation {k} mesurée [degrés]", "effort": "Couple axe {k} [Nm]", "velocity": "Vitesse axe {k}"}),
    (["Posición eje {k} [grados]", "Velocidad eje {k}", "Aceleración eje {k}", "Corriente eje {k} [A]"],
     {"position": "Posición eje {k} [grados]", "velocity": "Velocidad eje {k}",
      "acceleration": "Aceleración eje {k}", "current": "Corriente eje {k} [A]"}),
    (["Posizione asse {k} (gradi)", "Velocità asse {k}", "Coppia asse {k}"],
     {"position": "Posizione asse {k} (gradi)", "velocity": "Velocità asse {k}", "effort": "Coppia asse {k}"}),
]  # fmt: skip


@pytest.mark.parametrize(("headers", "expected"), MEASURED)
def test_numbered_columns_are_measured_values_of_the_joints(headers: list[str], expected: dict[str, str]) -> None:
    found = joint_columns([header.format(k=k) for header in headers for k in range(1, 7)], UR)
    want = {s: {joint: text.format(k=k) for k, joint in enumerate(UR.joints, 1)} for s, text in expected.items()}
    assert found == want


NAMED = [
    (["{j}.reference", "{j}.position"], {"position": "{j}.position"}),
    (["{j}.computed_torque", "{j}.position"], {"position": "{j}.position"}),
    (["{j} (deg)", "{j} (Nm)", "{j} (W)"], {"position": "{j} (deg)", "effort": "{j} (Nm)"}),
]


@pytest.mark.parametrize(("headers", "expected"), NAMED)
def test_columns_with_the_joints_names_are_measured_values(headers: list[str], expected: dict[str, str]) -> None:
    found = joint_columns([header.format(j=joint) for header in headers for joint in UR.joints], UR)
    assert found == {s: {joint: text.format(j=joint) for joint in UR.joints} for s, text in expected.items()}


def test_measured_positions_by_number_come_before_commanded_ones_by_name() -> None:
    header = [*(f"{joint}.target_position" for joint in UR.joints), *(f"q{k}" for k in range(6))]
    assert list(joint_columns(header, UR)["position"].values()) == header[6:]


def test_squared_seconds_are_no_unit_of_a_velocity() -> None:
    assert known_unit("velocity", "deg/s^2") is None and known_unit("acceleration", "deg/s²") == "deg/s^2"
    assert known_unit("acceleration", "deg/s") is None and known_unit("position", "deg/s") is None


@pytest.mark.parametrize("form", ["{}.target_position", "{}/reference_position", "target_q_{}"])
def test_commanded_positions_are_used_with_a_remark_if_there_are_no_others(tmp_path: Path, form: str) -> None:
    t, q, _, p = arm(UR)
    names = [form.format(joint if "/" in form or "." in form else k) for k, joint in enumerate(UR.joints)]
    path = put(tmp_path / "a.csv", lines(",".join(["time", *names, "power"]), [t, q, p]))
    made = import_files([path], tmp_path / "set", UR)
    np.testing.assert_allclose(made.runs[0].position, q[: len(made.runs[0].time)], atol=1e-6)
    said = f"a.csv: positions are commanded ones, not measured, by the header {names[0]!r}"
    assert said in made.remarks and said in inspect_set(tmp_path / "set")[1]


def test_power_of_each_joint_is_not_its_position(tmp_path: Path) -> None:
    t, q, _, p = arm(UR)
    names = [f"J{k} Power" for k in range(1, 7)]
    path = put(tmp_path / "a.csv", lines(",".join(["time", *names, "power"]), [t, q, p]))
    with pytest.raises(BadInput, match="no file has a column for the position"):
        import_files([path], tmp_path / "set", UR)


def test_a_row_of_units_below_the_header_has_the_words_of_headers(tmp_path: Path) -> None:
    t, q, _, p = arm(UR)
    header = ";".join(["Zeit", *(f"A{k}" for k in range(1, 7)), "P"]) + "\n" + ";".join(["s", *["Grad"] * 6, "kW"])
    path = put(tmp_path / "a.csv", lines(header, [t, np.degrees(q), p / 1000], delimiter=";"))
    run = import_files([path], tmp_path / "set", UR).runs[0]
    np.testing.assert_allclose(run.position, q[: len(run.time)], atol=1e-6)
    assert run.power.min() > 50


def test_ts_names_the_stamps() -> None:
    assert time_columns(["ts_ms", "power_mW"]) == ["ts_ms"]
