"""SIGKILL at any moment, two runs into one folder, a disk that is full: nothing half written, and it goes on."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from virtual_sets import make_set

from energy_opt.batches.records import TIMES, read_journal, read_parquet
from energy_opt.effects import CoulombFriction
from energy_opt.files import read_json, read_toml
from energy_opt.tables import read_table

pytest.importorskip("mujoco")
COMMAND = [sys.executable, "-m", "energy_opt"]
LAST = {"bench": "summary.json", "job": "job.json", "diagnose": "diagnosis.json"}
SUITE = (
    'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["z1"]\nmodes = ["retime"]\nmodels = ["source_method_2"]\n'
    'durations = ["1.5x"]\nrandom = { count = 8, seed = 3 }\n'
)
JOB = (
    'format = "energy-opt/job/1"\nrobot = "z1"\ncycle_time = 6.0\nhome = [0, 1, -1, 0, 0, 0]\n'
    '[[step]]\nname = "there"\nto = [0.8, 1.3, -1.2, 0.2, 0.3, 0.4]\nmode = "retime"\n'
    '[[step]]\nwait = 0.5\n[[step]]\nname = "back"\nto = "home"\nmode = "retime"\n'
)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a suite, a job and a measured set."""
    folder = tmp_path_factory.mktemp("given")
    (folder / "suite.toml").write_text(SUITE)
    (folder / "job.toml").write_text(JOB)
    made = make_set(folder / "set", "z1", [CoulombFriction(tau_c=0.3)], seed=2, motions=3, poses=2)
    made.declared.save(made.folder / "declared.toml")
    return folder


def words(verb: str, given: Path, out: Path) -> list[str]:
    what = {"bench": ["suite.toml", "--jobs", "2", "--resume", "--compile", "never"],
            "job": ["job.toml", "--resume", "--compile", "never", "--model", "source-method-2"],
            "diagnose": ["set"]}[verb]  # fmt: skip
    return [*COMMAND, verb, str(given / what[0]), *what[1:], "--out", str(out), "--quiet"]


def whole(folder: Path, verb: str) -> bool:
    """Reads every file that a user sees, and fails where one is half written; is the result there?"""
    seen = [p for p in folder.rglob("*") if p.is_file() and not any(x.startswith(".") for x in p.parts)]
    for file in seen:
        if file.suffix == ".json":
            read_json(file)
        elif file.suffix == ".csv":
            read_table(file)
        elif file.suffix == ".toml":
            read_toml(file)
        elif file.suffix == ".parquet":
            read_parquet(file)
        elif file.suffix == ".jsonl":
            read_journal(file)
        elif file.suffix == ".html":
            assert file.read_text(encoding="utf-8").rstrip().endswith("</html>"), file
    return folder / LAST[verb] in seen


def answer(verb: str, folder: Path) -> object:
    """What must not depend on how often it was killed."""
    if verb == "bench":
        return [{k: v for k, v in row.items() if k not in TIMES} for row in read_parquet(folder / "results.parquet")]
    names = {"job": ("cycle.csv", "step_01.csv"), "diagnose": ("model.toml",)}[verb]
    return [(folder / name).read_bytes() for name in names]


def hammered(verb: str, given: Path, folder: Path, kills: int) -> None:
    """Kill a verb at random moments of its life, look at what it leaves each time, and let it end at last."""
    begin = time.monotonic()
    subprocess.run(words(verb, given, folder / "calm"), check=True, timeout=300)
    lasts, out, moments = time.monotonic() - begin, folder / "killed", random.Random(kills)
    for _ in range(kills):
        process = subprocess.Popen(words(verb, given, out), start_new_session=True)
        time.sleep(moments.uniform(0.1, 1.0) * lasts)
        process.kill()
        process.wait()
        whole(out, verb)
    run = subprocess.run(words(verb, given, out), capture_output=True, text=True, timeout=300)
    assert run.returncode == 0 and not run.stderr, run.stderr
    assert whole(out, verb) and answer(verb, out) == answer(verb, folder / "calm")
    assert not [p.name for p in out.iterdir() if p.name.startswith(".")]


@pytest.mark.slow
@pytest.mark.parametrize("verb", LAST)
def test_kills(verb: str, given: Path, tmp_path: Path) -> None:
    hammered(verb, given, tmp_path, 3)


@pytest.mark.nightly
@pytest.mark.parametrize("verb", LAST)
def test_kills_all_night(verb: str, given: Path, tmp_path: Path) -> None:
    """Some fifty in all."""
    hammered(verb, given, tmp_path, 17)


@pytest.mark.slow
@pytest.mark.parametrize("verb", LAST)
def test_two_runs_into_one_folder(verb: str, given: Path, tmp_path: Path) -> None:
    """Both say the same, or one reports that the other is at work."""
    both = [subprocess.Popen(words(verb, given, tmp_path / "out"), stderr=subprocess.PIPE, text=True) for _ in "ab"]
    said = [process.communicate(timeout=300)[1] for process in both]
    codes = sorted(process.returncode for process in both)
    assert codes in ([0, 0], [0, 2]) and codes[0] == 0 and sum(len(x.splitlines()) for x in said) == codes[1] // 2, said
    assert whole(tmp_path / "out", verb)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 300 kB, where the machine lets us mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(place)]).returncode:
        pytest.skip("no right to mount")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("verb", LAST)
def test_a_full_disk(verb: str, given: Path, small_disk: Path) -> None:
    """One line and exit 2 where the result does not fit; an old one stays as it was, or is gone whole."""
    (small_disk / "ballast").write_bytes(bytes(280_000))
    out = small_disk / "out"
    run = subprocess.run(words(verb, given, out), capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and len(run.stderr.splitlines()) == 1 and not run.stdout, run.stderr
    assert "Traceback" not in run.stderr and ("full" in run.stderr or "No space" in run.stderr), run.stderr
    assert not out.exists() or not whole(out, verb)


def test_a_dead_run_s_folder_is_swept(tmp_path: Path) -> None:
    from energy_opt.folders import written_whole

    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for name in (f".writing-{dead.pid}-x", f".writing-{os.getpid()}-y"):
        (tmp_path / name).mkdir()
    with written_whole(tmp_path, "last.json") as aside:
        (aside / "last.json").write_text(json.dumps({}))
    assert sorted(p.name for p in tmp_path.iterdir()) == [f".writing-{os.getpid()}-y", "last.json"]
