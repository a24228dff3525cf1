"""Any value of any option of any verb: exit 0, 2, 3 or 4 and one line, never a fault that nobody foresaw."""

from __future__ import annotations

import argparse
import random
import time
from pathlib import Path

import numpy as np
import pytest
from machine import allowed

from energy_opt.cli import faults
from energy_opt.cli.main import main, parsers

VALUES = [
    "", " ", "nan", "inf", "-inf", "1e300", "-1", "1e-300", "0", "9" * 400, "9" * 5000, "\0", "a\0b", "a" * 5000, "é",
    "\ud800", "1,2", "x=1", "../x", "/dev/full", "/", "[]", "-", "--", "on", "1:2:3", "5e-324", "1e400", "1_0", "١",
    "nan,nan,nan,nan,nan,nan", "1e300,0,0,0,0,0", "1,1e300,0,0", "0.5,nan,0,0", "joint1=nan", "flange,1e300,0,0",
    "upright:nan", "upright:1e300", "line:0", "nanrad", "1e300m", "0rad", "1:nan:2", "1:2:99999999",
]  # fmt: skip
ENDS = ["--start", "0,1,-1,0,0,0", "--goal", "0.000001,1,-1,0,0,0"]
MOVE = ["--robot", "z1", *ENDS, "--mode", "retime", "--model", "source-method-2", "--compile", "never"]
VERBS = {
    "optimize": MOVE, "tradeoff": [*MOVE, "--durations", "1:2:2"], "bench": ["suite.toml", "--jobs", "1"],
    "job": ["job.toml", "--compile", "never"], "identify": ["set"], "diagnose": ["set"],
    "import": ["run.csv", "--out", "made"],
    "simulate": ["run.csv", "--plant", "model.toml"], "check": ["run.csv", "--robot", "z1"], "robots": [],
    "effects": [],
}  # fmt: skip
PARTS = 8
UNASKED = {"--help", "--view", "--scheduler"}  # the last waits for a cluster
STEP = '[[step]]\nname = "a"\nto = [0.000001, 1, -1, 0, 0, 0]\nmode = "retime"\n'
FILES = {
    "model.toml": 'format = "energy-opt/model/1"\nrobot = "z1"\n[[effect]]\nname = "standby"\npower = 30.0\n',
    "job.toml": f'format = "energy-opt/job/1"\nrobot = "z1"\ncycle_time = 3.0\nhome = [0, 1, -1, 0, 0, 0]\n{STEP}',
    "suite.toml": 'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["z1"]\nmodes = ["retime"]\ndurations = [1.0]\n'
    'models = ["source_method_2"]\n[[moves]]\nname = "m"\nstart = [9, 1, -1, 0, 0, 0]\ngoal = [0, 1, -1, 0, 0, 0]\n',
    "set/log.toml": 'format = "energy-opt/log/1"\nrobot = "z1"\n'
    + "".join(f'[[run]]\nfile = "run{k}.csv"\nkind = "static"\n' for k in range(4)),
}


def _cases() -> list[tuple[str, argparse.Action, str | None]]:
    """All verbs' options with all values."""
    out: list[tuple[str, argparse.Action, str | None]] = []
    for verb in VERBS:
        for action in parsers([verb])[1][verb]._actions:
            if action.option_strings and not {*action.option_strings} & UNASKED:
                out += [(verb, action, value) for value in (VALUES if action.nargs != 0 else [None])]
    return out


def _tried(case: tuple[str, argparse.Action, str | None], capsys: pytest.CaptureFixture[str]) -> None:
    verb, action, value = case
    option, words = action.option_strings[0], [verb, *VERBS[verb]]
    if option in words:
        del words[words.index(option) : words.index(option) + 2]
    words += [option] if value is None else [option, value, value] if action.nargs == 2 else [f"{option}={value}"]
    if verb not in ("robots", "effects", "check") and option != "--force":
        words.append("--force")  # over what the case before has left
    begin = time.process_time()
    code = main(words)
    said = capsys.readouterr().err
    assert code in (0, 2, 3, 4), (words, said)
    faults_said = [line for line in said.splitlines() if line.startswith("energy-opt: ")]
    assert "Traceback" not in said and (code != 2 or len(faults_said) == 1), (words, said)
    assert code != 2 or len(faults_said[0]) < 1700, words
    assert time.process_time() - begin < allowed(30), words


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with what the verbs read, and the last net torn."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set").mkdir()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    header = ",".join(["time", *(f"joint{k}.position" for k in range(1, 7)), "power"])
    rows = [f"{t / 10},{0.1 * np.sin(t / 10)},1,-1,0,0,0,{30 + t % 3}" for t in range(40)]
    (tmp_path / "run.csv").write_text("\n".join([header, *rows]))
    for k in range(4):
        still = [f"{t / 10},0,{0.3 + 0.3 * k},{-0.4 - 0.2 * k},0,0,0,{30 + k}" for t in range(20)]
        (tmp_path / f"set/run{k}.csv").write_text("\n".join([header, *still]))
    foreseen = faults.as_error

    def as_error(error: Exception) -> Exception:
        found = foreseen(error)
        if isinstance(found, faults.Unforeseen):
            raise AssertionError("unforeseen") from error
        return found

    monkeypatch.setattr("energy_opt.cli.main.as_error", as_error)


def test_a_sample_of_options(capsys: pytest.CaptureFixture[str]) -> None:
    for case in random.Random(1).sample(_cases(), 25):
        _tried(case, capsys)


@pytest.mark.nightly
@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("part", range(PARTS))
def test_all_options_all_night(verb: str, part: int, capsys: pytest.CaptureFixture[str]) -> None:
    """All values of a verb's options, every `PARTS`-th; all that fail are listed."""
    fell = []
    for case in [case for case in _cases() if case[0] == verb][part::PARTS]:
        try:
            _tried(case, capsys)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            fell.append(f"{verb} {case[1].option_strings[0]}={case[2]!r:.60}: {type(error).__name__}: {error!s:.600}")
    assert not fell, "\n".join(fell)
