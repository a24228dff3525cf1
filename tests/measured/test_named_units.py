"""Units that headers name are converted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logs import SIX, UR, arm, lines, put

from energy_opt.measured.importing import Imported, import_files

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
    [("power [hp]", 1 / 745.7), ("Power (PS)", 1 / 735.5), ("power [J/s]", 1), ("power_cW", 100), ("power [dW]", 10)],
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
    ("header", "factor"), [("tau{} [kgf cm]", 10.197162), ("tau{} [in-lb]", 8.8507458), ("torque{} [kNm]", 1e-3)]
)
def test_torques_in_other_units_than_newton_metres(tmp_path: Path, header: str, factor: float) -> None:
    run = imported(tmp_path, effort=header, torque=factor).runs[0]
    np.testing.assert_allclose(run.effort, TORQUE[: len(run.time)], rtol=1e-4, atol=1e-3)
