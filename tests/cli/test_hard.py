"""What careless and hostile users do: one line, exit 0, 2, 3 or 4, nothing lost, nothing half written."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine import allowed

import energy_opt as eo
from energy_opt.batches.records import read_journal
from energy_opt.cli import faults
from energy_opt.cli.main import main
from energy_opt.folders import leave_folder, take_folder, written_whole

START, GOAL = "0,0,0,-1.5,0,1.5,0", "0.3,0.2,0.1,-1.2,0.1,1.7,0.2"
MOVE = [
    "optimize",
    "--model",
    "source-method-2",
    "--robot",
    "panda",
    "--mode",
    "retime",
    "--compile",
    "never",
    "--quiet",
]
ENDS = ["--start", START, "--goal", GOAL]
COMMAND = [sys.executable, "-m", "energy_opt"]


@pytest.fixture(autouse=True)
def _nothing_unforeseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault that only the last net catches is a fault of the program: here it fails the test."""

    def raised(error: Exception) -> None:
        raise AssertionError("unforeseen") from error

    foreseen = faults.as_error

    def as_error(error: Exception) -> eo.EnergyOptError:
        found = foreseen(error)
        if isinstance(found, faults.Unforeseen):
            raised(error)
        return found

    monkeypatch.setattr("energy_opt.cli.main.as_error", as_error)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--duration", "1e-300"], "1e-06 to 100000 s"),
        (["--max-duration", "1e300"], "1e-06 to 100000 s"),
        (["--verify-samples", "1000000000000"], "100 to 2000000"),
        (["--controls", "1000000"], "10 to 400"),
        (["--seed", "-1"], "--seed -1"),
        (["--seed", "9" * 400], "--seed 9999"),
        (["--max-power", "1e-300"], "0.001 to 1e+09 W"),
        (["--tool-speed", "nan"], "1e-06 to 50 m/s"),
        (["--tool-acceleration", "1e300"], "1e-06 to 1000 m/s^2"),
        (["--limits", "a\0b"], "--limits a\\x00b"),
        (["--scene=\0"], "NUL"),
        (["--srdf=--"], "--srdf: no value"),
        (["--payload", "nan"], "not finite"),
        (["--lock", "panda_joint1"], "JOINT=VALUE"),
        (["--robot", "x" * 5000], "x"),
        (["--robot", "\0"], "\\x00"),
        (["--model", "/dev/full"], "/dev/full"),
        (["--out", "/dev/full"], "--out /dev/full"),
        (["--out", "a\0b"], "--out"),
        (["--out", ""], "--out: empty; expected a folder"),
        (["--out="], "--out: empty; expected a folder"),
        (["--scene", "a\udcfc"], "a\\udcfc: not text in this locale's encoding; rename"),
        (["--controls", "9" * 4500], "…"),
    ],
)
def test_extremes_are_one_line(words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begin = time.process_time()
    assert main([*MOVE, *ENDS, "--out", str(tmp_path), *words]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1 and len(said) < 1600
    assert time.process_time() - begin < allowed(5) and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "words",
    [["--rest", "nan"], ["--static", "inf"], ["--repeat", "1000000"], ["--resolution", "0"], ["--encoder", "nan"]],
)
def test_simulate_refuses_nan_and_infinity(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plant.toml").write_text('format = "energy-opt/model/1"\nrobot = "z1"\n')
    joints = [f"joint{k}.position" for k in range(1, 7)]
    rows = [",".join(["time", *joints]), *(f"{t / 10},{t / 100},1,-1,0,0,0" for t in range(10))]
    (tmp_path / "t.csv").write_text("\n".join(rows))
    out = tmp_path / "set"
    files = [str(tmp_path / "t.csv"), "--plant", str(tmp_path / "plant.toml"), "--out", str(out)]
    assert main(["simulate", *files, *words]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and words[0].strip("-") in said and not out.exists()


def test_a_move_that_no_encoder_sees_is_answered_at_once() -> None:
    robot = eo.load_robot("xarm7")
    planner = eo.Planner(robot, eo.source_model(robot), eo.Settings(compile="never"))
    start, begin = np.zeros(7), time.process_time()
    for size in (1e-9, 5e-7):
        for mode in ("retime", "reshape"):
            goal = start + size * np.eye(7)[2]
            result = planner.solve(eo.Move(start, goal, mode))
            assert result.status == "solved" and result.certificate.valid and "encoder" in result.message
            assert np.abs(result.trajectory.position[-1] - goal).max() == 0
            with pytest.raises(eo.Infeasible) as short:
                planner.solve(eo.Move(start, goal, mode, duration=1e-6))
            assert short.value.shortest_duration is not None
    panda = eo.load_robot("panda")
    planner = eo.Planner(panda, eo.source_model(panda), eo.Settings(compile="never"))
    start = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
    brief = eo.Move(start, start + 8e-9 * np.array([1, -0.5, 0.3, 0.2, -1, 0.7, 0.1]), "retime")
    brief = replace(brief, duration=1.3 * planner.minimum_time(brief))  # in which rows a microsecond apart are rounding
    assert planner.solve(brief).certificate.valid
    assert time.process_time() - begin < allowed(10)


def test_rows_follow_the_motion_not_the_clock() -> None:
    robot = eo.load_robot("z1")
    planner = eo.Planner(robot, eo.source_model(robot), eo.Settings(compile="never"))
    start, goal = np.array([0, 1, -1, 0, 0, 0.0]), np.array([1, 1.5, -1.5, 0.2, 0.3, 0.4])
    energies = {}
    for duration in (20.0, 3600.0):
        result = planner.solve(eo.Move(start, goal, "retime", duration=duration))
        assert result.certificate.valid and len(result.trajectory.time) < 21_000
        energies[duration] = result.energy.loss
    assert energies[3600.0] > energies[20.0]


# Written whole or not at all


@pytest.mark.parametrize(
    ("held", "words"), [("results.jsonl", [*MOVE, *ENDS]), ("job.json", [*MOVE, *ENDS]), ("result.json", ["bench", ""])]
)
def test_no_verb_writes_over_the_results_of_another(
    held: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their reports and plots have the same names."""
    out = tmp_path / "out"
    out.mkdir()
    (out / held).write_text("{}")
    (tmp_path / "s.toml").write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["z1"]\nmodes = ["retime"]\ndurations = [1.0]\n'
        'models = ["source_method_2"]\n[[moves]]\nname = "m"\nstart = [0, 1, -1, 0, 0, 0]\ngoal = [1, 1, -1, 0, 0, 0]\n'
    )
    assert main([word or str(tmp_path / "s.toml") for word in words] + ["--out", str(out)]) == 2
    assert f"({held}); choose another --out" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == [held]


def test_a_planned_motion_is_not_taken_for_a_measured_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("result.json", "trajectory.csv"):
        (tmp_path / name).write_text("{}")
    assert main(["check", str(tmp_path)]) == 2
    assert "result.json: lists no files" in capsys.readouterr().err
    assert main(["diagnose", str(tmp_path), "--robot", "panda", "--model", "source-method-2"]) == 2
    assert "a planned motion, not a measured set" in capsys.readouterr().err


def test_results_change_place_together_and_the_last_comes_last(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("old")
    (tmp_path / "trajectory.csv").write_text("old")
    with pytest.raises(RuntimeError), written_whole(tmp_path, "result.json") as aside:
        (aside / "trajectory.csv").write_text("new")
        raise RuntimeError
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"result.json": "old", "trajectory.csv": "old"}
    (tmp_path / "trajectory.csv").unlink()
    (tmp_path / "trajectory.csv").mkdir()  # its place cannot be taken
    with pytest.raises(eo.BadInput, match="a folder where a file"), written_whole(tmp_path, "result.json") as aside:
        (aside / "trajectory.csv").write_text("new")
        (aside / "result.json").write_text("{}")
    assert (tmp_path / "result.json").read_text() == "old"


def test_out_is_tried_before_the_work_and_left_as_it_was(tmp_path: Path) -> None:
    take_folder(tmp_path / "a" / "b")
    leave_folder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    for name in ("file", "file/below", "x" * 300, "\0"):
        with pytest.raises(eo.BadInput, match="cannot be written"):
            take_folder(tmp_path / name)


def test_a_folder_of_a_running_process_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Told before the work, in one line; the other run's death, by SIGKILL too, frees the folder."""
    out = tmp_path / "deep" / "out"
    hold = f"from energy_opt.folders import take_folder as t; t({str(out)!r}); print(1, flush=True); input()"
    other = subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert other.stdout is not None and other.stdout.readline() == b"1\n"
    words = [*MOVE, *ENDS, "--duration", "2", "--self-collision", "off", "--out", str(out)]
    assert main([*words, "--force"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "another run is writing here" in said
    with pytest.raises(eo.BadInput, match="another run"), written_whole(out, "result.json"):
        pass
    assert not list(out.iterdir())
    other.kill()
    other.communicate()
    assert main(words) == 0 and (out / "result.json").is_file()
    take_folder(out)  # by this process, which may go on writing there
    with written_whole(out, "result.json"):
        pass
    leave_folder(out)


def test_a_folder_that_is_removed_during_the_work_is_created_again(tmp_path: Path) -> None:
    """The result of the work was lost."""
    out = tmp_path / "out"
    take_folder(out)
    out.rmdir()
    with written_whole(out, "last.json") as aside:
        (aside / "last.json").write_text("{}")
    leave_folder(out)
    assert [path.name for path in out.iterdir()] == ["last.json"]


def _small_files() -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))


def test_a_full_disk_keeps_the_old_result(tmp_path: Path) -> None:
    words = [*COMMAND, *MOVE, *ENDS, "--duration", "2", "--out", str(tmp_path)]
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / "trajectory.csv").write_text("old")
    run = subprocess.run(words, capture_output=True, text=True, preexec_fn=_small_files, check=False)
    assert run.returncode == 2 and run.stderr.count("\n") == 1 and "cannot be written" in run.stderr, run.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["result.json", "trajectory.csv"]
    assert (tmp_path / "trajectory.csv").read_text() == "old"


def test_stdout_that_is_full_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(
            [*COMMAND, "--example", "model"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert run.returncode == 2 and run.stderr.count("\n") == 1, run.stderr


INTERRUPTED = """
import os, signal, sys
library = sys.argv.pop()
class Press:  # Ctrl-C at the moment a library is first asked for
    def find_spec(self, name, path=None, target=None):
        if name == library:
            exec("os.kill(os.getpid(), signal.SIGINT); len(name)")  # libraries run text while they are imported
from energy_opt.__main__ import command
sys.meta_path.insert(0, Press())
sys.exit(command())
"""


@pytest.mark.parametrize("library", ["argparse", "numpy", "casadi", "pinocchio"])
def test_an_interrupt_is_quiet_while_libraries_load(library: str, tmp_path: Path) -> None:
    """`python -m energy_opt` had ended by the signal, and with --json without a document."""
    (tmp_path / "pressed.py").write_text(INTERRUPTED)
    words = [sys.executable, "-m", "pressed", *MOVE, *ENDS, "--json", "--out", "out", library]
    run = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert run.returncode == 130 and "Traceback" not in run.stderr and run.stderr.count("\n") <= 1, run.stderr
    assert json.loads(run.stdout)["status"] == "interrupted"


def test_simulated_data_do_not_replace_measured_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plant.toml").write_text('format = "energy-opt/model/1"\nrobot = "z1"\n')
    joints = [f"joint{k}.position" for k in range(1, 7)]
    rows = [",".join(["time", *joints]), *(f"{t / 10},{t / 100},1,-1,0,0,0" for t in range(10))]
    (tmp_path / "t.csv").write_text("\n".join(rows))
    (tmp_path / "log.toml").write_text("measured")
    words = ["simulate", str(tmp_path / "t.csv"), "--plant", str(tmp_path / "plant.toml"), "--out", str(tmp_path)]
    assert main([*words, "--quiet"]) == 2 and "--force" in capsys.readouterr().err
    assert (tmp_path / "log.toml").read_text() == "measured"
    (tmp_path / "log.toml").unlink()
    (tmp_path / "result.json").write_text("{}")
    assert main([*words, "--quiet"]) == 2 and "holds the results of optimize" in capsys.readouterr().err
    assert (tmp_path / "result.json").read_text() == "{}"


def test_a_simulated_set_names_the_urdf_that_was_given(tmp_path: Path) -> None:
    """It had named the robot alone, by which no URDF is found again."""
    robot = eo.load_robot("ur5e")
    urdf = str(robot.urdf)
    (tmp_path / "plant.toml").write_text('format = "energy-opt/model/1"\nrobot = "ur5e"\n')
    rows = ["time," + ",".join(f"{joint}.position" for joint in robot.joints)]
    rows += [f"{t / 10},{t / 100},-1,1,0,0,0" for t in range(4)]
    (tmp_path / "t.csv").write_text("\n".join(rows))
    words = ["--robot", urdf, "--plant", str(tmp_path / "plant.toml"), "--out", str(tmp_path / "set"), "--quiet"]
    assert main(["simulate", str(tmp_path / "t.csv"), *words, "--self-collision", "off"]) == 0
    truth = tomllib.loads((tmp_path / "set" / "truth.toml").read_text())
    assert json.loads(truth["request"])["robot"] == urdf


def test_failures_have_documents(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*MOVE, *ENDS, "--json", "--duration", "1e300", "--out", str(tmp_path)]) == 2
    assert json.loads(capsys.readouterr().out)["status"] == "bad_input"


RELEASED = sorted((Path(__file__).parents[1] / "released").glob("*/*"))


@pytest.mark.parametrize("file", RELEASED, ids=lambda file: f"{file.parent.name} {file.name}")
def test_files_of_released_versions_are_read_for_ever_after(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [] if file.suffix != ".csv" else ["--robot", "z1"]
    assert main(["check", str(file), "--self-collision", "off", *words]) == 0
    assert capsys.readouterr().out.endswith("usable\n")


OLD_RESULTS = sorted((Path(__file__).parents[1] / "released_results").iterdir())


@pytest.mark.parametrize("folder", OLD_RESULTS, ids=lambda folder: folder.name)
def test_results_of_released_versions_are_still_of_use(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder, tmp_path / "out")
    header, records, _ = read_journal(folder / "results.jsonl")
    assert header["suite"] == "released" and records[0]["row"]["status"] == "solved"
    assert main(["bench", "--compare", str(folder), str(folder)]) == 0
    assert main([*MOVE, *ENDS, "--out", str(tmp_path / "out")]) == 2  # its request is read, and kept
    assert "--force" in capsys.readouterr().err


def test_a_later_format_is_refused_with_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind in ("model", "log", "suite", "job"):
        file = tmp_path / ("log.toml" if kind == "log" else f"{kind}.toml")
        file.write_text(f'format = "energy-opt/{kind}/9"\nrobot = "z1"\n')
        assert main(["check", str(file)]) == 2
        said = capsys.readouterr().err
        assert f"energy-opt/{kind}/1" in said and "energy-opt/" + kind + "/9" in said, said
