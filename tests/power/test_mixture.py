"""Mixtures of models: the mean of what their members say, in the law, in retiming and in reshaping."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from energy_opt.effects import CopperLoss, CoulombFriction, FrictionCurve, Payload, Regeneration, Standby
from energy_opt.errors import BadInput
from energy_opt.front.models import compared, rivals_from
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.path import straight
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.reshape.nodes import node_functions, symbolic_torque
from energy_opt.motion.retime.solve import retime
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import Mixture, PowerModel, drive_function, source_method_2
from energy_opt.power.drive_law import rigid_torque
from energy_opt.power.known import named_model
from energy_opt.power.model import Uncertainty
from energy_opt.power.variants import draws_of
from energy_opt.robot import Robot
from energy_opt.robot.catalog import CATALOG, urdf_of
from energy_opt.tradeoffs.front import Point, trace
from energy_opt.tradeoffs.front_files import stated

START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([0.8, 0.2, 0.3, -1.4, -0.4, 2.0, 0.0])


def _careful(robot: Robot) -> PowerModel:
    effects = (
        Standby(power=88.04),
        CopperLoss(r_over_kt2=0.0036),
        CoulombFriction(tau_c=0.6),
        Regeneration(efficiency=0),
    )
    return PowerModel(robot.name, effects)


def _pinocchio_panda() -> pin.Model:
    """The arm with locked fingers, by Pinocchio alone."""
    whole = pin.buildModelFromUrdf(str(urdf_of(CATALOG["panda"])))
    return pin.buildReducedModel(whole, [8, 9], pin.neutral(whole))


def test_the_law_is_the_weighted_mean(panda: Robot) -> None:
    members = [source_method_2(), _careful(panda)]
    mix = Mixture.of(members, [1, 3])
    rng = np.random.default_rng(0)
    state = [rng.normal(size=panda.n) for _ in range(4)]
    mean, names = drive_function(mix, panda.n)
    alone = [drive_function(m, panda.n)[0](*state, 0.3, m.values(panda.n)) for m in members]
    tau, power, parts = mean(*state, 0.3, mix.values(panda.n))
    assert float(power) == pytest.approx(0.25 * float(alone[0][1]) + 0.75 * float(alone[1][1]), rel=1e-12)
    assert np.allclose(np.array(tau), np.array(alone[0][0]))
    assert float(ca.sum1(parts)) == pytest.approx(float(power), rel=1e-12)
    assert set(names) == {"mechanical", "standby", "copper_loss", "coulomb_friction", "regeneration"}


def test_payload_is_shared_and_weights_build_nothing_again(panda: Robot) -> None:
    mix = Mixture.of([source_method_2(), _careful(panda)]).replaced(Payload(mass=2.0, com=[0, 0, 0.1]))
    assert all(member.get("payload") is not None for member in mix.members)
    other = Mixture.of(mix.members, [0.9, 0.1])
    assert other.structure == mix.structure and not np.array_equal(other.values(7), mix.values(7))


def test_nodes_of_a_mixture_are_the_mean_of_the_members_nodes(panda: Robot) -> None:
    members = [source_method_2(), _careful(panda)]
    z = np.concatenate([START, GOAL - START, np.ones(panda.n), [1.7]])
    rates = [
        float(node_functions(m, panda.body, ()).value(z, 0.4, np.append(m.values(panda.n), 1.0))[0]) for m in members
    ]
    mix = Mixture.of(members)
    assert float(
        node_functions(mix, panda.body, ()).value(z, 0.4, np.append(mix.values(panda.n), 1.0))[0]
    ) == pytest.approx(np.mean(rates), rel=1e-12)


def test_the_base_of_a_mixture_is_turned_once(panda: Robot) -> None:
    """Every member has the tilt; an arm on a wall was planned as one that stands, its gravity turned twice."""
    roll = 1.2
    mix = Mixture.of([source_method_2(), _careful(panda)]).standing(roll, 0.0)
    arm = _pinocchio_panda()
    arm.gravity.linear = np.array([0.0, -9.81 * np.sin(roll), -9.81 * np.cos(roll)])
    expected = pin.rnea(arm, arm.createData(), START, GOAL, START)
    assert np.allclose(rigid_torque(mix, panda.body, START[None], GOAL[None], START[None])[0], expected, atol=1e-9)
    p = mix.symbols(panda.n)
    tau = symbolic_torque(mix, panda.body, ca.SX(START), ca.SX(GOAL), ca.SX(START), p, "auto")
    assert np.allclose(np.array(ca.Function("tau", [p], [tau])(mix.values(panda.n))).ravel(), expected, atol=1e-6)


def test_retiming_minimises_the_mean(panda: Robot) -> None:
    """No timing that is best for one member is better in the mean."""
    members = [source_method_2(), _careful(panda).without("regeneration")]
    path = straight(START, GOAL)
    scorers = [Scorer(panda, m) for m in members]

    def mean(model: PowerModel) -> float:
        trajectory = retime(panda, model, path, duration=2.5).trajectory
        return float(np.mean([s.energy(trajectory).total for s in scorers]))

    best = mean(Mixture.of(members))
    mixed = Scorer(panda, Mixture.of(members)).energy(straightforward := retime(panda, members[0], path).trajectory)
    for part in ("total", "standby", "stored", "loss"):
        alone = [getattr(s.energy(straightforward), part) for s in scorers]
        assert getattr(mixed, part) == pytest.approx(np.mean(alone), rel=1e-9, abs=1e-9)
    assert best <= min(mean(m) for m in members) + 1e-6


def test_weights_that_make_no_mean_are_refused() -> None:
    for weights in ([1.0], [0.0, 0.0], [1.0, -1.0]):
        with pytest.raises(BadInput, match="weight"):
            Mixture.of([source_method_2(), source_method_2()], weights)


def test_a_robust_plan_is_dearer_than_the_slowed_move_under_no_model(panda: Robot) -> None:
    """The plan for the source model alone costs more than the slowed move once there is friction."""
    rivals = [Rival("plain", source_method_2()), Rival("careful", named_model("careful", "panda"))]
    settings = Settings(starts=1, controls=16, compile="never")
    move = Move(START, GOAL, duration=2.0)
    plain = Planner(panda, rivals[0].model, settings).solve(move)
    robust = RobustPlanner(panda, rivals, "mean", settings).solve(move)
    slowed = plain.baseline("scaled")
    assert slowed is not None and slowed.valid and robust.certificate.valid
    totals = {}
    for rival in rivals:
        scorer = Scorer(panda, rival.model)
        totals[rival.name] = [scorer.energy(t).total for t in (plain.trajectory, robust.trajectory, slowed.trajectory)]
        assert totals[rival.name][1] <= totals[rival.name][2] + 1e-9
    assert totals["careful"][0] > totals["careful"][2]
    means = np.mean(list(totals.values()), axis=0)
    assert means[1] < min(means[0], means[2])
    assert [row["total"] for row in robust.models] == pytest.approx([t[1] for t in totals.values()], rel=1e-9)
    assert robust.energy.total == pytest.approx(totals["plain"][1], rel=1e-9)


def test_another_objective_is_minimised_under_several_models_too(panda: Robot) -> None:
    """The least torque costs energy under friction; the evenly slowed move took its place."""
    rivals = [Rival("plain", source_method_2()), Rival("careful", named_model("careful", "panda"))]
    settings = Settings(starts=1, controls=16, compile="never", objective="torque")
    planned = RobustPlanner(panda, rivals, "mean", settings).solve(Move(START, GOAL, duration=2.0))
    slowed = planned.baseline("scaled")
    assert slowed is not None and planned.certificate.valid
    arm = _pinocchio_panda()
    least, even = (
        np.trapezoid(
            [np.sum(pin.rnea(arm, arm.createData(), *at) ** 2) for at in zip(*t.sample(t.time)[:3], strict=True)],
            t.time,
        )
        for t in (planned.trajectory, slowed.trajectory)
    )
    assert least < 0.8 * even


def test_the_worst_of_the_models_is_no_worse_than_of_the_mean(panda: Robot) -> None:
    heavy = PowerModel("panda", (Standby(power=60.0), CopperLoss(r_over_kt2=0.02)))
    rivals = [Rival("plain", source_method_2()), Rival("heavy", heavy)]
    settings = Settings(starts=1, controls=16, compile="never")
    move = Move(START, GOAL, mode="retime")
    worst = {}
    for kind, value in (("mean", np.mean), ("worst", np.max)):
        result = RobustPlanner(panda, rivals, kind, settings).solve(move)
        totals = [float(row["total"]) for row in result.models]
        worst[kind] = max(totals)
        assert result.robust is not None and result.robust["kind"] == kind
        assert result.robust["total"] == pytest.approx(value(totals), rel=1e-12)
        known = result.optimality  # each mean of the models is convex; the least of its energy bounds the largest, too
        bound = float(result.robust["lower_bound"])
        assert bound <= value(totals) and known.lower_bound is None  # no bound of the first model's energy
        assert known.gap_percent == pytest.approx(100 * (1 - bound / value(totals)), abs=1e-9)
        assert known.kind == ("global" if known.gap_percent <= 0.25 else "local")
        assert known.gap_percent < (0.01 if kind == "mean" else 5)
        assert f"J ({kind} of the models), gap" in str(result)
        power = result.trajectory.power
        assert power is not None and power.max() <= result.certificate.peak_power <= power.max() * 1.01
    assert worst["worst"] <= worst["mean"] + 1e-9


def test_energies_are_of_each_models_own_payload(panda: Robot) -> None:
    """The second model's payload was left out of its energy."""
    loaded = source_method_2().replaced(Payload(mass=3.0, com=[0, 0, 0.1]))
    rivals = [Rival("empty", source_method_2()), Rival("loaded", loaded)]
    settings = Settings(starts=1, controls=16, compile="never")
    planned = RobustPlanner(panda, rivals, "mean", settings).solve(Move(START, GOAL, duration=2.0))
    arm = _pinocchio_panda()
    arm.appendBodyToJoint(7, pin.Inertia(3.0, np.array([0, 0, 0.1]), np.zeros((3, 3))), pin.SE3.Identity())
    time = np.linspace(0, 2, 4001)
    q, v, a = planned.trajectory.sample(time)[:3]
    tau = np.array([pin.rnea(arm, arm.createData(), *at) for at in zip(q, v, a, strict=True)])
    total = np.trapezoid((tau * v).sum(axis=1) + 0.0036 * (tau**2).sum(axis=1) + 88.04, time)
    assert planned.models[1]["total"] == pytest.approx(total, rel=1e-5)
    assert not any("payload" in said for said in planned.warnings)


