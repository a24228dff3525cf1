"""What the console and reports say of a result, and where its losses come from."""

from dataclasses import replace

import numpy as np
import pytest

from energy_opt.cell.words import clearance_words
from energy_opt.effects import CopperLoss, Standby, ViscousFriction
from energy_opt.front.optimize import optimize, table
from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.energy import Scorer, loss_by_joint
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.reports.job import headline as headline_of_job
from energy_opt.reports.job import table as table_of_job
from energy_opt.reports.job import timeline
from energy_opt.reports.optimize import headline, page
from energy_opt.reports.words import input_words, limits_words
from energy_opt.robot import load_robot

MODEL = PowerModel("z1", (Standby(power=88.04), CopperLoss(r_over_kt2=0.0036)))


def test_one_clearance_is_stated_everywhere():
    found = {"verdict": "proven", "lower_bound": 0.00229, "min_distance": 0.0561, "pair": ["A", "B"]}
    document = {
        "energy": {"total": 10.0},
        "duration": 2.0,
        "saving": None,
        "baselines": [],
        "certificate": {"clearance": found},
    }
    words = "clearance proven ≥ 2.2 mm (nearest measured 56.1 mm: A–B)"  # a bound is never rounded up
    assert clearance_words(found) == words and headline(document) == f"10 J in 2 s. C{words[1:]}."
    document["saving"] = {"joules": 3.88, "loss_percent": 39.4}
    said = "10 J in 2 s: 3.88 J less than the evenly slowed straight path, 39.4 % of that one's loss. Clearance proven"
    assert headline(document).startswith(said)  # the share was said to be of the result's loss
    document["first_path"] = {"source": "ompl"}
    assert "the evenly slowed first path, " in headline(document)
    document |= {"saving": None, "remark": "no saving is stated: it touches something"}
    assert headline(document).startswith("10 J in 2 s; no saving is stated: it touches something. Cl")
    touching = {"verdict": "colliding", "depth": 0.003, "pair": ["A", "B"], "time": 1.0, "min_distance": -0.003}
    assert clearance_words(touching) == "collision: A–B at 1 s, 3 mm deep"
    assert clearance_words({**touching, "depth": None}).endswith("1 s, one inside the other")  # it was 0 mm deep
    assert clearance_words({**touching, "depth": 1.374}).endswith("1.37 m deep")  # it was 1.37e+03 mm


@pytest.mark.parametrize(
    ("excess", "text"),
    [
        (-2e-4, "all limits kept; tightest: j2 acceleration, 99.98 % used at 1.954 s"),
        (-1e-7, "all limits kept; tightest: j2 acceleration, 99.99 % used at 1.954 s"),
        (0.0, "all limits kept; tightest: j2 acceleration, 100 % used at 1.954 s"),
        (0.009, "limits not kept: j2 acceleration is 7.57 rad/s^2 at 1.954 s, 7.5 is allowed (0.9 % over)"),
        (None, "limits not kept: j2 acceleration is not known at 1.954 s"),
    ],
)
def test_limits_in_one_sentence(excess, text):
    worst = {"limit": "acceleration", "joint": "j2", "time": 1.954, "value": 7.57, "bound": 7.5}
    certificate = {"worst": worst, "max_violation": {"velocity": -0.5, "acceleration": excess}}
    assert limits_words(certificate, lambda limit, joint: "rad/s^2") == text


def test_no_line_of_the_table_repeats_another(tmp_path):
    robot, model = load_robot("z1"), MODEL
    move = Move(np.zeros(6) + [0, 1, -1, 0, 0, 0], np.array([0.8, 1.5, -1.3, 0.3, 0.2, 0.1]), "retime", 2.0)
    result = Planner(robot, model).solve(move)
    lines = table(result, tmp_path, robot).splitlines()
    reason = next(line for line in lines if line.startswith("The fastest timing takes "))
    values = [line.split(maxsplit=1)[1] for line in lines[1 : lines.index(reason)]]
    assert len(set(values)) == len(values)  # mechanical work is what is stored, copper loss the whole loss
    fastest = result.baseline("toppra").duration
    rest = f"In the remaining {2 - fastest:.3g} s, standby (88 W) takes {88.04 * (2 - fastest):.4g} J."
    assert reason == f"The fastest timing takes {fastest:.4g} s. {rest}"
    assert any(line.startswith("all limits kept; tightest: ") for line in lines)


