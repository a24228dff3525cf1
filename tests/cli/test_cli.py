"""The command line as a user meets it: files, exit codes, one line for every fault."""

import json
import os
import shlex
import subprocess
import sys

import numpy as np
import pytest
import yaml

from energy_opt.cli.faults import as_error
from energy_opt.cli.main import VERBS, main, parsers
from energy_opt.cli.options import UNITS, usage_of
from energy_opt.robot import load_robot
from energy_opt.tables import read_table

START, GOAL = "0,-0.785,0,-2.356,0,1.571,0.785", "1.2,0.3,0.4,-1.2,-0.5,2.2,-0.4"
QUICK = ["--starts", "1", "--controls", "16", "--compile", "never", "--model", "source-method-2"]


def test_optimize_writes_what_the_contract_lists(tmp_path, capsys):
    out = tmp_path / "out"
    words = ["optimize", "--robot", "panda", "--start", START, "--goal", GOAL, "--duration", "2", "--out", str(out)]
    assert main([*words, "--json", *QUICK]) == 0
    printed = json.loads(capsys.readouterr().out)
    stored = json.loads((out / "result.json").read_text())
    assert printed == stored
    assert stored["status"] == "solved" and stored["mode"] == "reshape" and stored["duration"] == 2.0
    assert stored["joints"] == list(load_robot("panda").joints)
    assert set(stored["energy"]) >= {"total", "standby", "stored", "loss", "by_effect"}
    assert {b["name"] for b in stored["baselines"]} == {"toppra", "scaled"}
    assert set(stored["saving"]) == {"total_percent", "loss_percent", "joules"}
    kinds = {"position", "velocity", "acceleration", "jerk", "effort"}
    assert set(stored["certificate"]["max_violation"]) == kinds
    assert set(stored["certificate"]["worst"]) == {"limit", "joint", "time", "value", "bound"}
    assert set(stored["optimality"]) == {"kind", "lower_bound", "gap_percent"}
    assert set(stored["solver"]) >= {"name", "iterations", "build_seconds", "solve_seconds"}
    table = read_table(out / "trajectory.csv")
    for joint in stored["joints"]:
        for kind in ("position", "velocity", "acceleration", "effort"):
            assert f"{joint}.{kind}" in table
    energy = np.sum((table["power"][1:] + table["power"][:-1]) / 2 * np.diff(table["time"]))
    assert energy == pytest.approx(stored["energy"]["total"], rel=1e-4)
    message = yaml.safe_load((out / "trajectory.yaml").read_text())
    assert message["joint_names"] == stored["joints"]
    assert len(message["points"]) == len(table["time"])
    assert message["points"][-1]["time_from_start"] == {"sec": 2, "nanosec": 0}
    assert (out / "plot.png").read_bytes()[:4] == b"\x89PNG"
    assert "<html" in (out / "report.html").read_text()
    assert not [file for file in out.iterdir() if file.name.startswith(".")]
    assert main(["check", str(out / "trajectory.csv"), "--robot", "panda", "--quiet"]) == 0
    # the trajectory as input of the next move
    again = tmp_path / "again"
    assert main(["optimize", "--robot", "panda", "--path", str(out / "trajectory.csv"), "--mode", "retime",
                 "--duration", "2", "--out", str(again), "--quiet", *QUICK]) == 0  # fmt: skip
    second = json.loads((again / "result.json").read_text())
    assert {b["name"] for b in second["baselines"]} == {"toppra", "scaled", "input"}
    assert second["energy"]["total"] <= stored["energy"]["total"] + 1e-6


