"""What one verb takes from Python, its sister verbs take, too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo


def test_trajectories_and_plants_in_memory_play_as_their_files_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    robot = eo.load_robot("panda")
    plant = eo.source_model(robot) + eo.effects.CoulombFriction(tau_c=0.6)
    start = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
    result = eo.optimize(robot, plant, start=start, goal=start + 0.1, duration=1.0, mode="retime", self_collision=False)
    result.save("out")
    plant.save("plant.toml")
    eo.simulate("out/trajectory.csv", "plant.toml", "files")
    for given in (result.trajectory, [result]):
        eo.simulate(given, plant, "objects")  # the second time, the same request
        assert Path("objects/run01.csv").read_bytes() == Path("files/run01.csv").read_bytes()
    with pytest.raises(eo.BadInput, match="another request"):
        eo.simulate(result.baseline("scaled").trajectory, plant, "objects")
    for given, of in ((3, plant), (result, 3)):
        with pytest.raises(eo.BadInput, match="3: expected"):
            eo.simulate(given, of, "other")
