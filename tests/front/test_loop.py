"""The loop closed: what is diagnosed on a virtual arm makes the next plan really cheaper."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from energy_opt.motion import Settings

pytest.importorskip("mujoco")

SETTINGS = Settings(end_acceleration="zero", compile="never")  # nothing left behind in the background
RUNS = 5, 3  # motions and poses, enough to tell what an arm with exact links has
SCRIPT = Path(__file__).parents[2] / "benchmarks" / "loop.py"


@pytest.fixture(scope="module")
def loop() -> ModuleType:
    """The benchmark as a module."""
    spec = importlib.util.spec_from_file_location("benchmark_loop", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("effect", "least"),
    [  # least gain, % of what the first plan used
        ("payload", 0.5),
        pytest.param("coulomb_friction", 0.5, marks=pytest.mark.slow),
        pytest.param("regeneration", 0.5, marks=pytest.mark.slow),
        pytest.param("viscous_friction", 0.5, marks=pytest.mark.slow),
        pytest.param("gear_efficiency", 0.0, marks=pytest.mark.slow),
        pytest.param("gravity_spring", 0.0, marks=pytest.mark.slow),
        pytest.param("armature", 0.0, marks=pytest.mark.slow),
    ],
)
def test_the_second_plan_uses_less_and_its_energy_is_foreseen(loop: ModuleType, effect: str, least: float) -> None:
    for turn in loop.turn(loop.undeclared(effect, 0), loop.CASES[effect], seed=0, settings=SETTINGS, runs=RUNS):
        assert turn.found, turn.verdict
        assert turn.error_after < 0.5 and turn.error_after < 0.5 * turn.error_before
        assert turn.second.calibrated <= turn.first.calibrated + 1e-9  # never worse under the new model
        assert turn.gain > least / 100 * turn.first.used


def test_nothing_missing_leaves_the_plan_as_it_was(loop: ModuleType) -> None:
    """An arm that is as declared: the loop must not make things worse."""
    from virtual_sets import base_model

    from energy_opt.effects import CopperLoss

    same = base_model("z1").get("copper_loss")
    assert isinstance(same, CopperLoss)
    (turn,) = loop.turn(same, "z1", seed=2, settings=SETTINGS, runs=RUNS)
    assert turn.error_before < 0.3 and turn.error_after < 0.5
    assert turn.gain > -0.002 * turn.first.used
