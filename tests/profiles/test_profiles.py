"""Standard moves: durations against ruckig, what the closed forms say of themselves, and the planner's answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import ruckig
from poses import GOAL, START

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible
from energy_opt.formats.judging import Judging
from energy_opt.motion import Move, Planner, Result, Settings
from energy_opt.motion.dense import Dense
from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit, PlaceRows, Violation
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.plan.robust import Rival, RobustPlanner
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.numerics import ipopt
from energy_opt.power import PowerModel
from energy_opt.power.named import named_model
from energy_opt.profiles import (
    Chain,
    MovesPlanner,
    StandardMoves,
    as_result,
    fastest,
    movej,
    robust_moves,
    standard_moves,
)
from energy_opt.profiles.answer import costlier
from energy_opt.profiles.movej import leading
from energy_opt.profiles.program import SHARP, Program, Shape, lobatto
from energy_opt.robot import Robot


@pytest.mark.parametrize("jerk", [True, False], ids=["s-curve", "trapezoid"])
def test_durations_are_ruckigs(jerk: bool) -> None:
    """Over distances and limits of all sizes, so that every case (speed and acceleration reached or not) occurs."""
    rng, cases = np.random.default_rng(0), set()
    for _ in range(400):
        distance = 10 ** rng.uniform(-3, 1)
        v, a = 10 ** rng.uniform(-1, 1), 10 ** rng.uniform(-0.5, 1.5)
        j = 10 ** rng.uniform(0, 4) if jerk else math.inf
        given = ruckig.InputParameter(1)
        given.current_position, given.target_position = [0.0], [distance]
        given.max_velocity, given.max_acceleration, given.max_jerk = [v], [a], [j]
        theirs = ruckig.Trajectory(1)
        assert ruckig.Ruckig(1).calculate(given, theirs) == ruckig.Result.Working
        ours = fastest(distance, v, a, j)
        assert ours.duration == pytest.approx(theirs.duration, rel=1e-9)
        assert ours.speed <= v * (1 + 1e-12) and ours.acceleration <= a * (1 + 1e-12)
        assert ours.speed * (ours.ramp + ours.cruise) == pytest.approx(distance, rel=1e-12)
        cases.add((ours.cruise > 0, ours.acceleration > a * (1 - 1e-9)))
    assert len(cases) == (4 if jerk else 2)


def test_a_chain_of_one_move_is_ruckigs_profile() -> None:
    """Position, velocity and acceleration over time, of all joints at once."""
    start, goal = np.array([0.3, -1.0]), np.array([1.5, -1.4])
    profile = fastest(1.2, 1.0, 4.0, 20.0)
    ramps = np.full(2, profile.ramp)
    spans = np.array([profile.ramp + profile.cruise])
    curve = Chain(np.stack([start, goal]), spans, ramps, np.full(2, profile.rise)).trajectory(("a", "b"))
    given = ruckig.InputParameter(1)
    given.current_position, given.target_position = [0.3], [1.5]
    given.max_velocity, given.max_acceleration, given.max_jerk = [1.0], [4.0], [20.0]
    theirs = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(given, theirs)
    time = np.linspace(0, curve.duration, 300)
    q, v, a, _ = curve.sample(time)
    expected = np.array([theirs.at_time(t) for t in time])[:, :, 0]
    for ours, column in zip((q, v, a), expected.T, strict=True):
        assert ours[:, 0] == pytest.approx(column, abs=1e-6)
    assert q[:, 1] == pytest.approx(-1.0 - (q[:, 0] - 0.3) / 3, abs=1e-12)  # joints together


def bent(smooth: bool = True) -> Chain:
    rng = np.random.default_rng(3)
    corners = np.linspace(START, GOAL, 3) + rng.normal(size=(3, 7)) * [[0.0], [0.1], [0.0]]
    ramps = np.array([0.41, 0.5, 0.33])
    return Chain(corners, np.array([0.8, 0.7]), ramps, np.array([0.1, 0.12, 0.08]) if smooth else np.full(3, SHARP))


@pytest.mark.parametrize("smooth", [True, False])
def test_a_chains_rows_are_the_profile(smooth: bool) -> None:
    """Continuous, as fast as its closed forms say, and inside the triangle of its corners at the blend."""
    chain = bent(smooth)
    curve = chain.trajectory(tuple("abcdefg"))
    assert curve.duration == pytest.approx(chain.duration, rel=1e-15) and (np.diff(curve.time) > 0).all()
    time = np.linspace(0, chain.duration, 4001)
    q, v, a, jerk = curve.sample(time)
    rounding = 1.01 * time[1] ** 2 * np.abs(jerk).max() / 6  # of central differences
    np.testing.assert_allclose(np.gradient(q, time, axis=0)[1:-1], v[1:-1], atol=rounding)
    assert np.abs(v).max(axis=0) == pytest.approx(np.abs(chain.velocities).max(axis=0), rel=1e-9)
    assert np.abs(a).max(axis=0) == pytest.approx(np.abs(chain.accelerations).max(axis=0), rel=1e-9)
    peak = np.abs(chain.accelerations / chain.rises[:, None]).max(axis=0)
    assert np.abs(jerk).max(axis=0) == pytest.approx(peak, rel=1e-6)
    np.testing.assert_allclose(q[[0, -1]], [START, GOAL], atol=1e-12)
    middle = chain.ramps[0] / 2 + chain.spans[0]
    before = curve.sample(np.array([middle - chain.ramps[1] / 2]))[0][0]
    after = curve.sample(np.array([middle + chain.ramps[1] / 2]))[0][0]
    np.testing.assert_allclose(before, chain.corners[1] - chain.velocities[0] * chain.ramps[1] / 2, atol=1e-12)
    np.testing.assert_allclose(after, chain.corners[1] + chain.velocities[1] * chain.ramps[1] / 2, atol=1e-12)
    blend = curve.sample(np.linspace(middle - 0.25, middle + 0.25, 50))[0]
    triangle = np.stack([before, chain.corners[1], after])
    weights = np.linalg.lstsq(np.vstack([triangle.T, np.ones(3)]), np.vstack([blend.T, np.ones(50)]), rcond=None)[0]
    assert weights.min() > -1e-9 and np.abs(triangle.T @ weights - blend.T).max() < 1e-9


def test_lobatto_is_exact() -> None:
    for count in (4, 6, 8):
        x, w = lobatto(count)
        for degree in range(2 * count - 2):
            assert w @ x**degree == pytest.approx(1 / (degree + 1), rel=1e-12)


@pytest.fixture(scope="module")
def program(panda: Robot, model: PowerModel) -> Program:
    nodes = node_functions(model, panda.body, joint_limits(panda.limits))
    return Program(Shape(7, 1, True), nodes, (START, GOAL), joint_limits(panda.limits), model.values(7), (1.0, 3.0))


def test_the_programs_energy_is_the_judges(program: Program, panda: Robot, model: PowerModel) -> None:
    """Less the change of stored energy, which no moves avoid; and its rows are the judge's shares of the bounds."""
    chain = bent()
    curve = chain.trajectory(panda.joints)
    scorer = Scorer(panda, model)
    energy = scorer.energy(curve)
    x = program.unknowns(chain)
    assert program.cost(x) == pytest.approx(energy.total - energy.stored, rel=1e-8)
    rows = program.rows(x)
    limit = certify(curve, scorer, joint_limits(panda.limits))
    shares = np.abs(rows[6 : 6 + 7 * (2 + 3 + 3)])  # after 2 + 3 orders and the duration
    assert max(shares[:14]) - 1 == pytest.approx(limit.max_violation["velocity"], abs=1e-9)
    effort = np.abs(rows[6 + 56 :]).max() - 1
    assert effort == pytest.approx(limit.max_violation["effort"], abs=2e-3)  # nodes are not where it is largest


