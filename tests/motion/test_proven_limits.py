"""Limits between the judge's places: by many places, by an evaluator of its own, and where a model has kinks."""

from __future__ import annotations

from collections.abc import Callable
from math import comb

import casadi as ca
import numpy as np
import pytest
from independent import Arm, curve

from energy_opt.effects import (
    CopperLoss,
    CoulombFriction,
    FrictionCurve,
    LoadFriction,
    Regeneration,
    SigmoidFriction,
    Standby,
    StribeckFriction,
    ViscousFriction,
)
from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.enclosure import Range, enclosed
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.judge.proven import Proof, peak, through
from energy_opt.motion.limits.joint import Effort
from energy_opt.motion.limits.own import Power
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, drive_function
from energy_opt.robot import Robot, load_robot

PLAIN = PowerModel("panda", (Standby(power=80.0), CopperLoss(r_over_kt2=0.004)))
ROUGH = PowerModel("panda", (
    Standby(power=80.0), CopperLoss(r_over_kt2=0.004), CoulombFriction(tau_c=1.0), ViscousFriction(b=0.5),
    StribeckFriction(tau_s=0.6, v_s=0.1), LoadFriction(mu=0.05), Regeneration(efficiency=0.3, level="joint"),
))  # fmt: skip
CURVE = PowerModel("panda", (FrictionCurve(speed=[0.0, 0.1, 0.4, 2.0], torque=np.tile([0.5, 0.2, 0.3, 1.0], (7, 1))),))
SMOOTH = PowerModel("panda", (CopperLoss(r_over_kt2=0.004), SigmoidFriction(a=0.7, k=9.0, c=0.03)))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("panda")


