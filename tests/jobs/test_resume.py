"""What an earlier run into a folder has solved is not solved again."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from job_texts import RETIMED, written

from energy_opt.cli.main import main
from energy_opt.jobs.file import load_job
from energy_opt.jobs.solve_job import run_job
from energy_opt.jobs.work import Answers
from energy_opt.motion import Settings
from energy_opt.motion.plan.neighbour import Neighbours
from energy_opt.power import source_method_2
from energy_opt.robot import Robot

SHUTTLE = """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 2.0
home = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
[[step]]
to = [0.9, 0.35, 0.2, -1.9, 0.0, 2.2, 0.9]
[[step]]
to = "home"
"""


@pytest.mark.slow
def test_a_killed_job_is_continued_with_the_same_result(panda: Robot, tmp_path: Path) -> None:
    path, whole, killed = written(tmp_path, RETIMED), tmp_path / "whole", tmp_path / "killed"
    assert main(["job", str(path), "--out", str(whole), "--quiet"]) == 0
    words = [sys.executable, "-m", "energy_opt", "job", str(path), "--out", str(killed), "--quiet"]
    process = subprocess.Popen(words)
    for _ in range(600):
        if list((killed / ".answers").glob("*.csv")) or process.poll() is not None:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert main([*words[3:], "--resume"]) == 0
    first, second = (json.loads((out / "job.json").read_text()) for out in (whole, killed))
    assert second["energy_total"] == pytest.approx(first["energy_total"], rel=1e-9)
    assert not (killed / ".answers").exists()


def test_what_was_solved_is_not_solved_again(panda: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches at other durations were not kept, and after the moves that were, they began anew: it took longer."""
    job, settings = load_job(written(tmp_path, SHUTTLE), lambda _: panda), Settings(starts=1, controls=16)

    def energy(resume: bool) -> float:
        return run_job(job, source_method_2(), settings, answers=Answers(tmp_path, panda.joints, "", resume)).energy

    first, kept = energy(False), sorted((tmp_path / ".answers").iterdir())
    assert len(kept) > 2
    kept[0].unlink()
    written_again: list[Any] = []
    keep = Answers.keep
    monkeypatch.setattr(Answers, "keep", lambda *words: written_again.append(words[2]) or keep(*words))
    assert energy(True) == pytest.approx(first, rel=1e-3) and 0 < len(written_again) < len(kept)
    monkeypatch.setattr(Neighbours, "near", lambda *_: pytest.fail("solved again"))
    assert energy(True) == pytest.approx(first, rel=1e-3)


def test_a_move_whose_search_was_stopped_is_searched_again(panda: Robot, tmp_path: Path) -> None:
    job, asked = load_job(written(tmp_path, SHUTTLE), lambda _: panda), [0]

    def progress(text: str, _: float) -> None:
        asked[0] += text.startswith("2/2")

    def stopped() -> bool:  # within the search for the second move
        asked[0] += bool(asked[0])
        return asked[0] > 2

    settings, kept = Settings(starts=1, controls=16), Answers(tmp_path, panda.joints, "", resume=False)
    found = run_job(job, source_method_2(), settings, stopped=stopped, progress=progress, answers=kept)
    assert [piece.status for piece in found.pieces] == ["solved", "not_converged"]
    # it was kept as an answer, so `--resume` took the first guess for the solved move
    assert len(list((tmp_path / ".answers").iterdir())) == 1


def test_a_move_whose_search_was_stopped_after_its_first_start_is_searched_again(
    panda: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best of fewer starts may be converged, too."""
    job, inner, ended = load_job(written(tmp_path, SHUTTLE), lambda _: panda), Neighbours.single_move, [0]

    def solved(*words: Any) -> Any:
        found = inner(*words)
        ended[0] += 1
        return found

    monkeypatch.setattr(Neighbours, "single_move", solved)
    settings, kept = Settings(starts=1, controls=16), Answers(tmp_path, panda.joints, "", resume=False)
    run_job(job, source_method_2(), settings, stopped=lambda: ended[0] > 1, answers=kept)
    assert len(list((tmp_path / ".answers").iterdir())) == 1