def test_durations_that_read_alike_are_not_compared(tmp_path):
    """ "The fastest timing: 0.519 s instead of 0.519 s" was printed."""
    robot, model = load_robot("z1"), MODEL
    move = Move(np.zeros(6) + [0, 1, -1, 0, 0, 0], np.array([0.8, 1.5, -1.3, 0.3, 0.2, 0.1]), "retime")
    planner = Planner(robot, model)
    shortest = planner.minimum_time(move)
    for factor, stated in ((1.001, True), (1.00002, False)):
        result = planner.solve(replace(move, duration=shortest * factor))
        assert ("The fastest timing takes " in table(result, tmp_path, robot)) == stated


def test_a_baseline_that_is_not_valid_is_marked_and_nothing_is_compared_with_it(tmp_path):
    """The report compared the peak power with that of a baseline that breaks a limit."""
    robot = load_robot("z1")
    move = Move(np.zeros(6) + [0, 1, -1, 0, 0, 0], np.array([0.8, 1.5, -1.3, 0.3, 0.2, 0.1]), "retime", 2.0)
    result = Planner(robot, MODEL).solve(move)
    records = [{"name": name, "total": 1.0, "saving_joules": None, "saving_loss_percent": None} for name in "ab"]
    result = replace(result, models=tuple(records))  # under two models
    for valid in (True, False):
        found = replace(result, baselines=tuple(replace(b, valid=valid) for b in result.baselines))
        lines, html = table(found, tmp_path, robot).splitlines(), found._repr_html_()
        motions = {b.name: b.trajectory for b in found.baselines}
        report = page(found.document(), found.trajectory, motions, robot).html()
        assert ("scaled*" in lines[0]) == ("scaled*" in html) == (not valid)
        assert any(line.startswith("* breaks a limit") for line in lines) == ("* breaks a limit" in html) == (not valid)
        assert ("peak power; evenly slowed " in report) == valid
        assert any(line.endswith("of the loss (under a)") for line in lines) == valid
    assert "no saving is stated: the evenly slowed move breaks a limit or touches something" in lines


def test_losses_by_joint_are_those_of_the_formula():
    robot, n = load_robot("z1"), 6
    b, r = np.linspace(0.1, 1.0, n), 0.0036
    time = np.linspace(0.0, 2.0, 401)
    s, v, a = time**2 * (3 - time) / 4, 3 * time * (2 - time) / 4, 3 * (1 - time) / 2
    way = np.array([0.5, 0.6, -0.4, 0.3, 0.2, -0.3])
    q = np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0]) + s[:, None] * way
    motion = Trajectory(robot.joints, time, q, v[:, None] * way, a[:, None] * way)
    model = MODEL.replaced(ViscousFriction(b=b))
    lost = loss_by_joint(Scorer(robot, model), motion)
    tau = robot.body.torque(motion.position, motion.velocity, motion.acceleration) + b * motion.velocity
    assert set(lost) == {"viscous_friction", "copper_loss"}
    assert lost["viscous_friction"] == pytest.approx(np.trapezoid(b * motion.velocity**2, time, axis=0), rel=1e-4)
    assert lost["copper_loss"] == pytest.approx(np.trapezoid(r * tau**2, time, axis=0), rel=1e-4)


def test_a_given_trajectory_is_solved_at_its_own_duration(tmp_path):
    robot = load_robot("z1")
    home = np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0])
    time = np.linspace(0.0, 2.4, 241)
    s, v, a = (
        (time / 2.4) ** 2 * (3 - 2 * time / 2.4),
        6 * time / 2.4**2 * (1 - time / 2.4),
        6 / 2.4**2 * (1 - time / 1.2),
    )
    way = np.array([0.5, 0.6, -0.4, 0.3, 0.2, -0.3])
    rest = [np.outer(part, way) for part in (s, v, a)]
    given = Trajectory(robot.joints, time, home + rest[0], *rest[1:])
    answer = optimize(robot, MODEL, path=given, mode="retime", compile="never")
    assert answer.trajectory.duration == pytest.approx(2.4, abs=1e-9)
    own = Scorer(robot, MODEL).energy(given).total
    line = next(x for x in table(answer, tmp_path, robot).splitlines() if x.startswith("your timing: "))
    assert f"your timing: 2.4 s, {own:.5g} J; this plan: 2.4 s, {answer.energy.total:.5g} J (saves " in line
    assert answer.energy.total < own

    fast = Trajectory(robot.joints, time / 20, home + rest[0], 20 * rest[1], 400 * rest[2])
    answer = optimize(robot, MODEL, path=fast, mode="retime", compile="never")
    assert answer.status == "solved" and answer.trajectory.duration > 0.13
    assert any("0.12 s of the given trajectory are too short" in warning for warning in answer.warnings)