def test_power_is_within_its_limit_under_every_model(panda: Robot) -> None:
    heavy = PowerModel("panda", (Standby(power=88.04), CopperLoss(r_over_kt2=0.02)))
    rivals = [Rival("plain", source_method_2()), Rival("heavy", heavy)]
    settings = Settings(compile="never", max_power=130.0)
    result = RobustPlanner(panda, rivals, "mean", settings).solve(Move(START, GOAL, "retime", duration=2.0))
    fine = np.linspace(0.0, 2.0, 8001)
    _, power, _ = Scorer(panda, heavy).drive(*result.trajectory.sample(fine)[:3], fine)
    assert 129.0 < power.max() <= 130.0 * (1 + 1e-6) and result.status == "solved"
    assert not any("power reaches" in warning for warning in result.warnings)
    paper = Scorer(panda, source_method_2())
    for motion, peak in ((result.trajectory, result.certificate.peak_power),
                         *((b.trajectory, b.peak_power) for b in result.baselines)):  # fmt: skip
        at = np.linspace(0.0, motion.duration, 8001)
        assert peak == pytest.approx(paper.drive(*motion.sample(motion.time[0] + at)[:3], at)[1].max(), rel=1e-5)


def test_torque_beyond_its_limit_under_another_model_is_said(panda: Robot) -> None:
    """Limits are held without friction; with 6 N m of it, the first joint takes more than its motor gives."""
    rivals = [Rival("plain", source_method_2()), Rival("rough", source_method_2() + CoulombFriction(tau_c=6.0))]
    settings, move = Settings(compile="never", starts=1, controls=16), Move(START, GOAL, "retime", duration=2.0)
    first = RobustPlanner(panda, rivals, "mean", settings).solve(move)
    t = np.linspace(0.0, 2.0, 2001)
    most = np.abs(panda.body.torque(*first.trajectory.sample(t)[:3])).max(axis=0)
    assert not any("effort" in warning for warning in first.warnings)
    weak = dataclasses.replace(panda, limits=panda.limits.replace(effort=1.1 * most + 0.1))
    (said,) = RobustPlanner(weak, rivals, "mean", settings).solve(move).warnings
    assert (
        said.startswith("under 'rough' panda_joint") and " N m at " in said and said.endswith("holds it under 'plain'")
    )