def motion(robot: Robot, step: float, seed: int = 3) -> Trajectory:
    """Rows of a lively motion, far apart."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 0.6, step)[:, None]
    size, speed, phase = rng.uniform(0.1, 0.4, robot.n), rng.uniform(3.0, 8.0, robot.n), rng.uniform(0, 6, robot.n)
    angle, middle = speed * t + phase, np.array([0, -0.8, 0, -2.0, 0, 1.6, 0.8])
    q, v, a = middle + size * np.sin(angle), size * speed * np.cos(angle), -size * speed**2 * np.sin(angle)
    return Trajectory(robot.joints, t[:, 0], q, v, a)


def test_peaks_of_polynomials_are_exact() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(8, 200))
    c = through(values)
    x = np.linspace(0, 1, 20_001)
    many = np.array([np.polyval(np.polyfit(np.linspace(0, 1, 8), values[:, j], 7), x).max() for j in range(200)])
    for j in range(200):
        assert peak(c[:, [j]], -np.inf, 1e-12)[0] == pytest.approx(many[j], abs=1e-6)
    high, column, place = peak(c, -np.inf, 1e-12)
    assert column == int(np.argmax(many))
    assert np.polyval(np.polyfit(np.linspace(0, 1, 8), values[:, column], 7), place) == pytest.approx(high, abs=1e-9)


@pytest.mark.parametrize("step", [0.004, 0.03])
def test_worst_places_are_those_of_many(robot: Robot, step: float) -> None:
    """Limits as tight as the motion is: found where an evaluator that shares no code finds them, 400 times a row."""
    t = motion(robot, step)
    _, x = curve(t.time, t.position, t.velocity, t.acceleration, 400)
    arm = Arm(robot.urdf.read_text(), robot.joints, robot.locked)
    tau = arm.torque(*(y.reshape(-1, robot.n) for y in x[:3]))
    certificate = certify(t, Scorer(robot, PLAIN), joint_limits(robot.limits))
    assert certificate.proven and certificate.document()["limits"] == "proven"
    bounds = robot.limits
    for name, values, bound in (
        ("velocity", x[1], bounds.velocity), ("acceleration", x[2], bounds.acceleration),
        ("jerk", x[3], bounds.jerk), ("effort", tau, bounds.effort),
    ):  # fmt: skip
        excess = float(np.max(np.abs(values) / bound)) - 1
        found = certificate.max_violation[name]
        assert found is not None and excess - 1e-6 <= found <= excess + 1e-4 * (1 + abs(excess)), name


@pytest.mark.parametrize("model", [PLAIN, SMOOTH, ROUGH], ids=["plain", "smooth", "rough"])
@pytest.mark.parametrize("kind", ["effort", "power"])
def test_peaks_between_the_places_are_found(robot: Robot, model: PowerModel, kind: str) -> None:
    """A bound that holds at all places, and is broken between two of them; and one a little larger, which is proven."""
    scorer = Scorer(robot, model)
    for seed in range(20):
        dense = scorer.dense(motion(robot, 0.03, seed))
        many = scorer.between(dense, np.linspace(0, dense.time[-1], 6_001)[:-1])
        columns = [x.power[:, None] if kind == "power" else np.abs(x.effort) for x in (dense, many)]
        seen, most = (x.max(axis=0) for x in columns)
        j = int(np.argmax(most / seen))
        if most[j] > seen[j] * (1 + 4e-6):
            break
    bound = np.full(robot.n, np.inf)
    bound[j] = most[j]
    shares = (1 + seen[j] / most[j]) / 2, 1 + 1e-4
    limits = [Power(float(most[j]) * s) if kind == "power" else Effort(bound * s) for s in shares]
    broken, held = ((Proof(dense, scorer).worst(limit, limit.worst(dense))) for limit in limits)
    assert broken[0].excess is not None and broken[0].excess == pytest.approx(1 / shares[0] - 1, rel=0.1, abs=6e-7)
    assert held[1] and held[0].excess is not None and -1e-3 < held[0].excess <= 0


@pytest.mark.parametrize("model", [SMOOTH, ROUGH, CURVE], ids=["smooth", "rough", "curve"])
def test_ranges_hold_all_values(robot: Robot, model: PowerModel) -> None:
    drive = drive_function(model, robot.n, past=True, holds=True)[0]
    n, rng = robot.n, np.random.default_rng(5)
    x = [ca.SX.sym(word, n) for word in ("q", "v", "a", "tau")]
    t = ca.SX.sym("t")
    out = drive(**dict(zip(("q", "v", "a", "tau"), x, strict=True)), t=t, idle=-1, returned=0, p=model.values(n))
    function = ca.Function("f", [*x, t], [out["tau_m"], out["power"]])
    low = [rng.normal(size=(30, n)) * size for size in (1, 0.1, 3, 20)]
    width = [10.0 ** rng.uniform(-4, -1, (30, 1)) * np.ones((1, n)) for _ in low]
    none = np.zeros(30)
    ranges = [
        [Range(a[:, j], a[:, j] + w[:, j], w[:, j], w[:, j]) for j in range(n)] for a, w in zip(low, width, strict=True)
    ]
    found = enclosed(function, [*ranges, [Range(none, none, none, none)]])
    before = None
    for share in np.linspace(0, 1, 41):
        values = [
            f.full() for f in function.map(30)(*((a + share * w).T for a, w in zip(low, width, strict=True)), none)
        ]
        for rows, value in zip(found, values, strict=True):
            for r, column in zip(rows, value, strict=True):
                assert (r.low - 1e-9 <= column).all() and (column <= r.high + 1e-9).all()
        if before is not None:
            for rows, new, old in zip(found, values, before, strict=True):
                for r, change in zip(rows, (new - old) * 40, strict=True):
                    assert (change <= r.rising * (1 + 1e-9) + 1e-7).all()
                    assert (change >= r.falling * (1 + 1e-9) - 1e-7).all()
        before = values


LAWS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "cos": lambda x: ca.cos(3 * x),
    "sin": lambda x: x * ca.sin(x),
    "log": lambda x: ca.log(x * x + 1e-3),
    "power": lambda x: ca.exp(0.7 * ca.log(ca.fmax(ca.fabs(x), 1e-12))),
}


@pytest.mark.parametrize("law", LAWS)
def test_ranges_of_functions_hold_their_values_and_rates(law: str) -> None:
    x, rng = ca.SX.sym("x"), np.random.default_rng(3)
    function = ca.Function("f", [x], [LAWS[law](x)])
    low, width = 4 * rng.normal(size=400), 10.0 ** rng.uniform(-4, 1, 400)
    ((found,),) = enclosed(function, [[Range(low, low + width, width, width)]])
    values = np.stack([np.asarray(function(low + share * width)).ravel() for share in np.linspace(0, 1, 101)])
    assert (found.low - 1e-9 <= values).all() and (values <= found.high + 1e-9).all()
    change = 100 * np.diff(values, axis=0)
    assert (found.falling * (1 + 1e-9) - 1e-6 <= change).all() and (change <= found.rising * (1 + 1e-9) + 1e-6).all()
    narrow = width < 1e-3
    assert ((found.high - found.low)[narrow] < 100 * width[narrow]).all()


def test_a_bound_on_power_at_a_point_of_a_friction_curve_is_proven(robot: Robot) -> None:
    """Power is largest where a joint's speed passes a point between two pieces of the curve."""
    t = motion(robot, 0.03)
    dense = Scorer(robot, PLAIN).dense(t)
    speed = np.abs(dense.v[np.argmax(dense.power)])
    j = int(np.argmax(speed))
    torque = np.zeros((robot.n, 3))
    torque[j] = 1.0, 0.5, 1.0
    scorer = Scorer(robot, PLAIN + FrictionCurve(speed=[0.0, speed[j], 2 * speed[j]], torque=torque))
    dense = scorer.dense(t)
    limit = Power(float(dense.power.max()) * (1 + 1e-5))
    assert Proof(dense, scorer).worst(limit, limit.worst(dense))[1]


def test_torque_lies_near_its_polynomial(robot: Robot) -> None:
    t = motion(robot, 0.03)
    scorer = Scorer(robot, PLAIN)
    c, error, rate = Proof(scorer.dense(t), scorer)._torque()
    x = np.linspace(0, 1, 33)
    tau = scorer.dense(t, 32).rigid
    rows = np.concatenate([tau[:-1].reshape(len(t.time) - 1, 32, -1).transpose(1, 0, 2), tau[None, 32::32]])
    basis = np.array([[comb(10, k) * s**k * (1 - s) ** (10 - k) for k in range(11)] for s in x])
    off = np.abs(np.tensordot(basis, c, axes=1) - rows).max(axis=0)
    assert (off <= error).all() and error.max() < 1e-4 and rate.max() < 10


def test_what_has_no_bound_is_not_proven(robot: Robot) -> None:
    """Rows so far apart for how fast the joints turn that nothing is known of torque at complex times."""
    lively = motion(robot, 0.03)
    t = Trajectory(lively.joints, 100 * lively.time, lively.position, lively.velocity, lively.acceleration)
    certificate = certify(t, Scorer(robot, PLAIN), joint_limits(robot.limits))
    assert not certificate.proven and certificate.document()["limits"] == "sampled"
