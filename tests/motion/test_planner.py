"""The planner's promises: judged results, never worse than baselines, degenerate and impossible moves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from energy_opt.effects import CoulombFriction, Payload
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.limits.base import Violation
from energy_opt.motion.path import through
from energy_opt.motion.plan import context as contexts
from energy_opt.motion.reshape.curve import Outcome
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.motion.reshape.search import COARSE_PACKING
from energy_opt.power import source_method_1, source_method_2
from energy_opt.robot import load_robot

START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4])


@pytest.fixture(scope="module")
def planner():
    return Planner(load_robot("panda"), source_method_2(), Settings(starts=2, controls=24, compile="never"))


@pytest.fixture(scope="module")
def reshaped(planner):
    return planner.solve(Move(START, GOAL, duration=2.0))


def test_linear_algebra_of_a_solve_runs_on_one_thread(planner, caplog):
    def threads():
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    seen = []
    caplog.handler.addFilter(lambda record: seen.append(threads()) or True)
    with threadpool_limits(2, user_api="blas"), caplog.at_level("INFO", logger="energy_opt.motion.reshape"):
        before = threads()
        planner.solve(Move(START, START + 0.1, duration=1.0))
        assert threads() == before and 2 in before
    assert len(seen) > 1 and all(one == {1} for one in seen)


def assert_keeps_its_word(result, move):
    trajectory = result.trajectory
    assert result.certificate.valid and result.certificate.samples >= 10 * (len(trajectory.time) - 1)
    assert np.allclose(trajectory.position[[0, -1]], [move.start, move.goal], atol=1e-12)
    assert result.energy.total == pytest.approx(sum(result.energy.by_effect.values()), abs=1e-6)
    parts = result.energy.standby + result.energy.stored + result.energy.loss
    assert result.energy.total == pytest.approx(parts, abs=1e-9)
    scaled = result.baseline("scaled")
    if scaled.valid:
        assert result.energy.total <= scaled.energy.total + 1e-9


def test_reshape(planner, reshaped):
    assert reshaped.status == "solved" and reshaped.chosen == "reshape"
    assert reshaped.trajectory.duration == pytest.approx(2.0, abs=1e-12)
    assert_keeps_its_word(reshaped, Move(START, GOAL))
    # mechanical work between two states of rest is the change of potential energy, whatever the path
    assert reshaped.energy.by_effect["mechanical"] == pytest.approx(reshaped.energy.stored, abs=1e-6)
    assert reshaped.saving["loss_percent"] > 40
    assert np.abs(reshaped.trajectory.acceleration[[0, -1]]).max() < 1e-8


def test_retime_lies_between_scaled_and_reshape(planner, reshaped):
    move = Move(START, GOAL, mode="retime", duration=2.0)
    result = planner.solve(move)
    assert_keeps_its_word(result, move)
    assert reshaped.energy.total < result.energy.total < result.baseline("scaled").energy.total
    assert result.optimality.kind == "global"
    assert 0 <= result.optimality.gap_percent < 0.1
    line = (result.trajectory.position - START) / (GOAL - START)
    assert np.ptp(line, axis=1).max() < 1e-9


def test_a_share_of_no_loss_is_none():
    robot = load_robot("ur5")
    planner = Planner(robot, source_method_1("ur5"), Settings(starts=1, controls=20, compile="never"))
    start = np.array([0.3, -1.2, 1.0, -0.5, 0.4, 0.1])
    result = planner.solve(Move(start, start + 0.5, "retime", duration=3.0))
    assert result.energy.loss == pytest.approx(0, abs=1e-6)
    assert result.saving["loss_percent"] is None and result.saving["total_percent"] == pytest.approx(0, abs=1e-6)


def test_free_duration_beats_its_neighbours(planner):
    best = planner.solve(Move(START, GOAL))
    for factor in (1.05, 1.3):
        other = planner.solve(Move(START, GOAL, duration=best.trajectory.duration * factor))
        assert best.energy.total <= other.energy.total + 1e-3


def test_max_duration_is_kept(planner):
    result = planner.solve(Move(START, GOAL, max_duration=1.0))
    assert result.trajectory.duration <= 1.0 + 1e-9
    assert_keeps_its_word(result, Move(START, GOAL))


def test_via_is_passed(planner):
    via = np.array([0.6, -0.2, 0.2, -1.9, 0.3, 1.9, 0.2])
    result = planner.solve(Move(START, GOAL, duration=2.5, via=(via,)))
    assert result.chosen == "reshape" and result.certificate.valid
    dense = result.trajectory.sample(result.trajectory.denser(20))[0]
    assert np.abs(dense - via).max(axis=1).min() < 2e-3


def test_free_end_acceleration_saves_more():
    results = {}
    for kind in ("zero", "free"):  # one start, so that both lie in the same valley
        settings = Settings(starts=1, controls=24, compile="never", end_acceleration=kind)
        planner = Planner(load_robot("panda"), source_method_2(), settings)
        results[kind] = planner.solve(Move(START, GOAL, duration=2.0))
    assert np.abs(results["free"].trajectory.acceleration[0]).max() > 0.1
    assert results["free"].energy.total < results["zero"].energy.total


def test_more_starts_find_a_better_valley_and_none_worse(planner):
    """The k-th start depends on seed and k alone: more of them go on where fewer ended, until that is enough."""
    loss, starts = [], []
    for budget in (1, 4, 24):
        planner.settings = replace(planner.settings, starts=budget)
        result = planner.solve(Move(START, GOAL, duration=2.0))
        loss.append(result.energy.loss)
        starts.append(result.solver.starts)
    planner.settings = replace(planner.settings, starts=2)
    assert np.diff(loss).max() <= 1e-3 * loss[-1]
    assert loss[-1] < 0.8 * loss[0]
    assert starts[:2] == [1, 4] and 4 < starts[-1] <= 24


def test_a_first_path_without_timing():
    """Where TOPP-RA finds no timing there are no baselines to state a saving against."""
    robot = load_robot("panda")
    start, goal = np.array([0, -0.785, 0, -0.4, 0, 1.571, 0.785]), np.array([1.2, 0.3, 0.4, -0.12, -0.5, 2.2, -0.4])
    via = np.array([0.5, -0.5, 0.2, robot.limits.upper[3], 0, 1.8, 0.5])  # the spline through it leaves the limits
    planner = Planner(robot, source_method_2(), Settings(starts=1, controls=16, compile="never"))
    result = planner.solve(Move(start, goal, duration=3.0, path=through(np.stack([start, via, goal]))))
    assert result.certificate.valid and result.chosen == "reshape"
    assert result.baseline("scaled") is None and result.saving is None
    assert result.document()["baselines"] == [] and "no timing of the first path" in result.document()["remark"]


def test_a_baseline_that_breaks_a_limit_states_no_saving(planner):
    result = planner.solve(Move(START, GOAL))  # faster than TOPP-RA on the straight path
    scaled = result.baseline("scaled")
    assert scaled.max_violation > 1e-6 and not scaled.valid
    assert result.saving is None and result.document()["baselines"][1]["valid"] is False
    own, least = (f"{x.duration:.4g} s" for x in (result, result.baseline("toppra")))
    why = f"this move takes {own}, the straight path at least {least}, so it cannot be compared at {own}"
    assert result.saved == f"no saving is stated: {why}"


def test_control_points_are_what_was_asked_for(panda, model):
    planner = Planner(panda, model, Settings(starts=1, compile="never"))
    for controls, via in ((10, ()), (13, ()), (16, ((START + GOAL) / 2,))):
        planner.settings = replace(planner.settings, controls=controls)  # which counts from the next move on
        result = planner.solve(Move(START, GOAL, duration=2.0, via=via))
        reshaper = planner.context(Move(START, GOAL)).reshaper("energy")
        assert reshaper.fine(len(via)).shape.basis.controls == controls
        assert reshaper.coarse(len(via)).shape.basis.packing == COARSE_PACKING
        assert result.certificate.valid
    planner.settings = replace(planner.settings, controls=10)
    with pytest.raises(BadInput, match="controls 10: too few for 1 via"):
        planner.solve(Move(START, GOAL, duration=2.0, via=((START + GOAL) / 2,)))


def test_values_change_without_building_again(monkeypatch):
    built = []
    monkeypatch.setattr(
        "energy_opt.motion.plan.context.node_functions", lambda *a: built.append(a) or node_functions(*a)
    )
    model = source_method_2().replaced(Payload(mass=0.0, com=[0, 0, 0.1]))
    planner = Planner(load_robot("panda"), model, Settings(starts=1, controls=16, compile="never"))
    empty = planner.solve(Move(START, GOAL, duration=2.0))
    planner = planner.under(model.replaced(Payload(mass=2.5, com=[0, 0, 0.1])))
    loaded = planner.solve(Move(START, GOAL, duration=2.0))
    assert len(built) <= 1  # none, if an earlier test has built the same
    assert loaded.energy.loss > 1.1 * empty.energy.loss
    planner = planner.under(model)
    assert planner.solve(Move(START, GOAL, duration=2.0)).energy.total == pytest.approx(empty.energy.total, abs=1e-4)
    with pytest.raises(BadInput, match="other effects"):
        planner.under(source_method_1())


def test_warm_start_is_never_lost(planner, reshaped):
    again = planner.solve(Move(START, GOAL, duration=2.0), warm=[reshaped.trajectory])
    assert again.energy.total <= reshaped.energy.total + 1e-9


def test_mirrored_move_costs_the_same():
    robot, settings = load_robot("ur5"), Settings(starts=1, controls=20, compile="never")
    planner = Planner(robot, source_method_2("ur5"), settings)
    start, goal = np.array([0.3, -1.2, 1.0, -0.5, 0.4, 0.1]), np.array([-0.5, -0.4, 0.3, 0.6, -0.2, 0.5])
    there = planner.solve(Move(start, goal, duration=2.0))
    back = planner.solve(Move(goal, start, duration=2.0))
    # time reversed: the same torques, so the same loss; what was stored is given back
    assert back.energy.loss == pytest.approx(there.energy.loss, rel=2e-3)
    assert back.energy.stored == pytest.approx(-there.energy.stored, abs=1e-9)


@pytest.mark.parametrize("mode", ["reshape", "retime"])
@pytest.mark.parametrize("duration", [None, 0.5])
@pytest.mark.parametrize("step", [0.0, 1e-4, 0.3])
def test_small_moves(planner, mode, duration, step):
    goal = START.copy()
    goal[6] += step
    move = Move(START, goal, mode=mode, duration=duration)
    result = planner.solve(move)
    assert_keeps_its_word(result, move)
    if duration is not None:
        assert result.trajectory.duration == pytest.approx(duration)
    elif mode == "reshape":
        retimed = planner.solve(Move(START, goal, mode="retime"))
        assert result.energy.total <= retimed.energy.total * (1 + 1e-6)


def test_friction_changes_the_answer(planner, reshaped):
    model = source_method_2().replaced(CoulombFriction(tau_c=5.0))
    rubbing = Planner(load_robot("panda"), model, Settings(starts=1, controls=24, compile="never"))
    result = rubbing.solve(Move(START, GOAL, duration=2.0))
    assert_keeps_its_word(result, Move(START, GOAL))
    assert result.energy.total < rubbing.score(reshaped.trajectory).total


def test_impossible_moves_say_why(planner):
    beyond = GOAL.copy()
    beyond[0] = 9
    with pytest.raises(Infeasible, match="panda_joint1") as caught:
        planner.solve(Move(START, beyond))
    assert (caught.value.joint, caught.value.limit) == ("panda_joint1", "position")
    for mode in ("retime", "reshape"):
        with pytest.raises(Infeasible) as short:
            planner.solve(Move(START, GOAL, mode=mode, duration=0.2))
        works = short.value.shortest_duration
        assert works is not None and 0.2 < works < 3
        result = planner.solve(Move(START, GOAL, mode=mode, duration=1.001 * works))
        assert result.certificate.valid
    heavy = source_method_2().replaced(Payload(mass=60.0, com=[0.0, 0.0, 0.1]))
    with pytest.raises(Infeasible) as weak:
        Planner(load_robot("panda"), heavy, Settings(starts=1, compile="never")).solve(Move(START, GOAL, duration=3.0))
    assert weak.value.limit == "effort" and weak.value.joint in load_robot("panda").joints


def test_bad_requests():
    for settings in ({"starts": 0}, {"objective": "beauty"}, {"solver": "magic"}, {"end_acceleration": "some"}):
        with pytest.raises(BadInput):
            Settings(**settings)
    with pytest.raises(BadInput):
        Move(START, GOAL, duration=1.0, max_duration=2.0)
    with pytest.raises(BadInput):
        Move(START, GOAL, duration=float("nan"))
    with pytest.raises(BadInput):
        Move(START, GOAL[:3])


@pytest.mark.parametrize(("works", "named"), [(2.3, 2.30086), (2.4, 2.4159), (9.0, None)])
def test_a_duration_that_is_named_is_asked_for(panda, model, monkeypatch, works, named):
    """And 1.01 and 1.05 times it; where it does not work a longer one that does is named, or none."""
    planner, ends = Planner(panda, model), (np.zeros(7), np.full(7, 0.1))
    asked: list[float] = []

    class Solver:
        timing = None

        def refuse_below_bound(self, move):
            """Its limits bound no duration."""

        def at(self, duration, longest, warm, progress=None):
            asked.append(duration)
            if duration < works:
                raise Infeasible("too short: the shortest found is 2.30086 s", shortest_duration=2.300851)
            return SimpleNamespace(result=SimpleNamespace(status="solved"))

    monkeypatch.setattr(planner, "single", lambda move: Solver())
    monkeypatch.setattr(planner, "check", lambda move: None)
    with pytest.raises(Infeasible) as short:
        planner.solve(Move(*ends, duration=1.0))
    assert short.value.shortest_duration == (None if named is None else pytest.approx(named, abs=1e-9))
    if named is not None:
        assert f"{named:g} s" in str(short.value)
        for wanted in (named, 1.01 * named, 1.05 * named):
            assert min(abs(wanted - duration) for duration in asked) < 1e-9
    else:
        assert "more time is needed" in str(short.value)


def test_a_duration_is_confirmed_within_seconds_by_the_first_path(panda, model, monkeypatch):
    """Each search had taken as long as that of an answer: minutes; and the first path's own timing was not tried."""
    planner, move = Planner(panda, model), Move(START, GOAL, duration=0.01)
    fastest, seconds = planner.minimum_time(move), []

    class Solver:
        timing = planner.timing(move)

        def refuse_below_bound(self, move):
            """Its limits bound no duration."""

        def at(self, duration, longest, warm, progress=None):
            if duration < move.duration * 1.001:
                raise Infeasible("too short: the shortest found is 0.1 s", shortest_duration=0.1)
            seconds.append(progress and progress.deadline)
            return SimpleNamespace(result=SimpleNamespace(status="solved" if duration >= fastest else "infeasible"))

    monkeypatch.setattr(planner, "single", lambda move: Solver())
    monkeypatch.setattr(planner, "check", lambda move: None)
    with pytest.raises(Infeasible) as short:
        planner.solve(move)
    assert short.value.shortest_duration == pytest.approx(fastest, rel=1e-4)
    assert seconds and all(deadline is not None and deadline <= 10 for deadline in seconds)


