"""A log.toml that a person wrote: units that files name, columns and values that are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import Z1, arm, lines, log, put

from energy_opt.errors import BadInput
from energy_opt.measured import inspect_set, read_set

RUN = '[[run]]\nfile = "a.csv"\n'
NAMES = ",".join(f"{joint}.position" for joint in Z1.joints)


def made(folder: Path, rest: str, header: str, columns: list[np.ndarray], units: str = "") -> Path:
    put(folder / "a.csv", lines(header, columns, "%.9g").replace("\n", f"\n{units}\n" if units else "\n", 1))
    return log(folder, "z1", RUN + rest)


@pytest.mark.parametrize(
    ("columns", "header", "units", "factors"),
    [
        ('power = "P [kW]"', "P [kW]", "", (1e-3,)),
        ('power = "P_mW"', "P_mW", "", (1e3,)),
        ('power = { product = ["u", "i"] }', "u,i", ",".join(["s", *["rad"] * 6, "V", "mA"]), (1 / 48, 1e3 * 48)),
        ('power = { product = ["u [mV]", "i [mA]"] }', "u [mV],i [mA]", "", (1e3 / 48, 1e3 * 48)),
        ('power = { product = ["u", "i"] }', "u,i", "", (1 / 48, 48)),
    ],
)
def test_units_that_headers_and_rows_name_hold_without_the_log(tmp_path, columns, header, units, factors):
    t, q, _, p = arm(Z1)
    written = [p * factors[0]] if len(factors) == 1 else [48 * 48 * factors[0] + 0 * p, p / 48 / 48 * factors[1]]
    folder = made(tmp_path, f"[columns]\n{columns}\n", f"time,{NAMES},{header}", [t, q, *written], units)
    (run,) = read_set(folder).runs
    np.testing.assert_allclose(run.power, p, rtol=1e-6)


def test_a_header_in_degrees_is_converted(tmp_path):
    t, q, _, p = arm(Z1)
    columns = "".join(f'"{joint}.position" = "q{k} [deg]"\n' for k, joint in enumerate(Z1.joints))
    header = ",".join(f"q{k} [deg]" for k in range(6))
    folder = made(tmp_path, f"[columns]\n{columns}", f"time,{header},power", [t, np.degrees(q), p])
    np.testing.assert_allclose(read_set(folder).runs[0].position, q, atol=1e-7)


def test_one_column_for_two_joints_is_refused(tmp_path):
    t, q, _, p = arm(Z1)
    first, second = Z1.joints[:2]
    folder = made(tmp_path, f'[columns]\n"{first}.position" = "{second}.position"\n', f"time,{NAMES},power", [t, q, p])
    with pytest.raises(BadInput, match=f"is read as the position of {first} and of {second}"):
        read_set(folder)


@pytest.mark.parametrize(
    ("rest", "fault", "remark"),
    [
        ("energy = -800.0\n", "energy = -800", ""),
        ("energy = 0\n", "energy = 0", ""),
        ("[meter]\nwindow = 100\n", "a.csv lasts 8 s; is the window in s?", ""),
        ("energy = 0.8\n", "", "the mean power is 0.1 W; arms with their controllers take 5 to 20000 W"),
    ],
)
def test_values_in_another_unit_are_named(tmp_path, rest, fault, remark):
    t, q, _, p = arm(Z1)
    faults, remarks = inspect_set(made(tmp_path, rest, f"time,{NAMES},power", [t, q, p]))
    assert any(fault in said for said in faults) if fault else faults == []
    assert not remark or any(remark in said for said in remarks)


@pytest.mark.parametrize(("signal", "factor"), [("velocity", 57.3), ("velocity", -1), ("acceleration", 0)])
def test_rates_that_contradict_the_positions_are_named_and_not_used(tmp_path, signal, factor):
    t, q, v, p = arm(Z1)
    rates = {"velocity": v, "acceleration": np.gradient(v, t, axis=0)}
    header = ",".join([f"time,{NAMES},power", *(f"{joint}.{name}" for name in rates for joint in Z1.joints)])
    coarse = np.round(q / 0.002) * 0.002  # an encoder whose steps are large beside the change from row to row
    right = read_set(made(tmp_path / "right", "", header, [t, coarse, p, *rates.values()]))
    assert right.runs[0].velocity is not None and right.runs[0].acceleration is not None
    rates[signal] = factor * rates[signal]
    folder = made(tmp_path / "wrong", "", header, [t, q, p, *rates.values()])
    wrong = read_set(folder)
    assert getattr(wrong.runs[0], signal) is None
    assert any(f"logged {signal} contradicts the positions: not used" in remark for remark in wrong.remarks)
    assert any(signal in fault and "are unit and" in fault for fault in inspect_set(folder)[0])