def check_derivatives(program: Program) -> None:
    """Gradient and Hessian of the Lagrangian against differences."""
    x = program.unknowns(bent())
    lam = np.random.default_rng(0).normal(size=len(program.row_bounds[0]))

    def slope(x: np.ndarray) -> np.ndarray:
        return 1.3 * program.gradient(x) + lam @ program.jacobian(x).reshape(program.size, -1).T

    step = 1e-6 * np.eye(program.size)

    def lagrangian(x: np.ndarray) -> float:
        return 1.3 * program.cost(x) + float(lam @ program.rows(x))

    numeric = np.array([(lagrangian(x + e) - lagrangian(x - e)) / 2e-6 for e in step])
    np.testing.assert_allclose(slope(x), numeric, rtol=1e-6, atol=1e-7 * np.abs(numeric).max())
    numeric = np.array([(slope(x + e) - slope(x - e)) / 2e-6 for e in step])
    upper = program.hessian(x, 1.3, lam)
    got = np.zeros((program.size, program.size))
    got.T[np.tril_indices(program.size)] = upper  # columns of the upper triangle one after another
    np.testing.assert_allclose(np.triu(got), np.triu(numeric), atol=1e-6 * np.abs(numeric).max())


def test_the_programs_derivatives(program: Program) -> None:
    check_derivatives(program)


