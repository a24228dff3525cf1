"""The job in the folder `job` of a placement states the request that gives it again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from plane_arm import HEIGHT, arm

from energy_opt.cli.main import main

JOB = """
format = "energy-opt/job/1"
robot = "arm.urdf"
cycle_time = 4.0
mode = "retime"
home = [0.3, -0.6]
[poses]
part = { pose = [0.6, 0, 0.5, 0, 0, 0], free = ["ry:-90:90"] }
[[step]]
to = "part"
payload = 0.5
[[step]]
to = "home"
payload = 0.0
"""


def test_the_job_at_the_answer_is_one_of_the_base_that_was_found(tmp_path: Path) -> None:
    """It stated the given base, and `run` repeated the whole search."""
    arm(tmp_path, 2)
    (tmp_path / "job.toml").write_text(JOB)
    out, again = tmp_path / "out", tmp_path / "again"
    words = ["--model", "source-method-2", "--tool", "tip", "--self-collision", "off", "--starts", "1", "--quiet"]
    counts = ["--base", "0.02,0,0,0,0,0", "--looked-at", "1", "--seeds", "1", "--steps", "0"]
    box = "--base-box=0.05,0.1,0,0,-0.05,0"
    assert main(["place", str(tmp_path / "job.toml"), box, *counts, *words, "--out", str(out)]) == 0
    placed, job = (json.loads((out / name).read_text()) for name in ("place.json", "job/job.json"))
    assert placed["request"]["verb"] == "place" and placed["request"]["base"][0] == 0.02
    assert job["request"]["verb"] == "job" and job["request"]["base"] == placed["base"]
    assert main(["run", str(out / "job" / "job.json"), "--quiet", "--out", str(again)]) == 0
    found = json.loads((again / "job.json").read_text())
    assert found["energy_total"] == pytest.approx(job["energy_total"], rel=0.01)
    for document in (job, found):  # the pose stays where it was in the scene, as seen from the given base
        angles = np.cumsum(document["poses"][0]["goal"])
        at = np.array([0.4, 0.4]) @ np.column_stack([np.cos(angles), -np.sin(angles)])
        assert at + [placed["base"][0], HEIGHT + placed["base"][2]] == pytest.approx([0.62, HEIGHT], abs=1e-5)
