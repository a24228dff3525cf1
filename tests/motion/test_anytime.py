"""An answer at any time: the deadline of a search, and how its best proven answer got better until then."""

from dataclasses import replace

import casadi as ca
import pytest
from poses import GOAL, START

import energy_opt as eo
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.plan.anytime import Progress
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival

MOVE = Move(START, GOAL, duration=2.0)


@pytest.fixture(scope="module")
def planner(panda, model) -> Planner:
    settings = Settings(starts=2, compile="never", deadline=1e-6)
    return Planner(panda, model, settings, cell=Cell(panda, CellRequest()))


def test_the_first_answer_is_there_at_once_and_proven(planner) -> None:
    result = planner.solve(MOVE)
    assert result.status == "solved" and "deadline" in result.message and not result.interrupted
    assert result.certificate.valid and result.certificate.clearance.proven
    assert result.trajectory.duration == pytest.approx(2.0)
    assert result.solver.starts == 0  # nothing was searched


def test_more_time_never_gives_a_worse_answer_and_progress_says_how_it_got_better(planner) -> None:
    cut, whole = planner.solve(MOVE), planner.solve(MOVE, deadline=1e3)
    assert whole.energy.loss < cut.energy.loss and not whole.message
    seconds, losses = zip(*whole.progress, strict=True)
    assert list(seconds) == sorted(seconds) and list(losses) == sorted(losses, reverse=True)
    assert losses[0] == pytest.approx(cut.energy.loss) and losses[-1] == pytest.approx(whole.energy.loss)
    rows = whole.document()["progress"]
    assert [row["loss"] for row in rows] == list(losses)


def test_a_search_that_ends_in_time_has_no_deadline_message() -> None:
    progress = Progress(1e-9)
    assert progress.late() and not progress.cut  # nobody had to stop
    assert progress.ended() and progress.cut


def test_a_search_for_any_answer_ends_with_the_first() -> None:
    progress = Progress(None, enough=True)
    assert not progress.ended()
    progress.found(3.0)
    assert progress.ended() and progress.cut


def test_a_move_that_is_too_fast_is_refused_with_the_first_paths_timing_at_the_deadline(planner) -> None:
    """This had ended in a TypeError."""
    said = "is too short: the shortest found is .* limit of .*; the deadline passed before a shorter one"
    with pytest.raises(Infeasible, match=said) as refused:
        planner.solve(replace(MOVE, duration=0.05))
    assert refused.value.shortest_duration is None  # none was confirmed


class Aside(eo.conditions.Limit):
    """The first joint stays away from the middle of its way while the second one is near zero."""

    name = "aside"
    unit = "rad^2"
    binds = "arm"
    bound = 0.5

    def value(self, x: eo.conditions.State) -> ca.SX:
        """The product of the way made and left, times four, less the square of the second position."""
        return 4 * x.q[0] * (1 - x.q[0]) - x.q[1] ** 2


def test_where_the_deadline_comes_before_any_answer_it_is_named(panda) -> None:
    """The straight path breaks the limit at any timing. It was said that nothing free of collision was found."""
    asked = {"start": [0, 0.2, *START[2:]], "goal": [1.0, 0.2, *GOAL[2:]], "conditions": [Aside()]}
    with pytest.raises(Infeasible, match=r"^no trajectory within limits was found in 0\.001 s; a longer deadline may"):
        eo.optimize(panda, "source-method-2", **asked, duration=2.5, starts=1, controls=16, deadline=1e-3)


def test_several_models_share_one_deadline(panda, planner) -> None:
    rivals = [Rival("a", planner.model), Rival("b", planner.model)]
    result = RobustPlanner(panda, rivals, settings=replace(planner.settings, deadline=1e-6)).solve(MOVE)
    assert result.certificate.valid and "deadline" in result.message


@pytest.mark.parametrize("deadline", [0.0, -1.0, float("nan")])
def test_a_deadline_is_above_zero(deadline: float) -> None:
    with pytest.raises(BadInput, match="deadline"):
        Settings(deadline=deadline)
