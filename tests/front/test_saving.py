"""`save` replaces what an earlier result of the same verb wrote, and nothing else."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.front.identify import Suggested

START, GOAL = [0, 1, -1, 0, 0, 0], [0.3, 1, -1, 0, 0, 0]
ASKED: dict[str, Any] = {"start": START, "mode": "retime", "self_collision": False}


@pytest.fixture(scope="module")
def moved() -> Any:
    return eo.optimize("z1", "source-method-2", goal=GOAL, duration=2.0, **ASKED)


@pytest.fixture(scope="module")
def saved(moved: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a move."""
    return Path(moved.save(tmp_path_factory.mktemp("saved")))


@pytest.mark.parametrize("earlier", [False, True])
@pytest.mark.parametrize("name", ["moves.yaml", "trajectory_100hz.csv", "job.json", "diagnosis.json"])
def test_save_refuses_to_replace_files_of_others(
    moved: Any, saved: Path, name: str, earlier: bool, tmp_path: Path
) -> None:
    """It deleted a calibrated model and the user's own files without a word."""
    if earlier:
        shutil.copytree(saved, tmp_path, dirs_exist_ok=True)
    (tmp_path / name).write_text("mine")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(eo.BadInput, match=f"{name}.*force=True"):
        moved.save(tmp_path)
    assert (tmp_path / name).read_text() == "mine" and sorted(tmp_path.iterdir()) == before


def test_save_replaces_an_earlier_result_of_the_same_verb(moved: Any, tmp_path: Path) -> None:
    found = eo.evaluate([moved], "z1", ["source-method-2"], self_collision=False)
    (tmp_path / "model.toml").write_text("mine")
    found.save(tmp_path, write=["json"])
    found.save(tmp_path)
    assert sorted(path.suffix for path in tmp_path.iterdir() if path.is_file()) == [".json", ".toml"]
    (tmp_path / "trajectory.json").write_text("mine")
    with pytest.raises(eo.BadInput, match=r"trajectory\.json: would be replaced"):
        found.save(tmp_path)
    found.save(tmp_path, force=True)
    assert not (tmp_path / "trajectory.json").exists()


def test_every_verb_refuses_the_results_of_another(moved: Any, saved: Path) -> None:
    step = {"to": GOAL, "mode": "retime"}
    job = {"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 4.0, "step": [step, {**step, "to": START}]}
    others = (
        eo.evaluate([moved], "z1", ["source-method-2"], self_collision=False), eo.passport("z1"),
        eo.job(job, model="source-method-2", self_collision=False),
        eo.tradeoff("z1", "source-method-2", goal=GOAL, durations=[1.0, 2.0], **ASKED),
    )  # fmt: skip
    for other in others:
        with pytest.raises(eo.BadInput, match="holds the results of optimize"):
            other.save(saved)
    assert (saved / "result.json").is_file()


def test_a_copied_set_replaces_no_other_one(moved: Any, tmp_path: Path) -> None:
    asked: dict[str, Any] = {"static": 1.0, "self_collision": False}
    one = eo.simulate(moved, eo.source_model("z1"), tmp_path / "one", **asked)
    other = eo.simulate(moved, eo.source_model("z1"), tmp_path / "other", seed=1, **asked)
    for _ in range(2):
        one.save(tmp_path / "copy")
    with pytest.raises(eo.BadInput, match="another file of this name"):
        other.save(tmp_path / "copy")
    other.save(tmp_path / "copy", force=True)


def test_suggested_poses_replace_no_other_ones(tmp_path: Path) -> None:
    found = eo.identify(robot="z1", suggest=3)
    assert isinstance(found, Suggested)
    for _ in range(2):
        found.save(tmp_path)
    with pytest.raises(eo.BadInput, match="holds other poses"):
        eo.identify(robot="z1", suggest=4).save(tmp_path)


def test_save_names_what_it_expects(moved: Any) -> None:
    with pytest.raises(eo.BadInput, match="save None: expected the name of a folder"):
        moved.save(None)


def test_a_request_is_repeated_from_a_result_its_request_or_its_folder(moved: Any, saved: Path) -> None:
    """The text of a request was taken for the name of a file, and a folder was refused."""
    assert {eo.repeat(given).energy.total for given in (moved, moved.request, saved)} == {moved.energy.total}
    with pytest.raises(eo.BadInput, match="the request 3: expected the name of a file"):
        eo.repeat(3)


def test_a_limit_that_is_a_class_is_refused_as_such() -> None:
    with pytest.raises(eo.BadInput, match=r"expected a condition, a limit, as MaxPower\(\.\.\.\)"):
        eo.optimize("z1", goal=GOAL, conditions=[eo.conditions.MaxPower], **ASKED)


def test_a_plant_by_its_name(moved: Any, tmp_path: Path) -> None:
    with pytest.raises(eo.BadInput, match="robot is missing"):
        eo.simulate(moved, "careful", tmp_path / "none")
    found = eo.simulate(moved, "careful", tmp_path / "set", robot="z1", self_collision=False)
    assert "coulomb_friction" in {effect.name for effect in found.plant.model.effects}


def test_warnings_are_the_same_from_both_fronts(tmp_path: Path) -> None:
    model = eo.source_model("z1") + eo.effects.Payload(mass=0.5, com=[0.0, 0.0, 0.05])
    model.save(tmp_path / "model.toml")
    asked = {**ASKED, "payload": 0.3, "duration": 2.0}
    found = eo.optimize("z1", tmp_path / "model.toml", goal=GOAL, **asked)["warnings"]
    assert any("--payload" in said for said in found)
    words = ["--robot=z1", f"--model={tmp_path}/model.toml", "--start=0,1,-1,0,0,0", "--goal=0.3,1,-1,0,0,0"]
    words += ["--mode=retime", "--self-collision=off", "--payload=0.3", "--duration=2", f"--out={tmp_path}/out"]
    assert main(["optimize", *words, "--quiet"]) == 0
    assert json.loads((tmp_path / "out" / "result.json").read_text())["warnings"] == found