def test_names_may_come_in_any_order(tmp_path):
    joints = load_robot("panda").joints
    pairs = ",".join(f"{joint}={value}" for joint, value in reversed(list(zip(joints, GOAL.split(","), strict=True))))
    words = ["optimize", "--robot", "panda", "--start", START, "--goal", pairs, "--mode", "retime", "--quiet", *QUICK]
    assert main([*words, "--out", str(tmp_path)]) == 0
    table = read_table(tmp_path / "trajectory.csv")
    assert table["panda_joint4.position"][-1] == pytest.approx(-1.2)


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["--start", START, "--goal", "1,2,3"], 2, "3 positions; the robot has 7"),
        (["--start", START, "--goal", "1,2,3,a,5,6,7"], 2, "'a' is not a number"),
        (["--start", START, "--goal", "elbow=1"], 2, "unknown joint 'elbow'"),
        (["--start", START], 2, "--goal is missing"),
        (["--start", START, "--goal", GOAL, "--duration", "-1"], 2, "--duration -1"),
        (["--start", START, "--goal", GOAL, "--duration", "soon"], 2, "--duration"),
        (["--start", START, "--goal", GOAL, "--duration", "1", "--max-duration", "2"], 2, "give one"),
        (["--start", START, "--goal", GOAL, "--mode", "warp"], 2, "retime or reshape"),
        (["--start", START, "--goal", GOAL, "--payload", "1,2"], 2, "MASS,CX,CY,CZ"),
        (["--start", START, "--goal", GOAL, "--model", "nowhere.toml"], 2, "nowhere.toml"),
        (["--start", START, "--goal", GOAL, "--limits", "nowhere.yaml"], 2, "nowhere.yaml"),
        (["--start", START, "--goal", GOAL, "--objective", "torque"], 2, "--duration"),
        (["--start", START, "--goal", "9" + GOAL[3:]], 3, "panda_joint1"),
        (["--start", START, "--goal", GOAL, "--mode", "retime", "--duration", "0.2"], 3, "short"),
    ],
)
def test_faults_are_one_line(words, code, text, tmp_path, capsys):
    assert main(["optimize", "--robot", "panda", *QUICK, *words, "--out", str(tmp_path)]) == code
    error = capsys.readouterr().err.strip()
    assert text in error and len(error.splitlines()) == 1
    if code == 3:
        assert json.loads((tmp_path / "result.json").read_text())["status"] == "infeasible"


def test_unknown_robot_and_verb(capsys):
    assert main(["optimize", "--robot", "panda9", "--start", "0", "--goal", "1"]) == 2
    assert "panda9" in capsys.readouterr().err
    assert main(["fly"]) == 2
    assert main([]) == 2


def test_robots(capsys):
    assert main(["robots", "--json", "--quiet"]) == 0
    rows = json.loads(capsys.readouterr().out)["robots"]
    assert {row["name"] for row in rows} >= {"panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1", "ur3e", "ur5e"}
    assert main(["robots", "panda"]) == 0
    assert "panda_joint7" in capsys.readouterr().out


def test_quiet_leaves_what_was_asked_for(capsys):
    assert main(["robots", "panda", "--quiet"]) == 0
    assert "panda_joint7" in capsys.readouterr().out
    assert main(["effects", "standby", "--quiet"]) == 0
    assert "power" in capsys.readouterr().out


def test_check_names_the_fault(tmp_path, capsys):
    model = tmp_path / "model.toml"
    model.write_text('format = "energy-opt/model/1"\nrobot = "panda"\n[[effect]]\nname = "standbye"\npower = 1\n')
    assert main(["check", str(model)]) == 2
    assert "standbye" in capsys.readouterr().err
    table = tmp_path / "move.csv"
    joints = load_robot("panda").joints
    header = ",".join(["time", *(f"{joint}.position" for joint in joints)])
    table.write_text(f"{header}\n0,{START}\n1,{GOAL.replace('1.2', 'x', 1)}\n")
    assert main(["check", str(table), "--robot", "panda"]) == 2
    assert "row 3, column panda_joint1.position" in capsys.readouterr().err


