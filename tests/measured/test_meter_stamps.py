"""Meters in files of their own: stamps in several columns, coarse ones, clocks of another kind; a negative current."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from logs import UR, arm, lines, put

from energy_opt.measured.importing import Imported, import_files

BEGIN = datetime(2024, 5, 13, 23, 59, 55, tzinfo=UTC)  # midnight is within the motion


def imported(folder: Path, header: str, rows: list[str], since: float = 0.0, seconds: float = 12.0) -> Imported:
    """The set of a motion, whose stamps begin at `since` [s], and of a meter with a header and rows."""
    t, q, _, _ = arm(UR, seconds)
    files = [put(folder / "a.csv", lines(",".join(["time", *UR.joints]), [since + t, q]))]
    files.append(put(folder / "meter.csv", "\n".join([header, *rows]) + "\n"))
    return import_files(files, folder / "set", UR)


def readings(step: float, window: float = 0.0, seconds: float = 12.0, first: float = 0.0) -> tuple[np.ndarray, ...]:
    """Times (M,) [s] of readings, and their powers (M,) [W]: means over a window [s] that ends there."""
    t, _, _, p = arm(UR, seconds)
    at = np.arange(first + window, seconds, step)
    energy = np.concatenate([[0], np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(t))])
    mean = (np.interp(at, t, energy) - np.interp(at - window, t, energy)) / max(window, 1e-9)
    return at, mean if window else np.interp(at, t, p)


def moments(at: np.ndarray, form: str, hours: float = 0.0) -> list[str]:
    return [(BEGIN + timedelta(hours=hours, seconds=float(x))).strftime(form) for x in at]


@pytest.mark.parametrize("form", ["%Y/%m/%d,%H:%M:%S", "%d.%m.%Y,%I:%M:%S %p"])
def test_day_time_and_millisecond_in_columns_of_their_own_are_one_clock(tmp_path: Path, form: str) -> None:
    """Nine of ten readings were left out, as they repeated the stamp of the one before."""
    at, power = readings(0.1)
    parts = zip(moments(at, form), moments(at, "%f"), power, strict=True)
    rows = [f"{k},{day},{int(part) // 1000},{x:.4f}" for k, (day, part, x) in enumerate(parts)]
    made = imported(tmp_path, "Store No.,DATE,Time,Millisecond,P-E1", rows, BEGIN.timestamp())
    assert "power.time: DATE and Time and Millisecond [date]" in made.words
    assert not any("left out" in remark for remark in made.remarks) and sum(
        len(run.power) for run in made.runs
    ) > 0.9 * len(at)
    for run in made.runs:
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time, at, power), atol=0.5)


@pytest.mark.parametrize("step", [0.5, 0.3])
@pytest.mark.parametrize("late", [0.0, 0.2])
def test_readings_that_share_stamps_of_whole_seconds_are_spread(tmp_path: Path, step: float, late: float) -> None:
    """All but the first of each second were left out, and the rest taken for the power at its stamp."""
    at, power = readings(step, step, 30.0)
    rows = [f"{time},{x:.4f}" for time, x in zip(moments(at + late, "%Y-%m-%d %H:%M:%S"), power, strict=True)]
    made = imported(tmp_path, "Date,Power (W)", rows, BEGIN.timestamp() + late, 30.0)
    said = f"meter.csv: readings in a row have the same time stamp: spread evenly, one every {step:g} s"
    assert said in made.remarks and sum(len(run.power) for run in made.runs) > 0.7 * len(at)
    for run in made.runs:
        assert run.window == pytest.approx(step, abs=0.01)
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time, at, power), atol=6)


def test_rows_of_several_channels_are_no_readings_in_a_row(tmp_path: Path) -> None:
    at, power = readings(1.0, 1.0, 30.0)
    both = zip(moments(at, "%Y-%m-%d %H:%M:%S"), power, strict=True)
    made = imported(tmp_path, "Date,Power (W)", [f"{t},{x:.4f}\n{t},5" for t, x in both], BEGIN.timestamp(), 30.0)
    assert any(f"{len(at)} readings are left out: they repeat the time stamp" in remark for remark in made.remarks)


@pytest.mark.parametrize(("form", "hours"), [("%H:%M:%S.%f", 0), ("%H:%M:%S.%f", 2), ("%d/%m/%Y %H:%M:%S.%f", -3.5)])
def test_times_of_day_and_of_other_zones_are_moved_to_the_joints_dates(tmp_path: Path, form: str, hours: float) -> None:
    """The first rows of both were taken for simultaneous, without a word."""
    at, power = readings(0.5, 0.5, first=1.0)
    rows = [f"{time},{x:.4f}" for time, x in zip(moments(at, form, hours), power, strict=True)]
    made = imported(tmp_path, "Time,Power (W)", rows, BEGIN.timestamp())
    said = f"moved by {-hours:+g} h, as of another time zone" if hours else "taken for the same day"
    assert f"meter.csv: its times are {said}, to overlap with those of a.csv" in made.remarks
    for run in made.runs:
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time, at, power), atol=0.5)


@pytest.mark.parametrize("drawn", [1.0, 0.0])
def test_a_clock_of_another_kind_is_found_or_the_report_says_that_it_is_not(tmp_path: Path, drawn: float) -> None:
    at, power = readings(0.5, 0.5, first=1.0)
    power = 60 + drawn * (power - 60) + np.random.default_rng(1).normal(0, 1, len(at))
    rows = [f"{time},{x:.4f}" for time, x in zip(moments(at, "%H:%M:%S.%f"), power, strict=True)]
    made = imported(tmp_path, "Time,Power (W)", rows)
    said = "found by correlation" if drawn else "its first reading is taken to be at the first row of the joints"
    assert any(said in remark for remark in made.remarks)
    for run in made.runs if drawn else ():
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time, at, power), atol=6)


def test_voltage_times_the_negative_current_of_a_battery_is_drawn_power(tmp_path: Path) -> None:
    at, power = readings(0.5)
    rows = [f"{t:.3f},{48:.1f},{-x / 48:.6f},0.8" for t, x in zip(at, power, strict=True)]
    made = imported(tmp_path, "time,field.voltage,field.current,field.charge", rows)
    assert min(run.power.min() for run in made.runs) > 50
    assert any("as of a battery that is discharged" in remark for remark in made.remarks)
