"""Seeded sets: what they hold, that they repeat, that they read back; and the command that makes one."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from virtual_arms import ARMS, SIZES
from virtual_sets import arm, base_model, fresh_motions, make_set

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.effects import ViscousFriction
from energy_opt.errors import BadInput
from energy_opt.files import write_toml
from energy_opt.measured import read_set
from energy_opt.measured.log import read_log
from energy_opt.measured.sets import robot_of
from energy_opt.power import load_model
from energy_opt.robot.catalog import CATALOG, urdf_of
from energy_opt.tables import write_table
from energy_opt.virtual_arm.plant import PLAYED, Cogging, Plant

pytest.importorskip("mujoco")


@pytest.mark.parametrize("robot", list(ARMS))
def test_a_set_reads_back_on_every_arm(robot: str, tmp_path: Path) -> None:
    made = make_set(tmp_path, robot, ["viscous_friction"], seed=2, motions=4, poses=3)
    seen = read_set(tmp_path)
    assert [run.kind for run in seen.runs].count("motion") == 4
    truth = tomllib.loads((tmp_path / "truth.toml").read_text())
    assert truth["category"] == "single" and truth["names"] == ["viscous_friction"]
    declared = load_model(tmp_path / "declared.toml")
    assert [e.name for e in declared.effects] == ["standby", "copper_loss"]
    for true, run in zip(made.runs, seen.runs, strict=True):
        power = np.interp(run.power_time, true.played.time, true.power)
        error = run.power - power
        assert np.sqrt(np.mean(error**2)) == pytest.approx(made.instruments.noise, rel=0.25)
        moved = np.interp(run.time, true.played.time, true.played.position[:, 0]) - run.position[:, 0]
        assert np.abs(moved).max() < 5 * made.instruments.position_resolution + 2e-3


def test_sets_repeat_by_seed_and_differ_between_seeds(tmp_path: Path) -> None:
    sets = [
        make_set(tmp_path / str(k), "z1", ["payload"], seed=seed, motions=2, poses=1)
        for k, seed in enumerate((5, 5, 6))
    ]
    texts = ["".join(f.read_text() for f in sorted(s.folder.glob("*.csv"))) for s in sets]
    assert texts[0] == texts[1] != texts[2]


def test_weak_sets_lack_what_they_should(tmp_path: Path) -> None:
    poses = make_set(tmp_path / "static", "panda", ["armature"], weak="static_only", seed=1)
    assert all(np.ptp(run.played.position, axis=0).max() == 0 for run in poses.runs)
    still = make_set(tmp_path / "still", "panda", ["coulomb_friction"], weak="still_joint", seed=1, motions=3, poses=2)
    span = np.max([np.ptp(run.played.position, axis=0) for run in still.runs], axis=0)
    assert (span < 2e-3).sum() == 1 and (span > 0.1).sum() == 6


def test_every_motion_stays_within_velocity_limits(tmp_path: Path) -> None:
    for robot in ("panda", "ur5e", "z1"):
        made = make_set(tmp_path / robot, robot, seed=9, motions=6, poses=0)
        for run in made.runs:
            assert (np.abs(run.played.velocity).max(axis=0) < 1.02 * made.robot.limits.velocity).all()


def test_fresh_motions_are_other_motions_of_the_same_arm(tmp_path: Path) -> None:
    made = make_set(tmp_path / "a", "z1", [ViscousFriction(b=0.7)], seed=3, motions=2, poses=1)
    fresh = fresh_motions(made, tmp_path / "b", 2)
    assert fresh.plant == made.plant and fresh.runs[0].start > made.runs[-1].start
    assert fresh.runs[0].played.position.shape != made.runs[0].played.position.shape


def test_every_size_is_of_an_effect_that_is_played_and_sought() -> None:
    from energy_opt.effects import ALL_EFFECTS

    sought = {kind.name for kind in ALL_EFFECTS if kind.sought}
    assert {kind.name for kind in SIZES} | {"standby", "copper_loss"} <= sought & PLAYED


@pytest.fixture
def move(tmp_path: Path) -> Path:
    """A trajectory.csv of the z1: 0.8 rad and back in 2 s, columns in another order than the joints."""
    t = np.linspace(0, 2, 201)
    swing = 0.4 * (1 - np.cos(np.pi * t))
    speed = 0.4 * np.pi * np.sin(np.pi * t)
    joints = arm("z1").joints[::-1]
    header = ["time", *(f"{j}.position" for j in joints), *(f"{j}.velocity" for j in joints)]
    path = tmp_path / "move.csv"
    ways = np.array([0.2, 0.1, 0.3, -0.8, 0.9, 1.0])
    write_table(path, header, [t, *(w * swing for w in ways), *(w * speed for w in ways)])
    return path


def test_simulate_command(move: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plant = tmp_path / "plant.toml"
    write_toml(plant, Plant(base_model("z1"), (Cogging(amplitude=1.0),)).to_document())
    out, declared = tmp_path / "set", tmp_path / "believed.toml"
    base_model("z1").save(declared)
    arguments = [
        "simulate",
        str(move),
        str(move),
        "--plant",
        str(plant),
        "--out",
        str(out),
        "--static",
        "1",
        "--json",
        "--payload",
        "0.5,0,0,0.1",
        "--model",
        str(declared),
        "--self-collision",
        "off",  # folded up as it is, the arm touches itself
    ]
    assert main(arguments) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["runs"]) == 4 and said["plant"] == ["standby", "copper_loss", "payload", "cogging"]
    seen = read_set(out)
    assert [run.kind for run in seen.runs] == ["static", "motion", "static", "motion"]
    assert np.abs(seen.runs[1].position).max(axis=0) == pytest.approx(
        0.8 * np.array([1, 0.9, 0.8, 0.3, 0.1, 0.2]), abs=5e-3
    )
    truth = tomllib.loads((out / "truth.toml").read_text())
    assert truth["special"][0]["name"] == "cogging" and truth["effect"][-1]["mass"] == 0.5
    assert load_model(out / "declared.toml").to_document() == base_model("z1").to_document()


def test_a_set_that_is_saved_elsewhere_is_a_copy(move: Path, tmp_path: Path) -> None:
    base_model("z1").save(tmp_path / "plant.toml")
    made = eo.simulate(move, tmp_path / "plant.toml", tmp_path / "set", static=1.0, self_collision=False)
    assert made.save(tmp_path / "copy") == tmp_path / "copy"
    files = [sorted(f.name for f in (tmp_path / name).iterdir()) for name in ("set", "copy")]
    assert files[0] == files[1]
    assert len(read_set(tmp_path / "copy").runs) == len(made.runs)
    assert made.save(tmp_path / "set") == tmp_path / "set" and len(read_set(tmp_path / "set").runs) == len(made.runs)


def test_a_simulated_arm_on_a_wall_bears_its_own_weight(move: Path, tmp_path: Path) -> None:
    """The tilt of --base was left out of a simulation."""
    plant, robot = tmp_path / "plant.toml", arm("z1")
    write_toml(plant, Plant(base_model("z1")).to_document())
    tilt = {"base": [0, 0, 0, 1.2, 0, 0], "self_collision": False}
    made = eo.simulate(move, plant, tmp_path / "set", static=1.0, noise=0.0, **tilt)
    run = made.runs[0]
    whole = pin.buildModelFromUrdf(str(urdf_of(CATALOG["z1"])))
    body = pin.buildReducedModel(whole, [whole.getJointId("jointGripper")], pin.neutral(whole))
    body.gravity.linear = np.array([0.0, -9.81 * np.sin(1.2), -9.81 * np.cos(1.2)])
    load = pin.computeGeneralizedGravity(body, body.createData(), run.played.position[-1])
    assert list(body.names[1:]) == list(robot.joints)
    np.testing.assert_allclose(run.played.torque[-1], load, atol=0.05)


def test_a_stated_tilt_is_not_found_again(tmp_path: Path) -> None:
    """diagnose claimed the tilt that --base had stated."""
    rng, joints, moves = np.random.default_rng(0), arm("panda").joints, []
    header, u = ["time", *(f"{joint}.position" for joint in joints)], np.linspace(0, 1, 301)
    home = np.array([0, -0.785, 0, -2.1, 0, 1.571, 0.785])
    ends = np.vstack([home, home + rng.uniform(-0.5, 0.5, (10, 7))])
    for k, (start, goal) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
        moves.append(tmp_path / f"{k}.csv")
        way = start + np.outer(10 * u**3 - 15 * u**4 + 6 * u**5, goal - start)
        write_table(moves[-1], header, [u * rng.uniform(1.5, 3), *way.T])
    plant, on_a_wall = tmp_path / "plant.toml", [0, 0, 0, 1.2, 0, 0]
    base_model("panda").save(plant)
    eo.simulate(moves, plant, tmp_path / "set", static=1.0, base=on_a_wall, self_collision=False)
    found = eo.diagnose(tmp_path / "set", model=plant, base=on_a_wall).document()
    assert found["verdict"] == "nothing_missing" and found["effects"] == []


def test_a_set_of_an_arm_from_a_file_can_be_read(
    move: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plant, urdf = tmp_path / "plant.toml", tmp_path / "mine.urdf"
    base_model("z1").save(plant)
    urdf.write_bytes(arm("z1").urdf.read_bytes())
    words = (str(move), "--plant", str(plant), "--self-collision", "off", "--out", str(tmp_path / "set"))
    assert main(["simulate", *words, "--robot", str(urdf), "--lock", "jointGripper=0"]) == 0
    assert "a model of z1, used for mine" in capsys.readouterr().err
    log = read_log(tmp_path / "set")
    seen = read_set(tmp_path / "set", robot_of(log, None, {"jointGripper": 0.0}))
    assert seen.robot.urdf == tmp_path / "set" / "mine.urdf" and seen.robot.joints == arm("z1").joints[:6]
    assert np.ptp(seen.runs[0].position, axis=0).min() > 0.05


def test_simulate_command_names_faults(move: Path, tmp_path: Path) -> None:
    plant = tmp_path / "plant.toml"
    base_model("panda").save(plant)
    with pytest.raises(BadInput, match="panda_joint1 is missing"):
        eo.simulate(move, plant, tmp_path / "x")
    base_model("z1").save(plant)
    for option in ({"noise": -1}, {"rate": 0}, {"rate": 5000}, {"repeat": 0}, {"log": "current"}):
        with pytest.raises(BadInput):
            eo.simulate(move, plant, tmp_path / "x", self_collision=False, **option)