def test_torque_limits_are_held_under_every_model(panda: Robot) -> None:
    """Friction takes the first joint beyond its limit; planned under both, Pinocchio's torque with friction is held."""
    rivals = [Rival("plain", source_method_2()), Rival("rough", source_method_2() + CoulombFriction(tau_c=3.0))]
    settings, move = Settings(compile="never", starts=1, controls=16), Move(START, GOAL, duration=1.2)

    def most(trajectory: Trajectory) -> float:
        q, v, a = trajectory.sample(np.linspace(0.0, 1.2, 4001) + trajectory.time[0])[:3]
        rough = panda.body.torque(q, v, a) + 3.0 * np.sign(v) * (np.abs(v) > 0.05)
        return float(np.abs(rough[:, 0]).max())

    effort = panda.limits.effort.copy()
    effort[0] = 0.95 * most(Planner(panda, rivals[0].model, settings).solve(move).trajectory)
    weak = dataclasses.replace(panda, limits=panda.limits.replace(effort=effort))
    first = Planner(weak, rivals[0].model, settings).solve(move)
    found = RobustPlanner(weak, rivals, "mean", settings).solve(move)
    assert most(first.trajectory) > 1.01 * effort[0] and most(found.trajectory) <= effort[0] * (1 + 1e-6)
    assert found.certificate.valid and not any("above its limit" in warning for warning in found.warnings)
    assert found.energy.total <= found.baseline("scaled").energy.total


