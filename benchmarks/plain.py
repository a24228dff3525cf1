"""The reshaping problem as one would write it at first with CasADi: the yardstick of `reshape.py`.

One symbolic node function (energy rate and limits) mapped over the nodes, control points in between, and IPOPT with the
derivatives that CasADi's own differentiation gives it. Limits hold at the nodes only. One start: the straight line with
quintic timing. Nothing of it is used by the optimizer.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.dynamics import torque_function
from energy_opt.numerics.bspline import DEGREE, Basis
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

OPTIONS = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 500}
SCALE = 100.0  # J: brings the objective near one
PINNED = DEGREE // 2 + 1  # control points at each end: position, velocity and acceleration


@dataclass(frozen=True)
class PlainAnswer:
    """Where the plain script stopped: control points (controls, n), its own objective [J], CPU times [s]."""

    points: np.ndarray
    energy: float
    build_seconds: float
    solve_seconds: float
    iterations: int
    status: str


def node_function(robot: Robot, model: PowerModel, duration: float) -> ca.Function:
    """(q, dq/du, d2q/du2) -> power [W] and (velocity, acceleration, torque as shares of their limits; q)."""
    n, limits = robot.n, robot.limits
    q, q1, q2 = (ca.SX.sym(name, n) for name in ("q", "q1", "q2"))
    v, a = q1 / duration, q2 / duration**2
    tau = torque_function(robot.body)(q, v, a, ca.SX(ca.DM(robot.body.gravity)), ca.SX(0), ca.SX.zeros(3))
    standby = float(model.get("standby").values["power"][0])
    copper = np.broadcast_to(np.asarray(model.get("copper_loss").values["r_over_kt2"], dtype=float), (n,))
    power = ca.dot(tau, v) + ca.dot(ca.DM(copper), tau**2) + standby
    shares = [v / limits.velocity, tau / limits.effort]
    if np.isfinite(limits.acceleration).all():
        shares.append(a / limits.acceleration)
    return ca.Function("node", [q, q1, q2], [power, ca.vertcat(*shares, q)])


def plain(
    robot: Robot,
    model: PowerModel,
    start: np.ndarray,
    goal: np.ndarray,
    duration: float,
    basis: Basis,
    per_span: int,
    tolerance: float,
) -> PlainAnswer:
    """Solve one move of given duration [s] between states of rest, end acceleration zero."""
    begin = time.process_time()
    n, limits, free = robot.n, robot.limits, basis.controls - 2 * PINNED
    node = node_function(robot, model, duration)
    u, w = basis.gauss(per_span)
    x = ca.MX.sym("x", n * free)
    points = ca.horzcat(ca.repmat(ca.DM(start), 1, PINNED), ca.reshape(x, n, free), ca.repmat(ca.DM(goal), 1, PINNED))
    power, rows = node.map(len(u))(*(points @ ca.DM(basis.matrix(u, order)).T for order in range(3)))
    problem = {"x": x, "f": duration / SCALE * ca.dot(ca.DM(w), power.T), "g": ca.vec(rows)}
    solver = ca.nlpsol("plain", "ipopt", problem, {**OPTIONS, "ipopt.tol": tolerance})
    built = time.process_time()
    greville = np.array([basis.knots[k + 1 : k + 1 + DEGREE].mean() for k in range(basis.controls)])[PINNED:-PINNED]
    way = greville**3 * (10 - 15 * greville + 6 * greville**2)
    guess = (start[:, None] + np.outer(goal - start, way)).ravel(order="F")
    ones = np.ones(rows.shape[0] - n)
    answer = solver(
        x0=guess,
        lbx=np.tile(limits.lower, free),
        ubx=np.tile(limits.upper, free),
        lbg=np.tile(np.concatenate([-ones, limits.lower]), len(u)),
        ubg=np.tile(np.concatenate([ones, limits.upper]), len(u)),
    )
    done, stats = time.process_time(), solver.stats()
    inner = np.array(answer["x"]).reshape(free, n)
    return PlainAnswer(
        np.vstack([np.tile(start, (PINNED, 1)), inner, np.tile(goal, (PINNED, 1))]),
        SCALE * float(answer["f"]),
        built - begin,
        done - built,
        int(stats["iter_count"]),
        str(stats["return_status"]),
    )
