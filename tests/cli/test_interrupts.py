"""Ctrl-C at any moment of the verbs that read data: quiet, 130, and what is known by then is written, whole."""

from __future__ import annotations

import importlib
import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from virtual_sets import make_set

from energy_opt.cli import faults
from energy_opt.cli.main import main
from energy_opt.effects import CoulombFriction
from energy_opt.folders import written_whole
from energy_opt.power import load_model

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = make_set(tmp_path_factory.mktemp("set") / "set", "z1", [CoulombFriction(tau_c=0.3)], seed=2)
    made.declared.save(made.folder / "declared.toml")
    return made.folder


@pytest.fixture(autouse=True)
def _as_the_command_does() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, faults.interrupt)
    yield
    signal.signal(signal.SIGINT, before)
    faults._pressed.clear()


def pressed(monkeypatch: pytest.MonkeyPatch, place: str, times: int = 1) -> None:
    """Ctrl-C comes when a function is called for the `times`-th time."""
    module, _, name = place.partition(":")
    owner: Any = importlib.import_module(module)
    *way, name = name.split(".")
    for part in way:
        owner = getattr(owner, part)
    inner: Callable[..., Any] = getattr(owner, name)
    calls = []

    def press(*words: Any, **more: Any) -> Any:
        calls.append(1)
        if len(calls) == times:
            signal.raise_signal(signal.SIGINT)
        return inner(*words, **more)

    monkeypatch.setattr(owner, name, press)


@pytest.mark.parametrize(
    ("place", "times", "known"),
    [
        ("energy_opt.front.diagnose:read_set", 1, False),
        ("energy_opt.diagnosis.diagnosis:take_samples", 1, True),
        ("energy_opt.diagnosis.search.effect_sets:Search.fitted", 1, True),
        ("energy_opt.diagnosis.search.effect_sets:Search.fitted", 2, True),
        ("energy_opt.diagnosis.verdict.inference:left_open", 1, True),
        ("energy_opt.diagnosis.diagnosis:errors", 1, True),
        ("energy_opt.diagnosis.report.page:page", 1, True),
    ],
)
def test_what_a_diagnosis_knows_is_written(
    place: str, times: int, known: bool, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    pressed(monkeypatch, place, times)
    out = tmp_path / "out"
    code = main(["diagnose", str(folder), "--out", str(out), "--quiet"])
    assert code == 130 and capsys.readouterr().err == ("" if known else "energy-opt: interrupted\n")
    assert out.exists() == known
    if not known:
        return
    assert sorted(p.name for p in out.iterdir()) == ["diagnosis.json", "model.toml", "report.html"]
    d = json.loads((out / "diagnosis.json").read_text())
    load_model(out / "model.toml").check(6)
    assert d["interrupted"] == ("page" not in place) and d["error"]["after"]["train"]["power_rmse"] > 0
    if "search" in place or "take_samples" in place:
        assert d["verdict"] is None and not d["effects"] and "before a verdict was reached" in d["headline"]
    else:
        assert d["verdict"] == "explained" and [row["name"] for row in d["effects"]] == ["coulomb_friction"]


@pytest.mark.parametrize("place", ["energy_opt.front.identify:read_set", "energy_opt.front.identify:of_poses"])
def test_identify_ends_quietly(
    place: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    pressed(monkeypatch, place)
    assert main(["identify", str(folder), "--out", str(tmp_path / "out"), "--quiet"]) == 130
    assert capsys.readouterr().err == "energy-opt: interrupted\n" and not (tmp_path / "out").exists()


def test_files_change_place_undisturbed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "last").write_text("old")
    pressed(monkeypatch, "energy_opt.folders:os.replace")
    with pytest.raises(KeyboardInterrupt), written_whole(tmp_path, "last") as aside:
        for name in ("first", "last"):
            (aside / name).write_text("new")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"first": "new", "last": "new"}


def test_sigterm_counts_as_ctrl_c(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys\n"
        "from energy_opt import __main__\n"
        "from energy_opt.motion import Planner\n"
        "solve = Planner.solve\n"
        "def ended(*words, **more):\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    return solve(*words, **more)\n"
        "Planner.solve = ended\n"
        "sys.exit(__main__.command())\n"
    )
    words = "optimize --robot panda --start 0,-0.8,0,-2.4,0,1.6,0.8 --goal 0.3,-0.6,0,-2.2,0,1.8,0.8 --mode retime"
    out = tmp_path / "out"
    run = [sys.executable, "-c", code, *words.split(), "--model", "source-method-2", "--json", "--out", str(out)]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 130, done.stderr
    assert json.loads(done.stdout)["status"] in ("solved", "not_converged") and (out / "trajectory.csv").is_file()