def test_a_plan_of_the_source_model_says_what_friction_makes_of_it(panda: Robot) -> None:
    rivals, kind = rivals_from(["source_method_2"], None, panda)
    assert kind is None and rivals[0].name == "source-method-2"
    settings = Settings(starts=1, controls=16, compile="never")
    result = compared(Planner(panda, rivals[0].model, settings).solve(Move(START, GOAL, duration=2.0)), rivals, panda)
    assert [row["name"] for row in result.models] == ["source-method-2", "careful"]
    assert any("careful" in warning for warning in result.warnings)
    assert rivals_from([], None, panda)[1] == "mean"
    with pytest.raises(BadInput, match="mean or worst"):
        rivals_from([], "best", panda)


def test_what_the_data_leave_open_reaches_the_saving(panda: Robot) -> None:
    """The interval of the saving is that of savings under independent draws of the doubtful number."""
    friction = CoulombFriction(tau_c=0.8)
    uncertainty = Uncertainty(("coulomb_friction.tau_c.0",), np.array([[0.15**2]]), (source_method_2(),))
    model = dataclasses.replace(source_method_2().replaced(friction), uncertainty=uncertainty)
    rivals, kind = rivals_from([model], None, panda)
    assert kind is None
    result = Planner(panda, model, Settings(starts=1, controls=16, compile="never")).solve(
        Move(START, GOAL, duration=2.0)
    )
    row, other = compared(result, rivals, panda).models
    low, high = row["saving_joules_interval"]
    slowed = result.baseline("scaled")
    assert slowed is not None and other["name"] == "rival 1"
    savings = []
    for tau_c in 0.8 + 0.15 * np.random.default_rng(5).normal(size=60):
        scorer = Scorer(panda, source_method_2().replaced(CoulombFriction(tau_c=tau_c)))
        savings.append(scorer.energy(slowed.trajectory).total - scorer.energy(result.trajectory).total)
    wanted = np.percentile(savings, [2.5, 97.5])
    width = wanted[1] - wanted[0]
    assert width > 0 and np.abs(np.array([low, high]) - wanted).max() < 0.5 * width
    robust, kind = rivals_from([model], "mean", panda)
    assert kind == "mean" and [r.name for r in robust][-1] == "rival 1" and len(robust) > 3
    carrying = SimpleNamespace(payload=1.0)
    loaded, _ = rivals_from([model], "mean", panda, request=carrying)  # a payload takes nothing of the uncertainty away
    assert [r.name for r in loaded] == [r.name for r in robust] and all(r.model.get("payload") for r in loaded)
    tilted = model.standing(0.1, 0.0).uncertainty
    assert (
        tilted is not None
        and tilted.names == uncertainty.names
        and tilted.matrix.tolist() == uncertainty.matrix.tolist()
    )
    assert [rival.get("base_tilt") for rival in tilted.rivals] == [model.standing(0.1, 0.0).get("base_tilt")]