@pytest.fixture(scope="module")
def solved(panda: Robot, model: PowerModel) -> tuple[Planner, Move, Result]:
    planner = Planner(panda, model, Settings(starts=1, controls=16, compile="never"))
    move = Move(START, GOAL, duration=1.8)
    return planner, move, planner.solve(move)


def test_moves_keep_much_of_the_saving(solved: tuple[Planner, Move, Result]) -> None:
    planner, move, reference = solved
    moves = MovesPlanner(planner)
    found = [moves.solve(move, reference, k) for k in (0, 1)]
    scaled = reference.baseline("scaled").energy.loss
    for k, answer in enumerate(found):
        assert answer.certificate.valid and answer.kind == "s-curve" and answer.vias <= k
        assert answer.trajectory.duration == pytest.approx(1.8, abs=1e-12)
        energy = Scorer(planner.robot, planner.model).energy(answer.trajectory)
        assert answer.energy.total == pytest.approx(energy.total, rel=1e-12)
        share = (scaled - energy.loss) / (scaled - reference.energy.loss)
        if share > 1:  # one start found a poor optimum; the moves led to a better one
            assert answer.kept is not None and answer.kept <= 1
        else:
            assert answer.kept == pytest.approx(share, rel=1e-9)
    assert found[1].kept is not None and found[0].kept is not None
    assert found[1].kept > max(1 / 3, found[0].kept + 0.1)
    one = found[0].chain
    assert one.ramps[0] == pytest.approx(one.ramps[1]) and one.rises[0] == pytest.approx(one.rises[1])
    document = as_result(reference, found[1]).document()
    assert document["chosen"] == "moves" and document["status"] == reference.status
    assert as_result(replace(reference, models=({"name": "x"},)), found[1]).models == ()


def test_moves_never_keep_more_than_there_is(solved: tuple[Planner, Move, Result]) -> None:
    """Beside a poor optimum, here of the straight line, the best trajectory is sought again from the moves."""
    planner, move, _ = solved
    poor = planner.solve(replace(move, mode="retime"))
    moves = MovesPlanner(planner).solve(move, poor, 1)
    assert moves.energy.loss < poor.energy.loss
    assert moves.kept is not None and 1 / 3 < moves.kept <= 1


@pytest.mark.slow
def test_moves_under_several_models_are_dearer_under_none(panda: Robot) -> None:
    """And cheaper in the mean than the moves for the first model alone, which knows nothing of friction."""
    names = ["source-method-2", "careful"]
    rivals = [Rival(name, named_model(name, "panda")) for name in names]
    settings = Settings(starts=1, controls=16, compile="never")
    robust, move = RobustPlanner(panda, rivals, "mean", settings), Move(START, GOAL, duration=2.0)
    reference = robust.solve(move)
    result, moves = robust_moves(robust, move, reference, 1)
    plain = Planner(panda, rivals[0].model, settings)
    alone = MovesPlanner(plain).solve(move, plain.solve(move), 1)
    scaled = result.baseline("scaled").trajectory
    totals = {}
    for rival in rivals:
        scorer = Scorer(panda, rival.model)
        totals[rival.name] = [scorer.energy(t).total for t in (moves.trajectory, alone.trajectory, scaled)]
        assert totals[rival.name][0] <= totals[rival.name][2]
    means = np.mean(list(totals.values()), axis=0)
    assert means[0] < means[1] - 1e-3 and not result.warnings
    assert result.chosen == "moves" and result.certificate.valid and 0 < moves.kept <= 1
    assert [(row["name"], row["total"]) for row in result.models] == [
        (name, pytest.approx(totals[name][0], rel=1e-9)) for name in names
    ]
    assert result.energy.total == moves.energy.total == pytest.approx(totals[names[0]][0], rel=1e-12)
    assert result.moves is not None and result.moves["loss"] == result.energy.loss


