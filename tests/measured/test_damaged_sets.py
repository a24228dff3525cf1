"""Sets that are damaged, large, or leave their folder: one line says what is wrong, or they are read."""

from __future__ import annotations

import numpy as np
import pytest
from logs import Z1, arm, lines, log, put

from energy_opt.cli.main import main
from energy_opt.measured import inspect_set, read_set


@pytest.fixture
def plain(tmp_path):
    t, q, _, p = arm(Z1)
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power", [t, q, p]))
    return log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("time,", "time,x,", "cells, the header has"),
        ("\n0.010000,", "\n1e300,", "cannot be a time"),
        ("\n0.010000,0.000000", "\n0.010000,1e30", "column joint1.position: 1e+30 cannot be a position"),
    ],
)
def test_values_that_no_arm_has(plain, old, new, expected):
    text = (plain / "a.csv").read_text()
    assert old in text
    put(plain / "a.csv", text.replace(old, new, 1))
    assert any(expected in fault for fault in inspect_set(plain)[0])


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1000.0), ("s", 0.001), ("us", 1000.0)])
def test_stamps_in_another_unit_are_doubted(plain, unit, factor):
    t, q, _, p = arm(Z1)
    put(
        plain / "a.csv",
        lines("time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power", [t * factor, q, p], "%.9f"),
    )
    if unit == "ms":
        assert "s between rows; is the time's unit right" in inspect_set(plain)[0][0]
    log(plain, "z1", f'[columns]\ntime = {{ column = "time", unit = "{unit}" }}\n[[run]]\nfile = "a.csv"\n')
    assert bool(inspect_set(plain)[0]) == (unit != "ms")


def test_files_stay_in_the_set(plain, tmp_path, capsys):
    outside = put(tmp_path.parent / f"{tmp_path.name}_x.csv", (plain / "a.csv").read_text())
    for name in (str(outside), f"../{outside.name}"):
        log(plain, "z1", f'[[run]]\nfile = "{name}"\n')
        assert "lies outside" in inspect_set(plain)[0][0] and "joint1" not in inspect_set(plain)[0][0]
        assert main(["check", str(plain), "--quiet"]) == 2
        assert main(["check", str(plain), "--quiet", "--allow-outside"]) == 0
    assert inspect_set(plain, allow_outside=True)[0] == []
    capsys.readouterr()


def test_a_robot_outside_of_the_set_has_to_be_allowed(plain, tmp_path, monkeypatch, capsys):
    """By an absolute path, by one that climbs, and by one that is found from the current folder only."""
    urdf = put(tmp_path.parent / f"{tmp_path.name}_z1.urdf", Z1.urdf.read_text())
    monkeypatch.chdir(urdf.parent)
    for name in (str(urdf), f"../{urdf.name}", urdf.name):
        log(plain, name, '[[run]]\nfile = "a.csv"\n')
        assert main(["check", str(plain), "--quiet"]) == 2
        assert urdf.name in (said := capsys.readouterr().err) and "jointGripper" not in said
        assert "jointGripper" in inspect_set(plain, allow_outside=True)[0][0]  # it was read: the set lacks that joint
    put(plain / urdf.name, Z1.urdf.read_text())
    assert "jointGripper" in inspect_set(plain)[0][0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[[run]]\nfile = "a.csv"\npower_fil = "p.csv"\n', "did you mean 'power_file'?"),
        ('[[run]]\nfile = "a.csv"\nstart = "1.0"\n', "start = '1.0'"),
        ('[[run]]\nfile = "a.csv"\nenergy = true\n', "energy = True"),
        ('[[run]]\nfile = "a.csv"\npower_start = 1\n', "without a power_file"),
        ('[[run]]\nfile = "a.csv"\n[meter]\nwindow = "0.1"\n', "window = '0.1'"),
        ('[[run]]\nfile = "a.csv"\n[meter]\nwindo = 0.1\n', "did you mean 'window'?"),
        ('[[run]]\nfile = "a.csv"\n[csv]\ndecimal = ";"\n', "decimal = ';'"),
        ('[[run]]\nfile = "a.csv"\n[csv]\ndelimiter = 3\n', "delimiter = 3"),
        ('[[run]]\nfile = "a.csv"\n[csv]\ndelimiter = "\\u0000"\n', "delimiter = "),
        (
            '[[run]]\nfile = "a.csv"\n[columns]\npower = { product = ["u", 3] }\n',
            "product, sum and difference are lists of headers",
        ),
        ('[[run]]\nfile = "a.csv"\n[columns]\npower = { column = "u", unt = "W" }\n', "did you mean 'unit'?"),
        ('[[run]]\nfile = "a.csv"\n[columns]\npreset = ["x"]\n', "known: ur_rtde, franka_state, joint_state"),
    ],
)
def test_keys_and_kinds_of_values_are_held(plain, text, expected):
    assert expected in inspect_set(log(plain, "z1", text))[0][0]


def test_no_damage_makes_a_traceback(plain):
    rng = np.random.default_rng(5)
    whole = (plain / "a.csv").read_bytes()[:6000]
    for _ in range(120):
        raw = bytearray(whole)
        for _ in range(rng.integers(1, 4)):
            at, kind = int(rng.integers(len(raw))), rng.integers(5)
            if kind == 0:
                raw[at] = int(rng.integers(256))
            elif kind == 1:
                del raw[at : at + int(rng.integers(1, 200))]
            elif kind == 2:
                raw[at:at] = rng.choice([b'"', b"\n", b",", b";", b"1e300", b"nan", b"\r", b" ", b"\0\0"])
            elif kind == 3:
                raw = raw[: max(at, 2)]
            else:
                raw[at : at + 4] = b"\xff\xfe\xfd\xfc"
        put(plain / "a.csv", bytes(raw))
        for fault in inspect_set(plain)[0]:
            assert "\n" not in fault and len(fault) < 1000


def test_a_tenth_hertz_of_a_million_rows_takes_linear_time(tmp_path):
    """Two sizes: four times the rows take about four times the time (process time, generous)."""
    import time

    seconds = []
    for count in (20_000, 80_000):
        t = np.arange(count) * 0.002
        q = np.array([0.1, 1.0, -1.0, 0.1, 0.1, 0.1]) + 0.3 * np.sin(np.outer(t, np.arange(1, 7) / 3))
        header = "time," + ",".join(f"{j}.position" for j in Z1.joints) + ",power"
        folder = log(tmp_path / str(count), "z1", '[[run]]\nfile = "a.csv"\n')
        put(folder / "a.csv", lines(header, [t, q, 60 + np.abs(q[:, 1])]))
        begin = time.process_time()
        assert len(read_set(folder).runs[0].time) == count
        seconds.append(time.process_time() - begin)
    assert seconds[1] < 8 * seconds[0] + 0.2