def test_draws_keep_given_values() -> None:
    """A curve's speeds have no uncertainty; those of its torques must not reach them by rounding."""
    curve, count = FrictionCurve(speed=[0.0, 0.1, 0.9], torque=np.full((6, 3), 4.0)), 6 + 3 + 18
    places = (("copper_loss.r_over_kt2", 6), ("friction_curve.speed", 3), ("friction_curve.torque", 18))
    names = tuple(f"{name}.{k}" for name, size in places for k in range(size))
    rng = np.random.default_rng(0)
    root = rng.normal(size=(count, count)) * np.exp(3 * rng.normal(size=(count, 1)))
    root[6:9] = 0.0
    model = PowerModel(
        "ur5", (CopperLoss(r_over_kt2=[0.1] * 6), curve), uncertainty=Uncertainty(names, root @ root.T, ())
    )
    for drawn in draws_of(model, 5):
        assert np.array_equal(drawn.effects[-1].values["speed"], [0.0, 0.1, 0.9])


@pytest.mark.slow
def test_a_point_of_a_front_that_exceeds_a_torque_limit_under_another_model_is_solved_again(panda: Robot) -> None:
    """Friction takes the first joint beyond its limit in 0.85 s; in the fastest move's time no other fits."""
    rivals = [Rival("plain", source_method_2()), Rival("rough", source_method_2() + CoulombFriction(tau_c=3.0))]
    settings, move = Settings(compile="never", starts=1, controls=16), Move(START, GOAL)
    effort = panda.limits.effort.copy()
    effort[0] = 11.0
    weak = dataclasses.replace(panda, limits=panda.limits.replace(effort=effort))
    robust = RobustPlanner(weak, rivals, "mean", settings)
    front = trace(robust.planner, move, durations=[0.85, 1.2])
    again = stated(robust, move, front, None)

    def most(point: Point) -> float:
        q, v, a = point.trajectory.sample(np.linspace(0.0, point.duration, 4001) + point.trajectory.time[0])[:3]
        return float(np.abs(panda.body.torque(q, v, a) + 3.0 * np.sign(v) * (np.abs(v) > 0.05))[:, 0].max())

    assert most(front.points[0]) > 11.1 and most(front.minimum) > 11.1
    assert max(map(most, (*again.points, again.minimum))) <= 11.0 < most(again.fastest)