def test_too_short_for_standard_moves(solved: tuple[Planner, Move, Result]) -> None:
    """The duration that the message names can be done, and the one asked for could not."""
    planner, move, _ = solved
    fast = planner.solve(Move(START, GOAL, "retime", duration=planner.minimum_time(move) * 1.001))
    moves = MovesPlanner(planner)
    with pytest.raises(Infeasible, match="the shortest found that do take") as caught:
        moves.solve(move, fast, 0)
    shortest = caught.value.shortest_duration
    assert shortest is not None and shortest > fast.trajectory.duration
    again = planner.solve(Move(START, GOAL, "retime", duration=shortest * 1.0001))
    assert moves.solve(move, again, 0).certificate.valid


@pytest.mark.parametrize(
    ("changed", "vias", "says"),
    [
        ({"via": (GOAL,)}, 1, "chooses its own via points"),
        ({"mode": "retime"}, 1, "keeps the straight line"),
        ({}, 9, "expected 0 to 5"),
        ({"goal": START}, 0, "start and goal are the same"),
    ],
)
def test_what_standard_moves_cannot_do(
    solved: tuple[Planner, Move, Result], changed: dict, vias: int, says: str
) -> None:
    planner, _, reference = solved
    with pytest.raises(BadInput, match=says):
        MovesPlanner(planner).solve(Move(**{"start": START, "goal": GOAL, **changed}), reference, vias)


class Low(Limit):
    """Joint 2 stays below a height at all of some places: numeric rows, as distances between bodies are."""

    name, unit = "low", "rad"
    height = -0.35

    def worst(self, x: Dense) -> Violation:
        k = int(np.argmax(x.q[:, 1]))
        return Violation(self.name, float(x.q[k, 1] - self.height), x.joints[1], float(x.time[k]), 0.0, 0.0)

    def places(self, curve: Callable[[np.ndarray], np.ndarray]) -> PlaceRows:
        u = np.linspace(0.05, 0.6, 23)
        assert curve(u).shape == (23, 7)
        return LowRows(u, self.height)


class LowRows:
    """sin(q_2) - sin(height) <= 0, so that the rows have curvature of their own."""

    def __init__(self, u: np.ndarray, height: float) -> None:
        self.u, self.place, self.keys = u, np.arange(len(u)), np.arange(len(u))
        self.lower, self.upper = np.full(len(u), -np.inf), np.zeros(len(u))
        self._height = np.sin(height)

    def value(self, q: np.ndarray) -> np.ndarray:
        return np.sin(q[:, 1]) - self._height

    def gradient(self, q: np.ndarray) -> np.ndarray:
        return np.cos(q[:, 1])[:, None] * np.eye(7)[1]

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        return (-multipliers * np.sin(q[:, 1]))[:, None, None] * np.outer(np.eye(7)[1], np.eye(7)[1])


def test_numeric_rows_have_exact_derivatives_and_are_held(panda: Robot, model: PowerModel) -> None:
    limits = (*joint_limits(panda.limits), Low())
    nodes = node_functions(model, panda.body, limits)
    program = Program(Shape(7, 1, True), nodes, (START, GOAL), limits, model.values(7), (1.5, 1.5), bent())
    assert len(program.placed) == 1
    check_derivatives(program)
    x = program.unknowns(bent())
    inside = np.linspace(0.05, 0.6, 23)
    curve = bent().trajectory(panda.joints)
    assert bent().along(inside) == pytest.approx(curve.sample(inside * curve.duration)[0], abs=1e-12)
    assert program.rows(x)[-23:] == pytest.approx(np.sin(bent().along(inside)[:, 1]) - np.sin(-0.35))
    answer = ipopt.solve(program, x, program.box, program.row_bounds, {"max_iter": 200, "tol": 1e-6})
    free = Program(Shape(7, 1, True), nodes, (START, GOAL), limits, model.values(7), (1.5, 1.5))
    loose = ipopt.solve(free, x, free.box, free.row_bounds, {"max_iter": 200, "tol": 1e-6})
    assert answer.success and loose.success
    assert program.rows(answer.x)[-23:].max() <= 1e-7 < program.rows(loose.x)[-23:].max()
    assert program.cost(answer.x) > free.cost(loose.x)


