"""What the documentation shows of limits and formats of one's own works as it stands there."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.formats import FORMATS
from energy_opt.motion.plan import planner as planner_module

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
START, GOAL = [0, -0.785, 0, -2.356, 0, 1.571, 0.785], [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]


def example(name):
    """A file of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_limit_of_ones_own_is_kept_and_judged(panda, monkeypatch):
    settings = {"starts": 1, "controls": 16, "compile": "never"}
    ends = {"start": START, "goal": GOAL, "duration": 2.5}
    free = eo.optimize(panda, **ends, **settings)
    used = np.abs(free.trajectory.effort * free.trajectory.velocity).max(axis=0)
    bound = np.maximum(0.8 * used, 1.0)
    limits_of = planner_module.limits_of
    own = example("my_limit").DrivePower(bound)
    monkeypatch.setattr(planner_module, "limits_of", lambda *a: (*limits_of(*a), own))
    held = eo.optimize(panda, **ends, **settings)
    assert held.certificate.max_violation["drive_power"] <= 1e-6 and held.status == "solved"
    power = np.abs(held.trajectory.effort * held.trajectory.velocity)
    assert (power <= bound * (1 + 1e-5)).all() and (used > bound).any()
    with pytest.raises(eo.BadInput, match="drive_power says nothing of a timing"):
        eo.optimize(panda, **ends, **{**settings, "mode": "retime"})


def test_a_format_of_ones_own_is_read_and_written(panda, tmp_path):
    example("my_format")
    try:
        path = tmp_path / "way.joints"
        path.write_text(" ".join(reversed(panda.joints)) + "\n" + "\n".join(
            " ".join(map(str, reversed(q))) for q in (START, GOAL)
        ))  # fmt: skip
        out = tmp_path / "out"
        assert main(["optimize", "--robot", "panda", "--path", str(path), "--mode", "retime", "--duration", "2",
                     "--out", str(out), "--quiet"]) == 0  # fmt: skip
        result = eo.optimize("panda", path=path, mode="retime", duration=2.0)
        np.testing.assert_allclose(result.trajectory.position[[0, -1]], [START, GOAL], atol=1e-9)
        FORMATS["text"].write(result.trajectory, tmp_path / "again.joints")
        again = FORMATS["text"].read(tmp_path / "again.joints").of(panda.joints)
        np.testing.assert_allclose(again.position, result.trajectory.position, atol=1e-8)
    finally:
        del FORMATS["text"]