def test_a_timeline_shows_each_step_where_it_is():
    steps = [
        {"name": "to <A>", "kind": "move", "start": 0.0, "duration": 2.0, "payload": 0.0},
        {"name": "grip", "kind": "wait", "start": 2.0, "duration": 0.5, "payload": 1.5},
        {"name": "back", "kind": "move", "start": 2.5, "duration": 1.5, "payload": 1.5},
        {"name": "rest", "kind": "standby", "start": 4.0, "duration": 1.0, "payload": 0.0},
    ]
    blocks = timeline(steps)
    assert [(b.lane, b.name, b.start, b.duration) for b in blocks] == [
        ("moves", "to <A>", 0.0, 2.0),
        ("waits", "grip", 2.0, 0.5),
        ("moves", "back", 2.5, 1.5),
        ("standby", "rest", 4.0, 1.0),
        ("payload", "1.5 kg", 2.0, 2.0),
    ]


def test_a_position_at_its_bound_has_nothing_left_of_its_range():
    worst = {"limit": "position", "joint": "j2", "time": 2.0, "value": -1.7628, "bound": -1.7628}
    for excess in (0.0, 1e-8):
        certificate = {"worst": worst, "max_violation": {"velocity": -0.5, "position": excess}}
        said = limits_words(certificate, lambda limit, joint: "rad")
        assert said == "all limits kept; tightest: j2 position, 0 % of its range left at 2 s"


@pytest.mark.parametrize(("kind", "combine"), [("mean", np.mean), ("worst", np.max)])
def test_under_several_models_lines_compare_what_the_plan_minimises(kind, combine):
    """The plan seemed to take 0.0128 J more than the given trajectory: that is under the first model."""
    robot = load_robot("z1")
    models = [MODEL, MODEL.replaced(ViscousFriction(b=2.0))]
    home = np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0])
    path = home + np.linspace(0, 1, 40)[:, None] * np.array([0.5, 0.6, -0.4, 0.3, 0.2, -0.3])
    given = optimize(robot, MODEL, path=path, mode="retime", duration=2.0, compile="never").trajectory
    answer = optimize(robot, models, path=given, mode="retime", robust=kind, compile="never")
    own, plan = (combine([Scorer(robot, m).energy(t).total for m in models]) for t in (given, answer.trajectory))
    line = input_words(answer.document())
    assert line.startswith(f"your timing: 2 s, {own:.5g} J; this plan: 2 s, {plan:.5g} J (saves ")
    assert line.endswith(f" ({kind} of the models)")


def test_a_job_that_costs_more_under_its_first_model_says_so_in_words():
    """It was said to take more than waiting: under the first model, not in the mean that it was planned for."""
    baselines = [
        {"name": name, "energy_total": energy} for name, energy in (("fastest_then_wait", 200.0), ("b", 204.0))
    ]
    models = [{"name": "first", "total": 201.0, "saving_total_percent": 1.5}]
    models.append({"name": "second", "total": 210.0, "saving_total_percent": 2.0})
    found = {"cycle_time": 2.0, "energy_total": 201.0, "steps": [], "baselines": baselines, "models": models}
    found["robust"] = {"kind": "mean", "total": 205.5, "lower_bound": None}
    found["robust"]["baselines"] = {"fastest_then_wait": 220.0, "b": None}
    found["optimality"] = {"lower_bound": None}
    assert table_of_job(found, None).splitlines()[1:] == [
        "in a 2 s cycle (mean of the models): this plan 205.500 J",
        "  fastest then wait 220.000 J (this plan takes 6.59 % less)",
        "  b: not possible within the limits",
        "  under first: 201.000 J, 1.5 % less than b",
        "  under second: 210.000 J, 2 % less than b",
    ]
    assert headline_of_job(found) == "205.5 J a cycle (mean of the models), 6.59 % less than fastest then wait."
    del found["robust"]
    assert headline_of_job(found) == "201 J a cycle, 0.5 % more than fastest then wait, 1.47 % less than b."
    found["baselines"] = [{"name": "b", "energy_total": 201.0 * (1 - 1e-13)}]  # it was "1.02e-11 % more"
    assert headline_of_job(found) == "201 J a cycle, 0 % less than b."
