"""`check`, `simulate` and `evaluate` read a recording alike; units of its times and positions are looked at."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from energy_opt.cli.main import main
from energy_opt.front.moves import path_from
from energy_opt.measured import read_set
from energy_opt.robot import load_robot

START, TURNED = np.array([0.1, -1.2, 1.4, -1.2, -1.5, 0.05]), np.array([0.9, -0.5, 0.6, -0.4, 0.3, -0.8])
PLANT = """format = "energy-opt/model/1"
robot = "ur5e"
[[effect]]
name = "standby"
power = 80.0
[[effect]]
name = "copper_loss"
r_over_kt2 = 0.05
"""


def table(file: Path, digits: int = 12, scale: float = 1.0, degrees: bool = False, rates: float | None = None) -> Path:
    """A move of a ur5e in 1.5 s at 250 Hz; `scale`: of its times, `rates`: factor of a column of velocities."""
    time = np.arange(0, 1.5 + 1e-9, 0.004)
    u = (time / 1.5)[:, None]
    q = START + TURNED * u**3 * (10 - 15 * u + 6 * u**2)
    joints = load_robot("ur5e").joints
    header, columns = ["time", *(f"{joint}.position" for joint in joints)], [np.degrees(q) if degrees else q]
    if rates is not None:
        header += [f"{joint}.velocity" for joint in joints]
        columns.append(rates * TURNED * 30 * u**2 * (1 - u) ** 2 / 1.5)
    values = np.round(np.hstack(columns), digits)
    np.savetxt(file, np.c_[time * scale, values], delimiter=",", header=",".join(header), comments="", fmt="%.12g")
    return file


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and all that a command says."""
    code = main(words)
    both = capsys.readouterr()
    return code, both.out + both.err


def played(file: Path, folder: Path) -> list[str]:
    """The command that plays a file on a virtual arm."""
    (folder / "plant.toml").write_text(PLANT)
    return ["simulate", str(file), "--plant", str(folder / "plant.toml"), "--out", str(folder / "set")]


def test_a_recording_of_few_digits_keeps_the_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`check` called it beyond its limits of acceleration and torque, `evaluate` did not."""
    file = table(tmp_path / "run.csv", digits=3)
    code, text = said(["check", str(file), "--robot", "ur5e"], capsys)
    assert code == 0 and "noisy recording" in text
    assert said(["evaluate", str(file), "--robot", "ur5e", "--out", str(tmp_path / "out")], capsys)[0] == 0
    motion = json.loads((tmp_path / "out" / "evaluate.json").read_text())["motions"][0]
    assert motion["valid"]


def test_rates_of_a_file_are_judged_as_stated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Velocities of few samples beyond the limit count, though the positions do not confirm them."""
    file = table(tmp_path / "run.csv", rates=1.0)
    lines = file.read_text().splitlines()
    cells = lines[100].split(",")
    cells[7] = "4.0"  # rad/s, limit pi
    file.write_text("\n".join([*lines[:100], ",".join(cells), *lines[101:]]))
    code, text = said(["check", str(file), "--robot", "ur5e"], capsys)
    assert code == 2 and "velocity of shoulder_pan_joint is 4 " in text and "row 101" in text


@pytest.mark.parametrize("verb", ["check", "evaluate", "simulate"])
def test_times_in_milliseconds_are_remarked_on(verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if verb == "simulate":
        pytest.importorskip("mujoco")
    for scale, slow in ((1000.0, True), (20.0, False)):
        file = table(tmp_path / "run.csv", scale=scale)
        words = [verb, str(file), "--robot", "ur5e"]
        if verb == "evaluate":
            words += ["--out", str(tmp_path / f"out{scale}"), "--model", "careful"]
        if verb == "simulate":
            words = [*played(file, tmp_path), "--repeat", "1000" if slow else "1"]  # too long: refused after reading
        text = said(words, capsys)[1]
        assert ("are its times milliseconds? Then name their column time_ms" in text) == slow


@pytest.mark.parametrize(("scale", "slow"), [(1000.0, True), (20.0, False)])
def test_times_of_a_path_in_milliseconds_are_remarked_on(scale: float, slow: bool, tmp_path: Path) -> None:
    heard = list[str]()
    path_from(table(tmp_path / "run.csv", scale=scale), load_robot("ur5e"), say=heard.append)
    assert any("are its times milliseconds?" in note for note in heard) == slow


def test_positions_in_degrees_are_not_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They were played as radians: the arm turned by 90 rad."""
    pytest.importorskip("mujoco")
    code, text = said(played(table(tmp_path / "run.csv", degrees=True), tmp_path), capsys)
    assert code == 2 and "look like degrees" in text


def test_a_fine_encoder_keeps_its_digits(tmp_path: Path) -> None:
    """Below 1e-6 rad, positions were written as whole radians."""
    pytest.importorskip("mujoco")
    file = table(tmp_path / "run.csv")
    assert main([*played(file, tmp_path), "--encoder", "1e-7", "--quiet"]) == 0
    (run,) = read_set(tmp_path / "set").runs
    assert np.ptp(run.position[:, 0]) == pytest.approx(0.9, abs=0.01)


def test_stops_on_the_way_may_be_nearer_than_the_clearance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its ends may be, and so may the ends of the motions that a cycle consists of; `check` refused those."""
    time = np.arange(0, 4.0, 0.01)
    u = np.clip(np.where(time < 2, time, 4 - time) / 1.5, 0, 1)[:, None]  # there, half a second at rest, and back
    q = START + TURNED * u**3 * (10 - 15 * u + 6 * u**2)
    post = "objects:\n- {name: post, type: sphere, radius: 0.05, position: [-0.049, 0.475, 0.354]}\n"
    (tmp_path / "scene.yaml").write_text(post)  # 40 mm from the wrist at the turning point
    for name, part in (("there", time < 1.75), ("and back", time < 4)):
        file = tmp_path / f"{name}.csv"
        header = ",".join(["time", *load_robot("ur5e").joints])
        np.savetxt(file, np.c_[time, q][part], delimiter=",", header=header, comments="", fmt="%.12g")
        words = ["--robot", "ur5e", "--scene", str(tmp_path / "scene.yaml"), "--clearance", "0.05"]
        assert said(["check", str(file), *words], capsys)[0] == 0