@pytest.mark.parametrize("verb", VERBS)
def test_help_ends_with_examples_that_parse(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    said = " ".join(capsys.readouterr().out.split())
    commands, read, written = usage_of(verb)
    assert "example" in said and f"reads: {read}" in said and f"writes: {written}" in said and UNITS in said
    for command in commands:
        assert command in said  # unbroken, to be copied
        words = shlex.split(command.partition(" > ")[0])[1:]
        if words[0] in VERBS:
            _, unknown = parsers(words)[0].parse_known_args(words)
            assert not unknown


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["optimise"], "optimize"),
        (["optimize", "--robot", "pnda"], "panda"),
        (["robots", "pnda"], "panda"),
        (["effects", "coulomb_frction"], "coulomb_friction"),
        (["optimize", "--robot", "panda", "--start", "panda_jont1=0", "--goal", GOAL], "panda_joint1"),
        (["optimize", "--robot", "panda", "--lock", "panda_jont1=0", "--start", START, "--goal", GOAL], "panda_joint1"),
        (["optimize", "--robot", "panda", "--gaol", GOAL], "--goal"),
        (["optimize", "--robot", "panda", "--start", START, "--goal", GOAL, "--write", "urscrpt"], "urscript"),
        (["optimize", "--robot", "panda", "--start", START, "--goal", GOAL, "--model", "carefull"], "careful"),
    ],
)
def test_similar_names_are_proposed_also_in_json(words, hint, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--json"]) == 2
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert document["status"] == "bad_input" and f"{hint!r}" in document["message"].replace('"', "'")
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("verb", VERBS)
def test_json_is_one_document_also_where_a_verb_fails(verb, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    required = {"optimize": ["--robot", "panda"], "tradeoff": ["--robot", "panda"], "import": ["--out", "set"],
                "simulate": ["--plant", "x.toml"]}  # fmt: skip
    assert main([verb, *required.get(verb, []), *([] if verb in required and verb[0] in "ot" else ["nowhere"]),
                 "--json"]) == 2  # fmt: skip
    out, _ = capsys.readouterr()
    document = json.loads(out)
    assert document["status"] == "bad_input" and document["message"]
    assert main([verb, "--nonsense", "--json"]) == 2  # arguments that are not even read
    assert json.loads(capsys.readouterr().out)["status"] == "bad_input"


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_verbs_and_options(shell, capsys):
    assert main(["--print-completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(verb in script for verb in VERBS) and "max-duration" in script


def test_suggested_poses_are_not_overwritten_by_others(tmp_path, capsys):
    words = ["identify", "--robot", "ur5", "--self-collision", "off", "--out", str(tmp_path), "--suggest"]
    assert main([*words, "3"]) == 0 and main([*words, "3"]) == 0  # the same again
    assert main([*words, "4"]) == 2
    assert "other poses" in capsys.readouterr().err
    assert main([*words, "4", "--force"]) == 0 and len(read_table(tmp_path / "suggested_poses.csv")) == 7


@pytest.mark.parametrize(
    ("words", "code"),
    [("effects --json >&-", 2), ("effects --json >/dev/full", 2), ("--version >/dev/full", 0),
     ("optimize --robot none --start 0 --goal 0 --json >/dev/full", 2), ("effects --json >/dev/null 2>&-", 0),
     ("robots >/dev/null 2>/dev/full", 0)],
)  # fmt: skip
def test_a_full_standard_output_gives_one_line_and_a_full_standard_error_none(words: str, code: int) -> None:
    done = subprocess.run(f"exec {sys.executable} -m energy_opt {words}", shell=True, capture_output=True, text=True)
    assert done.returncode == code and len(done.stderr.splitlines()) == (code != 0), done.stderr
    assert "fault of the program" not in done.stderr


def test_a_library_that_cannot_be_imported_is_reported_as_such() -> None:
    said = str(as_error(ImportError("cannot import name 'x' from 'pinocchio'")))
    assert said.startswith("a library cannot be imported: cannot import name 'x'") and "values" not in said


def test_a_plotting_backend_that_is_not_installed_is_not_used(tmp_path) -> None:
    words = ["-m", "energy_opt", "optimize", "--robot", "ur5", "--start", "0,-1.5,1.2,-1,0.3,0", "--goal",
             "0.5,-0.9,0.7,-1,0.3,0", "--duration", "2", "--mode", "retime", *QUICK, "--out", str(tmp_path / "o"),
             ]  # fmt: skip
    done = subprocess.run([sys.executable, *words], env={**os.environ, "MPLBACKEND": "nonsense"}, capture_output=True)
    assert done.returncode == 0 and (tmp_path / "o" / "plot.png").is_file(), done.stderr