@pytest.mark.slow
def test_moves_that_touch_are_led_around(solved: tuple[Planner, Move, Result], tmp_path: Path) -> None:
    """With one via point the hand would pass through a link; kept clear, and proven so, it costs a little more."""
    planner, move, reference = solved
    free = MovesPlanner(planner).solve(move, reference, 1)
    (tmp_path / "scene.yaml").write_text(
        "objects:\n  - {name: post, type: box, size: [0.08, 0.08, 0.5], position: [0.45, 0.25, 0.25]}\n"
    )
    among = Planner(
        planner.robot, planner.model, planner.settings,
        cell=load_cell(planner.robot, CellRequest(scene=tmp_path / "scene.yaml")),
    )  # fmt: skip
    touching = among.certify(free.trajectory, move)
    assert touching.within_limits and touching.clearance is not None and not touching.clearance.proven
    chain, certificate = MovesPlanner(among).mended(free.chain, move, (1.8, 1.8), "energy")
    assert certificate.valid and certificate.clearance is not None and certificate.clearance.lower_bound > 0
    energy = planner.score(chain.trajectory(planner.robot.joints))
    assert free.energy.loss < energy.loss < 1.3 * free.energy.loss


def test_moves_that_cost_more_than_slowing_are_no_answer(solved: tuple[Planner, Move, Result]) -> None:
    """More via points are tried; else the evenly slowed move is the answer, not converged."""
    planner, move, reference = solved
    moves = MovesPlanner(planner).solve(move, reference, 0)
    slowed = reference.baseline("scaled")

    def beside(total: float) -> Result:
        """The reference with an evenly slowed move of another energy."""
        energy = replace(slowed.energy, total=total, loss=slowed.energy.loss + total - slowed.energy.total)
        others = tuple(b for b in reference.baselines if b.name != "scaled")
        return replace(reference, baselines=(*others, replace(slowed, energy=energy)))

    cheap = beside(moves.energy.total - 0.01)
    with_more, taken = standard_moves(planner, None, move, cheap, 0)
    assert taken is not None and taken.vias >= 1 and with_more.energy.total < moves.energy.total - 0.01
    assert "1 via points are taken" in with_more.warnings[-1]
    kept = replace(move, mode="retime")
    result, none = standard_moves(planner, None, kept, cheap, 0)
    assert none is None and result.status == "not_converged" and result.chosen == "scaled" and result.moves is None
    assert result.certificate.valid and "cost less than the same move slowed evenly" in result.message
    np.testing.assert_array_equal(result.trajectory.position, slowed.trajectory.position)
    dear, same = standard_moves(planner, None, kept, beside(moves.energy.total + 0.01), 0)
    assert same is not None and dear.chosen == "moves" and not costlier(dear)


def test_moves_are_judged_with_each_axis_share(ur5: Robot, model: PowerModel, tmp_path: Path) -> None:
    """What a leading axis' acceleration asks of the others, from the files' own numbers; faults are found there."""
    start = np.array([0.0, -1.5, 1.2, -1.0, 0.3, 0.0])
    corners = np.stack([start, start + [0.5, 0.1, 0, 0, 0, 0], start + [0.6, 0.4, 0, 0, 0, 0.29],
                        start + [0.6, 0.9, 0, 0, 0, 0.8]])  # fmt: skip
    chain = Chain(corners, np.array([0.8, 0.6, 0.8]), np.array([0.3, 0.2, 0.2, 0.3]), np.full(4, 0.002))
    bound = np.abs(chain.accelerations).max(axis=0) * 1.01 + 0.1
    arm = replace(ur5, limits=ur5.limits.replace(acceleration=bound))
    _, asked = leading(chain, np.full(6, np.inf))
    _, held = leading(chain, bound)
    way = np.abs(np.diff(corners, axis=0))
    assert (asked[1] * way[1] / way[1].max() > bound * 1.01).any()  # as in the last edition
    assert (held[:, None] * way / way.max(axis=1, keepdims=True) <= bound * (1 + 1e-9)).all()
    curve = chain.trajectory(arm.joints)
    scorer = Scorer(arm, model)
    judge = Judging(scorer, joint_limits(arm.limits))
    moves = StandardMoves("trapezoid", chain, curve, scorer.energy(curve), judge(curve), None)
    rows = movej.write(moves, arm, judge, tmp_path, ["moves.yaml"])
    assert [row.file for row in rows] == ["moves.yaml", "moves.script"] and all(row.valid for row in rows)
    text = (tmp_path / "moves.script").read_text()
    (tmp_path / "moves.script").write_text(text.replace(f"a={held[1]:.9f}", f"a={asked[1]:.9f}"))
    broken = movej.judged(tmp_path / "moves.script", moves, judge)
    assert not broken.valid and broken.worst["limit"] == "acceleration"
