"""`energy-opt bench` on real moves: the rows, that the number of workers changes none, moves that cannot be done."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from energy_opt.batches.records import COLUMNS, TIMES, read_parquet
from energy_opt.batches.summary import table
from energy_opt.cli.main import main

SUITE = """format = "energy-opt/suite/1"
name = "real"
robots = ["panda"]
modes = ["retime", "reshape"]
durations = ["1.5x"]
models = ["source_method_2"]
settings = { starts = 2, controls = 20 }

[[moves]]
name = "across"
start = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
goal = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]

[[moves]]
name = "too-fast"
start = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
goal = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
durations = ["0.5x"]

[[moves]]
name = "outside"
start = [9, -0.785, 0, -2.356, 0, 1.571, 0.785]
goal = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
"""
PROMISED = (
    *("suite", "robot", "move", "mode", "status", "duration", "energy_total", "energy_standby", "energy_loss"),
    *("saving_total_percent", "saving_loss_percent", "max_violation", "iterations"),
    *("build_seconds", "solve_seconds", "error"),
)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The suite run with one worker and with two, through the command line."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "suite.toml").write_text(SUITE)
    outs = {}
    for jobs in ("1", "2"):
        outs[jobs] = folder / jobs
        words = ["--jobs", jobs, "--out", str(outs[jobs]), "--quiet", "--compile", "never"]
        assert main(["bench", str(folder / "suite.toml"), *words]) == 0
    return outs


@pytest.mark.slow
def test_records_have_the_documented_columns(ran):
    rows = read_parquet(ran["1"] / "results.parquet")
    assert set(PROMISED) <= set(COLUMNS)
    assert [(row["move"], row["mode"]) for row in rows] == [
        (move, mode) for move in ("across", "too-fast", "outside") for mode in ("retime", "reshape")
    ]
    retimed, reshaped = rows[:2]
    for row in (retimed, reshaped):
        assert row["status"] == "solved"
        assert row["error"] is None
        assert row["max_violation"] <= 1e-6
        assert row["duration"] == pytest.approx(1.5 * row["minimum_time"], rel=1e-9)
        parts = row["energy_standby"] + row["energy_stored"] + row["energy_loss"]
        assert row["energy_total"] == pytest.approx(parts, rel=1e-9)
        assert row["saving_loss_percent"] == pytest.approx(
            100 * (1 - row["energy_loss"] / row["loss_scaled"]), rel=1e-6
        )
    assert reshaped["energy_loss"] < retimed["energy_loss"] < retimed["loss_scaled"]


def test_moves_that_cannot_be_done_are_rows_with_reasons(ran):
    rows = read_parquet(ran["1"] / "results.parquet")[2:]
    assert {row["status"] for row in rows} == {"infeasible"}
    assert all("short" in row["error"] for row in rows[:2])
    assert all("panda_joint1" in row["error"] for row in rows[2:])
    summary = json.loads((ran["1"] / "summary.json").read_text())
    assert len(summary["failures"]) == 4
    assert summary["machine"]["versions"]["casadi"]


def test_a_suite_of_moves_that_cannot_be_done_is_infeasible(tmp_path):
    head, *moves = SUITE.split("[[moves]]")
    (tmp_path / "suite.toml").write_text("[[moves]]".join([head, moves[-1]]))
    assert main(["bench", str(tmp_path / "suite.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 3


def test_number_of_workers_changes_no_number(ran):
    one, two = (read_parquet(ran[jobs] / "results.parquet") for jobs in ("1", "2"))
    for a, b in zip(one, two, strict=True):
        assert {k: v for k, v in a.items() if k not in TIMES} == {k: v for k, v in b.items() if k not in TIMES}


def test_the_table_of_savings_has_titles(ran):
    lines = table(json.loads((ran["1"] / "summary.json").read_text()), ran["1"]).splitlines()
    k = next(k for k, line in enumerate(lines) if "median" in line)
    assert "robot mode" in lines[k] and len(lines[k].split()) == len(lines[k + 1].split())


def test_compare_on_the_command_line(ran, capsys):
    assert main(["bench", "--compare", str(ran["1"]), str(ran["2"])]) == 0
    said = capsys.readouterr().out
    assert "6 moves in both" in said
    assert "worse: 0" in said
    assert main(["bench", "--compare", str(ran["1"]), str(ran["2"]), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["worse"] == []


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ([], "no suite"),
        (["none.toml"], "No such file"),
        (["none.toml", "--jobs", "0"], "--jobs 0"),
        (["none.toml", "--compare", "a", "b"], "no suite"),
        (["--compare", "a", "b"], "cannot be read"),
    ],
)
def test_bad_arguments(words, named, capsys):
    assert main(["bench", *words]) == 2
    assert named in capsys.readouterr().err


def test_a_scheduler_that_is_not_there(tmp_path, capsys):
    pytest.importorskip("distributed")
    (tmp_path / "suite.toml").write_text(SUITE)
    words = [str(tmp_path / "suite.toml"), "--scheduler", "nowhere", "--out", str(tmp_path / "out"), "--quiet"]
    assert main(["bench", *words]) == 2
    assert "no Dask scheduler answers" in capsys.readouterr().err


def test_workers_do_not_run_the_users_script_again(tmp_path):
    """A script without `if __name__ == "__main__"` had ended every worker: 0 moves solved."""
    (tmp_path / "suite.toml").write_text(SUITE.split("[[moves]]")[0] + "[[moves]]" + SUITE.split("[[moves]]")[3])
    script = tmp_path / "script.py"
    script.write_text(
        "import energy_opt as eo\nprint('once')\nbatch = eo.bench('suite.toml', jobs=1, out='out')\n"
        "print({row['status'] for row in batch.records})\n"
    )
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout.splitlines(), done.stderr) == (["once", "{'infeasible'}"], "")


def test_a_model_of_another_arm_is_named(tmp_path, capsys):
    """Its values were used without a word; optimize warns."""
    head, _, moves = SUITE.partition("[[moves]]")
    (tmp_path / "suite.toml").write_text(
        head.replace('"source_method_2"', '"mine.toml"') + moves[moves.rindex("[[moves]]") :]
    )
    (tmp_path / "mine.toml").write_text(
        'format = "energy-opt/model/1"\nrobot = "z1"\n[[effect]]\nname = "standby"\npower = 9.0\n'
    )
    words = ["bench", str(tmp_path / "suite.toml"), "--jobs", "1", "--out", str(tmp_path / "out")]
    main(words)
    said = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    assert said == ["warning: mine.toml: a model of z1, used for panda"]
