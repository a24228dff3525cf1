"""The front of energy against duration: its logic on a planner with known answers, then the real one."""

from __future__ import annotations

import json
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from poses import GOAL, START

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.effects import CopperLoss, IdleHold, Standby
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.plan.neighbour import Neighbours, Optimum
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, source_method_2
from energy_opt.reports.tradeoff import page
from energy_opt.requests.moves import TradeoffRequest
from energy_opt.results import Document
from energy_opt.robot import load_robot
from energy_opt.tradeoffs.fixed_cycle import Cycle
from energy_opt.tradeoffs.front import trace
from energy_opt.tradeoffs.front_files import Tradeoff, document, motions_of, table, text

FASTEST = 1.0


@dataclass(frozen=True)
class KnownMove:
    """What the front needs of a move."""

    duration: float | None = None
    max_duration: float | None = None
    mode: str = "reshape"
    start: tuple[float, ...] = (0.0,)
    goal: tuple[float, ...] = (1.0,)


def law(branch: int, duration: float) -> float:
    """Energy of two families of local optima; the second is the better one from 2 s on."""
    return 10 * duration + 40 / duration**3 + 2 * (2 - duration) * branch


def answer(branch, duration):
    """A trajectory that tells its family by its position, and its energy."""
    energy, standby = law(branch, duration), 10 * duration
    still = np.zeros((2, 1))
    trajectory = Trajectory(("j",), np.array([0.0, duration]), np.full((2, 1), float(branch)), still, still)
    return trajectory, Energy(energy, standby, 0.0, energy - standby)


class TwoOptima:
    """A planner that knows only the first family, and steps that fall into the second one unaided beyond 3.5 s."""

    scorer = SimpleNamespace(holding=lambda q: np.full(len(q), 1e6))  # [W] rest never pays

    def __init__(self):
        self.steps = 0
        self.settings = Settings()

    def with_settings(self, **changes):
        out = copy(self)
        out.settings = replace(self.settings, **changes)
        return out

    def minimum_time(self, move):
        return FASTEST

    def score(self, trajectory):
        return answer(int(trajectory.position[0, 0]), trajectory.duration)[1]

    def solve(self, move, warm=()):
        branches = {int(t.position[0, 0]) for t in warm} | {0}
        grid = [FASTEST] if self.settings.objective == "time" else np.linspace(1, 6, 5001)
        _, duration, branch = min((law(b, d), d, b) for d in grid for b in branches)
        trajectory, energy = answer(branch, duration)
        return SimpleNamespace(status="solved", energy=energy, trajectory=trajectory)

    def at(self, duration, neighbour):
        self.steps += 1
        branch = 1 if duration > 3.5 else int(neighbour.trajectory.position[0, 0])
        return Optimum(*answer(branch, duration), converged=True)


def front_of(planner=None, **options):
    planner = planner or TwoOptima()
    return trace(planner, KnownMove(), steps=planner, **options)


def test_better_optima_spread_both_ways():
    durations = np.linspace(1.0, 5.0, 33)
    front = front_of(durations=durations)
    best = [min(law(0, d), law(1, d)) for d in durations]
    assert [p.total for p in front.points] == pytest.approx(best, rel=1e-12)
    assert front.fastest.duration == FASTEST


def test_minimum_is_not_read_off_the_grid():
    front = front_of(durations=[1.0, 2.0, 5.0])
    assert min(abs(front.minimum.duration - d) for d in (1.0, 2.0, 5.0)) > 0.05
    assert front.minimum.total <= min(p.total for p in front.points)


def test_too_short_durations_are_marked_with_a_reason():
    front = front_of(durations=[0.5, 0.9, 1.5])
    assert [p.status for p in front.points] == ["infeasible", "infeasible", "solved"]
    assert "shorter than the fastest move, 1 s" in front.points[0].reason
    rows = table(document(front, robot="r", joints=("j",), mode="retime", cycle=None)).splitlines()
    assert rows[0] == "duration,energy_total,energy_standby,energy_loss,status"
    assert rows[1] == "0.5,,,,infeasible"


def test_no_point_is_faster_than_the_fastest():
    """The search for the fastest move ends in a local optimum, and the cheapest move may be faster."""

    class Slow(TwoOptima):
        def minimum_time(self, move):
            return 5.0

        def solve(self, move, warm=()):
            if self.settings.objective == "energy":
                return super().solve(move)
            trajectory, energy = answer(0, 4.0)
            return SimpleNamespace(status="solved", energy=energy, trajectory=trajectory)

    front = front_of(Slow(), durations=[1.5, 3.0, 5.0])
    assert front.fastest.duration == front.minimum.duration < 3.0
    assert [p.status for p in front.points] == ["infeasible", "solved", "solved"]
    assert f"shorter than the fastest move, {front.minimum.duration:.6g} s" in front.points[0].reason


def test_an_interrupted_front_keeps_its_points():
    class Interrupted(TwoOptima):
        def at(self, duration, neighbour):
            if self.steps == 5:
                raise KeyboardInterrupt
            return super().at(duration, neighbour)

    front = front_of(Interrupted(), durations=np.linspace(1, 5, 9))
    assert front.interrupted
    assert sum(p.status == "solved" for p in front.points) == 5
    assert front.minimum is not None


def test_waiting_costs_standby_and_holding(panda):
    model = source_method_2()
    zero = np.zeros((1, panda.n))
    gravity = panda.body.torque(GOAL[None], zero, zero)
    wait = Cycle(panda, model, GOAL, 5.0).waiting(2.0)
    assert wait.standby == pytest.approx(3 * 88.04, rel=1e-12)
    assert wait.holding == pytest.approx(3 * 0.0036 * float(np.sum(gravity**2)), rel=1e-12)
    idle = Cycle(panda, model, GOAL, 5.0, idle_power=20.0).waiting(2.0)
    assert (idle.standby, idle.holding) == (pytest.approx(60.0), pytest.approx(wait.holding))
    assert Cycle(panda, model, GOAL, 5.0).waiting(5.0).total == 0.0


