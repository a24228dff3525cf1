"""The study of the source paper's table reaches the figures that follow from its rows."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

PATH = Path(__file__).resolve().parents[2] / "benchmarks" / "paper_table.py"


def test_the_residual_of_the_table():
    spec = importlib.util.spec_from_file_location("paper_table", PATH)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    first = module.study()["method 1"]
    assert first["error_before_percent"] == pytest.approx(3.46, abs=0.005)
    assert first["energy_per_move"] == pytest.approx(7.90, abs=0.01)
    assert list(first["power_by_direction"].values()) == pytest.approx([1.30, 2.61, 1.58], abs=0.01)
    assert first["rms_after"] == pytest.approx(0.28, abs=0.01)
    assert first["metering_time"] == pytest.approx(0.086, abs=0.001)
    assert first["error_left_out_percent"] < 0.1 < first["left_out_without_energy_per_move"]
