"""Units that differ from others by a prefix: mJ and MJ, mA and A, microseconds and nanoseconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt.measured import read_set
from energy_opt.measured.header import UNITS, known_unit
from energy_opt.measured.importing import import_files
from energy_opt.numerics.stamps import stamp_factor
from energy_opt.robot import load_robot

WATTS = 120.0  # mean power of what is recorded


def recorded(folder: Path, rate: float, columns: dict[str, np.ndarray], stamp: str = "time", tick: float = 1.0) -> Path:
    """A table of a ur5e's sine of 0.2 Hz over 20 s, with a meter's `columns`; times are whole multiples of `tick`."""
    time = np.arange(0, 20, 1 / rate)
    q = np.array([0, -1.2, 1.4, -1.2, -1.5, 0]) + 0.5 * np.sin(0.4 * np.pi * time)[:, None]
    joints = {name: q[:, j] for j, name in enumerate(load_robot("ur5e").joints)}
    stamps = time if tick == 1.0 else np.round(time / tick)
    table = {stamp: stamps, **joints, **{name: values[: len(time)] for name, values in columns.items()}}
    file = folder / "log.csv"
    np.savetxt(file, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="")
    return file


def mean_power(file: Path, tmp_path: Path) -> float:
    """Mean power [W] of the set that `import` makes of a file."""
    import_files([file], tmp_path / "set", robot=load_robot("ur5e"))
    (run,) = read_set(tmp_path / "set").runs
    assert run.time[-1] - run.time[0] == pytest.approx(20, rel=0.05)
    return float(np.mean(run.power))


def test_case_separates_milli_from_mega() -> None:
    """Counters in mJ were read as MJ."""
    for kind, words in (("energy", ("mJ", "MJ", "mWh", "MWh")), ("power", ("mW", "MW"))):
        for word in words:
            assert UNITS[kind][str(known_unit(kind, word))] == UNITS[kind][word]
    assert known_unit("energy", "mj") == "mJ" and known_unit("energy", "KWH") == "kWh"


@pytest.mark.parametrize("header", ["energy_mJ", "energy [mJ]", "energy"])
def test_a_counter_in_millijoules(header: str, tmp_path: Path) -> None:
    counter = np.round(1e3 * WATTS * np.arange(0, 21, 0.02))
    assert mean_power(recorded(tmp_path, 50, {header: counter}), tmp_path) == pytest.approx(WATTS, rel=0.01)


def test_a_current_without_a_unit_in_milliamperes(tmp_path: Path) -> None:
    """48 V times 2,500 were 120 kW."""
    ripple = 1 + 0.05 * np.sin(np.arange(1000))
    columns = {"voltage": 48 + 0 * ripple, "current": np.round(1e3 * WATTS / 48 * ripple)}
    assert mean_power(recorded(tmp_path, 50, columns), tmp_path) == pytest.approx(WATTS, rel=0.01)


@pytest.mark.parametrize("rate", [5, 50, 500])
@pytest.mark.parametrize("tick", [1e-3, 1e-6, 1e-9])
def test_the_unit_of_stamps_at_any_rate(rate: int, tick: float, tmp_path: Path) -> None:
    """Microseconds of 5 samples/s were read as nanoseconds."""
    power = WATTS + np.sin(np.arange(20 * rate))
    assert stamp_factor(np.arange(100) / rate / tick) == tick
    file = recorded(tmp_path, rate, {"power": power}, "timestamp", tick)
    assert mean_power(file, tmp_path) == pytest.approx(WATTS, rel=0.01)
