"""Values of a wrong type or size: one line of the package's own error, and nothing is written."""

from __future__ import annotations

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.formats import table
from energy_opt.front.moves import path_from
from energy_opt.motion import Move, Settings

HOME = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
SENSELESS = (-1, 0, float("nan"), float("inf"), 1e300, True, "5", None, [1.0], np.zeros((2, 3)))


@pytest.fixture(scope="module")
def robot():
    return eo.load_robot("panda")


@pytest.fixture(scope="module")
def planner(robot):
    return eo.Planner(robot, eo.source_model(robot), Settings(compile="never"))


def refused(says: str, call, *args, **given) -> None:
    with pytest.raises(eo.BadInput, match=says) as caught:
        call(*args, **given)
    assert "\n" not in str(caught.value)


def test_a_planner_names_what_it_was_given_and_what_it_needs(robot, planner):
    model, move = planner.model, Move(HOME, HOME)
    refused(r"^robot 'panda': expected a Robot \(load_robot returns one\)$", eo.Planner, "panda", "careful")
    refused(r"^model 'careful': expected a PowerModel \(load_model returns one\)$", eo.Planner, robot, "careful")
    refused("^settings 3: expected a Settings$", eo.Planner, robot, model, 3)
    refused("^cell 'x': expected a Cell", eo.Planner, robot, model, cell="x")
    for method in (planner.solve, planner.check, planner.minimum_time, planner.first_path, planner.sketch):
        refused("^move 3: expected a Move$", method, 3)
    for method in (planner.score, planner.certify):
        refused("^trajectory None: expected a Trajectory$", method, None)
    refused("^model None: expected a PowerModel", planner.under, None)
    refused("^warm 3: expected a sequence, each a Trajectory$", planner.solve, move, 3)
    refused("^warm .*: expected a sequence, each a Trajectory$", planner.solve, move, [np.zeros((2, 7))])
    refused("^deadline 'x': expected a number$", planner.solve, move, deadline="x")


@pytest.mark.parametrize(
    "condition", ["MaxPower", "ToolSpeed", "ToolAcceleration", "KeepUpright", "KeepOrientation", "KeepLine"]
)
@pytest.mark.parametrize("value", SENSELESS, ids=lambda value: f"{value!r:.9}")
def test_no_condition_has_a_senseless_bound(condition, value):
    refused(f"^{condition}: .*expected", getattr(eo.conditions, condition), value)


def test_a_tube_has_one_width_that_is_possible():
    for value in SENSELESS:
        refused("^Tube: .*expected", eo.conditions.Tube, metres=value)
        refused("^Tube: .*expected", eo.conditions.Tube, radians=value)
    refused("^Tube: expected radians", eo.conditions.Tube, 0.1, 0.1)


def test_conditions_and_limits_are_told_from_other_objects(planner):
    refused("expected", eo.conditions.options_and_limits, 3)
    refused("expected the name of a file", eo.conditions.load_file, 3)
    settings = Settings(own_limits=(3,))
    refused("own_limits 3: expected an OwnLimit", eo.Planner, planner.robot, planner.model, settings)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("starts", True, "a whole number"), ("starts", 2.5, "a whole number"), ("seed", None, "a whole number"),
        ("max_power", "5", "a number"), ("deadline", [1.0], "a number"), ("tube", 3, "text"), ("keep", 3, "text"),
        ("keep", [3], "text"), ("solver", np.zeros(3), "text"), ("allow_large", "no", "true or false"),
        ("max_power", -1, "0.001 to"), ("tool_speed", float("nan"), "1e-06 to 50 m/s"),
        ("tool_acceleration", 2500, "are these millimetres"), ("own_limits", 3, "a sequence"),
    ],
)  # fmt: skip
def test_settings_are_checked_when_they_are_made(field, value, says):
    refused(says, Settings, **{field: value})


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("duration", b"x", "a number"), ("duration", "2", "a number"), ("duration", True, "a number"),
        ("mode", np.zeros(3), "expected"), ("path", 3, "a JointPath"), ("input", 3, "a Trajectory"),
        ("via", 3, "expected"), ("via", None, "expected"), ("max_duration", np.zeros((2, 3)), "a number"),
    ],
)  # fmt: skip
def test_moves_are_checked_when_they_are_made(field, value, says):
    refused(f"^{field} .*{says}", Move, HOME, HOME, **{field: value})


def test_objects_that_users_make_are_checked(robot):
    refused("^model: effects 3: expected a sequence, each an Effect", eo.PowerModel, "panda", 3)
    refused("^model: effects", eo.PowerModel, "panda", ("copper_loss",))
    refused("^model: robot None: expected text", eo.PowerModel, None, ())
    refused("^limits 3: expected the name of a file", eo.load_robot, "panda", limits=3)
    refused("^lock 3: expected a Mapping", eo.load_robot, "panda", lock=3)
    refused("^robot 3: expected a Robot", eo.load_model, "careful", 3)
    refused("expected a name, the path of a URDF", eo.load_robot, np.zeros((2, 3)))
    two, zeros = [0.0, 1.0], np.zeros((2, 7))
    refused(
        r"position is None; expected numbers of shape \(2, 7\)", eo.Trajectory, robot.joints, two, None, zeros, zeros
    )
    refused("velocity", eo.Trajectory, robot.joints, two, zeros, np.zeros((3, 7)), zeros)
    refused("joints None", eo.Trajectory, None, two, zeros, zeros, zeros)
    refused("time has 1 samples; expected 2", eo.Trajectory, robot.joints, two[:1], *3 * [zeros[:1]])
    refused("^goal: AnyOf without a goal", eo.optimize, robot, start=HOME, goal=eo.AnyOf())
    refused("^AnyOf 3: expected a sequence of goals", eo.AnyOf, 3)
    assert eo.Trajectory(robot.joints, two, zeros.tolist(), zeros, zeros).duration == 1.0


