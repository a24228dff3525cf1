"""Scenes and jobs as Python has them are taken as their files are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import energy_opt as eo
from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene

START = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
GOAL = [0.6, -0.3, 0.2, -1.9, 0, 1.7, 0.785]
SCENE = "objects:\n  - {name: shelf, type: box, size: [0.1, 0.1, 0.1], position: [0.6, 0, 1.2]}\n"
JOB = {
    "format": "energy-opt/job/1", "robot": "panda", "cycle_time": 6.0, "mode": "retime",
    "step": [{"to": GOAL}, {"to": START}],
}  # fmt: skip
JOB_TOML = f"""format = "energy-opt/job/1"
robot = "panda"
cycle_time = 6.0
mode = "retime"
[[step]]
to = {GOAL}
[[step]]
to = {START}
"""


def test_a_scene_is_named_by_its_file_in_the_request(tmp_path: Path):
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE)
    scene = eo.load_scene(file)
    asked = {"start": START, "goal": GOAL, "duration": 2.0, "mode": "retime"}
    for cell in ({"scene": scene}, {"cell": CellRequest(scene=scene)}):
        result = eo.optimize("panda", "source-method-2", **asked, **cell)
        assert result["request"]["scene"] == str(file)
    assert [thing.name for thing in scene_of(CellRequest(scene=scene)).objects] == ["shelf"]
    changed = "scene: differs from its file"
    others = (replace(scene, objects=()), changed), (eo.load_scene(file, floor=-0.3), "scene: has a floor")
    for other, says in (*others, (Scene.from_text(scene.to_text()), "expected the name of a file")):
        with pytest.raises(eo.BadInput, match=says):
            eo.optimize("panda", "source-method-2", **asked, scene=other)
    file.write_text(SCENE.replace("0.6", "0.7"))
    with pytest.raises(eo.BadInput, match=changed):
        eo.evaluate(result, scene=scene)


def test_a_job_may_be_the_first_argument_of_tradeoff(tmp_path: Path):
    file = tmp_path / "job.toml"
    file.write_text(JOB_TOML)
    more = {"durations": [6.0], "self_collision": False}
    named = eo.tradeoff(job=file, model="source-method-2", **more)
    for first in (str(file), JOB):
        assert eo.tradeoff(first, "source-method-2", **more)["points"] == named["points"]


def test_further_arguments_without_a_name_are_refused_in_words():
    with pytest.raises(eo.BadInput, match="optimize: 3 arguments without a name; expected only robot, model"):
        eo.optimize("panda", START, GOAL)  # type: ignore[call-arg]
