"""Standard moves: what is left of a saving, what they cannot do, and how they are judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import GOAL, START

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible
from energy_opt.formats.judging import Judging
from energy_opt.motion import Move, Planner, Result, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.power import PowerModel
from energy_opt.power.known import named_model
from energy_opt.profiles import (
    Chain,
    MovesPlanner,
    StandardMoves,
    as_result,
    movej,
    robust_moves,
    standard_moves,
)
from energy_opt.profiles.answer import costlier
from energy_opt.profiles.movej import leading
from energy_opt.robot import Robot


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
    chain, certificate = MovesPlanner(among).repaired(free.chain, move, (1.8, 1.8), "energy")
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
    assert "--vias 1 is used" in with_more.warnings[-1]
    kept = replace(move, mode="retime")
    result, none = standard_moves(planner, None, kept, cheap, 0)
    assert none is None and result.status == "not_converged" and result.chosen == "scaled" and result.moves is None
    assert result.certificate.valid and "cost less than the evenly slowed move" in result.message
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
