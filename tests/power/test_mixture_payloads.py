"""Mixtures of models whose payloads, tilts or links differ: each member is evaluated with its own."""

from __future__ import annotations

import numpy as np
import pytest

from energy_opt.effects import BaseTilt, CoulombFriction, LinkInertia, Payload
from energy_opt.motion import Move, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.path import straight
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.motion.result import Result
from energy_opt.motion.retime.solve import retime
from energy_opt.power import Mixture, PowerModel, source_method_2
from energy_opt.robot import Robot

START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([0.8, 0.2, 0.3, -1.4, -0.4, 2.0, 0.0])


def _members() -> list[PowerModel]:
    """Three models of two rigid bodies; the middle one alone carries something."""
    loaded = source_method_2() + Payload(mass=3.0, com=[0.05, 0.0, 0.15]) + CoulombFriction(tau_c=0.4)
    return [source_method_2(), loaded, source_method_2() + CoulombFriction(tau_c=0.2)]


def _others() -> list[PowerModel]:
    """Models of two tilts, and of other links."""
    heavier = LinkInertia(mass=[0.3] * 7, com=[[0.0] * 3] * 7, inertia=[[0.0] * 6] * 7)
    return [source_method_2() + BaseTilt(roll=0.4, pitch=0.0), source_method_2(), source_method_2() + heavier]


@pytest.mark.parametrize("members", [_members(), _others()])
def test_nodes_and_scores_are_the_mean_of_the_members_own(panda: Robot, members: list[PowerModel]) -> None:
    z = np.concatenate([START, GOAL - START, np.ones(panda.n), [1.7]])
    mix = Mixture.of(members, [1, 2, 1])

    def rate(model: PowerModel) -> float:
        return float(node_functions(model, panda.body, ()).value(z, 0.4, np.append(model.values(panda.n), 1.0))[0])

    assert rate(mix) == pytest.approx(np.average([rate(m) for m in members], weights=[1, 2, 1]), rel=1e-12)
    trajectory = retime(panda, members[0], straight(START, GOAL), duration=2.0).trajectory
    mean, alone = Scorer(panda, mix).energy(trajectory), [Scorer(panda, m).energy(trajectory) for m in members]
    for part in ("total", "standby", "stored", "loss"):
        expected = np.average([getattr(energy, part) for energy in alone], weights=[1, 2, 1])
        assert getattr(mean, part) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert sum(mean.by_effect.values()) == pytest.approx(mean.total, rel=1e-9)


def test_powers_along_a_path_are_the_members_own(panda: Robot) -> None:
    members, s = _members(), np.linspace(0, 1, 9)
    a, b = np.linspace(-0.5, 0.5, 9), np.linspace(0.1, 0.4, 9)
    path = straight(START, GOAL)
    mixed = PathDynamics(panda, Mixture.of(members), path, s)
    alone = [PathDynamics(panda, member, path, s) for member in members]
    assert np.allclose(mixed.powers(a, b), np.stack([d.power(a, b) for d in alone], axis=1), rtol=1e-12)
    assert np.allclose(mixed.motor_torque(a, b), alone[0].motor_torque(a, b), rtol=1e-12)


def test_retiming_and_reshaping_minimise_the_mean_over_payloads(panda: Robot) -> None:
    """The mean is below that of each member's own optimum; it was the first payload's that counted for all."""
    members = [source_method_2(), source_method_2() + Payload(mass=3.0, com=[0.0, 0.0, 0.15])]
    scorers = [Scorer(panda, member) for member in members]
    path = straight(START, GOAL)

    def mean(model: PowerModel) -> float:
        found = retime(panda, model, path, duration=2.5).trajectory
        return float(np.mean([scorer.energy(found).total for scorer in scorers]))

    best = mean(Mixture.of(members))
    assert best <= min(mean(member) for member in members) + 1e-6
    assert best < mean(members[0]) - 1e-4

    rivals = [Rival("empty", members[0]), Rival("loaded", members[1])]
    settings = Settings(starts=1, controls=16, compile="never")
    move = Move(START, GOAL, duration=2.5)
    totals = {
        which: RobustPlanner(panda, order, "mean", settings).solve(move)
        for which, order in (("empty", rivals), ("loaded", rivals[::-1]))
    }
    both = [np.mean([row["total"] for row in result.models]) for result in totals.values()]
    assert both[0] == pytest.approx(both[1], rel=1e-3)  # whichever is first, the mean is the same problem
    assert not any("differ between the models" in said for said in totals["empty"].warnings)


def test_power_is_limited_under_every_payload(panda: Robot) -> None:
    """The limit was held with the first payload alone."""
    loaded = source_method_2() + Payload(mass=3.0, com=[0.0, 0.0, 0.15])
    rivals = [Rival("empty", source_method_2()), Rival("loaded", loaded)]
    free = RobustPlanner(panda, rivals, "mean", Settings(compile="never")).solve(Move(START, GOAL, "retime", 2.0))
    fine = np.linspace(0.0, 2.0, 8001)

    def peak(result: Result) -> float:
        return float(Scorer(panda, loaded).drive(*result.trajectory.sample(fine)[:3], fine)[1].max())

    limit = peak(free) - 5.0
    settings = Settings(compile="never", max_power=limit)
    held = RobustPlanner(panda, rivals, "mean", settings).solve(Move(START, GOAL, "retime", 2.0))
    assert held.status == "solved" and limit - 1 < peak(held) <= limit * (1 + 1e-6)