def test_waiting_costs_what_is_drawn_after_a_motion(panda):
    """It had been left out."""
    model = source_method_2()
    plain, held = (
        Cycle(panda, m, GOAL, 5.0).waiting(2.0).holding for m in (model, model + IdleHold(power=10.0, duration=0.7))
    )
    assert held == pytest.approx(plain + 7.0, rel=1e-3)


@pytest.mark.parametrize(("length", "idle"), [(0.0, None), (-1.0, None), (5.0, -1.0), (np.inf, None)])
def test_impossible_cycles(panda, length, idle):
    with pytest.raises(BadInput):
        Cycle(panda, source_method_2(), GOAL, length, idle)


def test_the_fastest_move_with_a_wait_is_stated_if_no_step_leads_to_it(panda):
    """Within a power limit, no step ended at the fastest duration, and the saving of the cycle was empty."""

    class Hurried(TwoOptima):
        def at(self, duration, neighbour):
            return super().at(duration, neighbour) if duration > FASTEST else None

    cycle = Cycle(panda, PowerModel("panda", (Standby(power=10.0), CopperLoss(r_over_kt2=0.0))), GOAL, 3.0)
    fastest = front_of(Hurried(), durations=[2.0, 3.0], cycle=cycle).cycle_fastest
    assert fastest.cycle_total == pytest.approx(law(0, FASTEST) + 10 * (3.0 - FASTEST), rel=1e-12)


def test_cycle_weighs_the_wait_against_a_slower_move(panda):
    """With the arm's own standby waiting is as dear as moving, so slow is best; with none, the free optimum is."""
    model = PowerModel("panda", (Standby(power=10.0), CopperLoss(r_over_kt2=0.0)))
    durations = np.linspace(1, 3, 9)
    dear = front_of(durations=durations, cycle=Cycle(panda, model, GOAL, 3.0))
    assert dear.cycle_minimum.duration == pytest.approx(3.0, abs=0.02)
    cheap = front_of(durations=durations, cycle=Cycle(panda, model, GOAL, 3.0, 0.0))
    assert cheap.cycle_minimum.duration == pytest.approx(cheap.minimum.duration, rel=2e-3)
    wide = np.linspace(1, 5, 17)
    half = front_of(durations=wide, cycle=Cycle(panda, model, GOAL, 3.0, 6.0))
    fine = np.linspace(1, 3, 4001)
    costs = [min(law(0, d), law(1, d)) + 6 * (3 - d) for d in fine]
    assert half.cycle_minimum.cycle_total == pytest.approx(min(costs), rel=1e-4)
    with pytest.raises(Infeasible, match="shorter than the fastest"):
        front_of(cycle=Cycle(panda, model, GOAL, 0.8))


def test_files(tmp_path, panda):
    cycle = Cycle(panda, source_method_2(), GOAL, 4.0)
    front = front_of(durations=[0.5, 1, 2, 3, 4], cycle=cycle)
    found = document(front, robot="panda", joints=panda.joints, mode="retime", cycle=cycle)
    report = partial(page, motions=motions_of(front), robot=panda)
    Tradeoff(Document(found), TradeoffRequest(), report, text, panda, front).save(tmp_path)
    read = json.loads((tmp_path / "tradeoff.json").read_text())
    assert {"points", "minimum", "fastest", "cycle"} <= set(read)
    assert read["minimum"].keys() >= {"duration", "energy_total"}
    assert read["points"][0]["status"] == "infeasible"
    assert read["cycle"]["minimum"]["energy_total"] <= read["cycle"]["at_free_minimum"]["energy_total"]
    assert (tmp_path / "plot.png").read_bytes()[:4] == b"\x89PNG"
    assert len((tmp_path / "tradeoff.csv").read_text().splitlines()) == 6


def test_a_lower_optimum_is_entered_from_a_neighbour(panda):
    """A lowered arm gives energy back, which was once counted on one side only: what a neighbour led to was refused."""
    down = START + np.array([0.2, 0.9, 0.0, 0.3, 0.0, 0.0, 0.0])
    settings = Settings(compile="never", controls=16, starts=1)
    planner = Planner(panda, source_method_2(), settings, cell=load_cell(panda, CellRequest()))
    move = Move(START, down)
    steps = Neighbours(planner.single(move))
    neighbour = steps.single_move(1.6)
    slowed = planner.slowed(move, 1.5)
    poor = Optimum(slowed, planner.score(slowed), True)
    assert poor.energy.stored < -0.5 * poor.energy.loss
    steps._known[1.5] = poor
    assert steps.at(1.5, neighbour).energy.loss < 0.95 * poor.energy.loss


def test_far_durations_have_optima_of_their_own():
    """The optima of starts were handed on from duration to duration: the last point took 22 % more loss than alone."""
    robot, model = load_robot("ur5e"), source_method_2("ur5e")
    start, goal = [-1.223, -0.533, 0.355, 3.587, 3.226, -3.329], [1.998, -2.582, -0.839, 0.631, 2.107, -2.462]
    durations = [1.2634, 2.4772, 3.7159, 4.9545]
    front = trace(Planner(robot, model, Settings()), Move(start, goal), durations=durations)
    alone = Planner(robot, model, Settings()).solve(Move(start, goal, duration=durations[-1])).energy.loss
    (point,) = (p for p in front.points if p.duration == durations[-1])
    assert point.energy.loss < 1.001 * alone