def test_a_search_that_stops_names_the_limit_that_it_uses_most() -> None:
    """Not the solver's word alone."""
    found = Outcome(None, 1.0, 0.0, False, "sqp", 3)  # type: ignore[arg-type]
    assert "kink of dry friction" in found.why and replace(found, status="Odd").why.endswith("Odd")
    worst = Violation("jerk", -0.01, "panda_joint2", 0.5, 99.0, 100.0)
    certificate = Certificate(9, (replace(worst, limit="velocity", excess=-0.5), worst), 1.0)
    assert certificate.tightest == "the tightest limit is the jerk of panda_joint2 at 0.5 s"


def test_a_path_is_timed_once_for_all_durations_of_a_move(planner, monkeypatch):
    """Only under another model, or within other shares of limits, is it timed again."""
    paths, timed = [], contexts.minimum_time
    monkeypatch.setattr(contexts, "minimum_time", lambda *given: paths.append(given) or timed(*given))
    move = Move(START, START + 0.3, mode="retime")
    shortest = planner.minimum_time(move)
    for longer in (1.5, 2.0):
        assert planner.slowed(move, longer * shortest) is not None
    planner.solve(replace(move, duration=1.5 * shortest))
    assert len(paths) == 1
    assert planner.within({"velocity": 0.5, "acceleration": 0.5}).minimum_time(move) > shortest
    planner.under(planner.model.replaced(Payload(mass=1.0, com=[0, 0, 0.08]))).minimum_time(move)
    assert len(paths) == 3


def test_the_fastest_move_is_no_slower_than_the_fastest_timing_of_its_first_path() -> None:
    """Zero end accelerations take about 1 % longer than a UR5e's own TOPP-RA, whose move is valid, too."""
    start, goal = np.array([0, -1.2, 1.4, -1.5, -1.57, 0]), np.array([1.5, -0.8, 1.0, -1.2, -1.0, 0.8])
    result = Planner(load_robot("ur5e"), source_method_2(), Settings(objective="time")).solve(Move(start, goal))
    fastest = result.baseline("toppra")
    assert fastest is not None and fastest.valid
    assert result.certificate.valid and result.trajectory.duration <= fastest.duration + 1e-9