def test_an_empty_list_is_not_the_default(tmp_path):
    """`model=[]` planned under both default models."""
    ends = {"start": HOME, "goal": HOME}
    for call, given in (
        (eo.optimize, {"robot": "panda", "model": [], **ends}), (eo.tradeoff, {"robot": "panda", "model": [], **ends}),
        (eo.evaluate, {"files": "x.csv", "model": []}), (eo.job, {"job": "job.toml", "model": []}),
        (eo.place, {"job": "job.toml", "base_box": [0] * 12, "model": []}),
        (eo.repeat, {"request": {"verb": "optimize", "robot": "panda", "model": [], **ends}}),
    ):  # fmt: skip
        refused("model: an empty list; give at least one, or leave it out", call, **given)
    refused("passport needs a model file", eo.passport, [])
    refused("no FILE; give one or more", eo.import_logs, [], tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_arrays_in_place_of_words_are_shown_in_one_line():
    table = np.zeros((2, 3))
    for field in ("mode", "seed", "self_collision", "allow_large", "robust", "tube", "limits", "floor", "robot"):
        refused(f"^{field} array", eo.optimize, **{"robot": "panda", "start": HOME, "goal": HOME, field: table})
    refused("^payload array", eo.optimize, "panda", start=HOME, goal=HOME, payload=table)
    ends = {"start": HOME, "goal": HOME}
    refused("pose_tolerance belongs to goal_pose", eo.optimize, "panda", **ends, pose_tolerance=table)
    refused("^method array", eo.source_model, "panda", table)
    refused("starts True: expected a whole number", eo.optimize, "panda", start=HOME, goal=HOME, starts=True)


def test_a_signal_that_cannot_be_logged_leaves_no_folder(tmp_path, robot):
    zeros = np.zeros((2, 7)) + HOME
    eo.source_model(robot).save(tmp_path / "plant.toml")
    still = np.zeros((2, 7))
    table.write(eo.Trajectory(robot.joints, np.array([0.0, 1.0]), zeros, still, still), tmp_path / "motion.csv")
    given = {"robot": "panda", "log": "temperature", "out": tmp_path / "set"}
    refused("extra signal 'temperature'", eo.simulate, tmp_path / "motion.csv", tmp_path / "plant.toml", **given)
    assert not (tmp_path / "set").exists()


def test_a_trajectory_as_a_path_has_rising_finite_samples_of_the_robots_joints(robot):
    """These ended in an IndexError or a ZeroDivisionError, and joints in another order were taken for others."""

    def motion(time, joints=robot.joints, **changed):
        still = {name: np.zeros((len(time), 7)) for name in ("velocity", "acceleration")}
        position = np.linspace(HOME, np.add(HOME, [0.1, 0.2, 0, 0, 0, 0, 0]), len(time))
        return eo.Trajectory(joints, time, **{"position": position, **still, **changed})

    hole = np.full((3, 7), np.nan)
    for path, says in (
        (motion([0, 0, 1]), "expected steps of"), (motion([0, 2, 1]), "expected steps of"),
        (motion([0, np.nan, 1]), "finite time"), (motion([0, 1, 2], position=hole), "finite"),
        (motion([0, 1, 2], velocity=hole), "velocity has values that are not finite"),
        (motion([0, 1], joints=tuple("abcdefg")), "joint panda_joint1 is missing"),
    ):  # fmt: skip
        refused(f"^path: .*{says}", eo.optimize, robot, path=path, mode="retime", self_collision=False)
    refused("^trajectory: time has 0 samples", motion, [])
    turned = motion([0, 1], joints=robot.joints[::-1], position=np.linspace(HOME, np.add(HOME, 0.1), 2)[:, ::-1])
    assert path_from(turned, robot).start == pytest.approx(HOME)


@pytest.mark.parametrize("values", [np.ma.masked_array(np.zeros(6), [1, 0, 0, 0, 0, 0]), np.zeros(6) + 1j], ids=str)
def test_masked_and_complex_positions_are_refused(values: np.ndarray) -> None:
    """The mask and the imaginary part were dropped."""
    refused("^start: masked or complex", eo.optimize, "z1", start=values, goal=[0, 1, -1, 0, 0, 0])
    refused("^path: masked or complex", eo.optimize, "z1", path=[values, values])
    labelled = {f"joint{k}": value for k, value in enumerate(values, 1)}
    refused("^goal: masked or complex", eo.optimize, "z1", start=[0, 1, -1, 0, 0, 0], goal=labelled)
