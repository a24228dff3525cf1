"""Functions over many points: right in every block, and nobody writes into another's memory."""

import threading

import casadi as ca
import numpy as np
import pytest

from energy_opt.effects import Regeneration
from energy_opt.motion import Move, Planner, Settings
from energy_opt.numerics import native
from energy_opt.numerics.batch import BLOCK, Batch
from energy_opt.numerics.vectors import program_of


@pytest.fixture(params=["with a compiler", "without"], autouse=True)
def compiler(request, monkeypatch):
    if request.param == "without":
        monkeypatch.setattr(native, "library", lambda part: None)


def test_every_block_and_every_owner():
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p")
    function = ca.Function("f", [x, p], [ca.sum1(x) * p, x**2])
    rng = np.random.default_rng(0)
    for count in (1, 7, BLOCK, BLOCK + 1, 3 * BLOCK - 5):
        points = rng.normal(size=(count, 3))
        total, square = Batch(function, count)(points, 2.0)
        assert np.allclose(total[:, 0], 2 * points.sum(axis=1), rtol=1e-14)
        assert np.array_equal(square, points**2) and square.shape == (count, 3)
    first, second = Batch(function, 5), Batch(function, 5)
    kept = first(np.ones((5, 3)), 1.0)
    second(np.zeros((5, 3)), 1.0)
    assert (kept[0] == 3).all()


def test_a_function_without_results():
    """The kinks of a law that has none: `optimize --mode retime` under Coulomb friction ended with an IndexError."""
    x = ca.SX.sym("x", 3)
    (found,) = Batch(ca.Function("f", [x], [ca.SX(0, 1)]), BLOCK)(np.ones((BLOCK, 3)))
    assert found.shape == (BLOCK, 0)


def test_many_points_have_the_values_of_casadi_itself():
    """Blocks of points are evaluated instruction by instruction, in C or NumPy: every kind that effects may use."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    a, b, c = x[0], x[1], x[2]
    terms = [
        a + b, a - 2, 3 * c, a / (b + 5), -a, a**2, 1 / (a + 7), ca.sqrt(b + 9), (a + 6) ** b, (a + 6) ** 1.7, 2 * a,
        ca.exp(a), ca.log(b + 8), ca.expm1(a), ca.log1p(a + 6), ca.sin(a), ca.cos(a), ca.tan(a), ca.asin(a / 9),
        ca.acos(a / 9), ca.atan(a), ca.atan2(a, b), ca.sinh(a), ca.cosh(a), ca.tanh(a), ca.asinh(a), ca.acosh(a + 9),
        ca.atanh(a / 9), ca.hypot(a, b), ca.fabs(a), ca.sign(a), ca.sign(c * 0), ca.copysign(a, b), ca.floor(a),
        ca.ceil(a), ca.fmod(a, b), ca.fmin(a, b), ca.fmax(a, b), a < b, a <= b, ca.floor(a) == ca.floor(b), a != b,
        ca.logic_not(a < 0), ca.logic_and(a < 0, b < 0), ca.logic_or(a < 0, b < 0), ca.if_else(a < b, ca.sin(c), y),
        ca.SX(4.5), y,
    ]  # fmt: skip
    points = np.random.default_rng(3).normal(size=(5000, 3))
    points[:5] = 0.0
    for term in [*terms, ca.erf(a)]:
        function = ca.Function("f", [x, y], [ca.densify(term), x * y])
        assert (program_of(function) is None) == term.is_op(ca.OP_ERF), term
        value, product = Batch(function, len(points))(points, np.full((1, 1), -1.5))
        truth = function.map(len(points))(points.T, np.full((1, len(points)), -1.5))
        assert np.allclose(value, np.array(truth[0]).T, rtol=1e-13, atol=1e-15, equal_nan=True), term
        assert np.array_equal(product, -1.5 * points)
    one = ca.Function("f", [x, y], [ca.vertcat(*map(ca.densify, terms))])
    assert program_of(one) is not None
    value, truth = Batch(one, len(points))(points, -1.5)[0], one.map(len(points))(points.T, np.full((1, 5000), -1.5))
    assert np.allclose(value, np.array(truth).T, rtol=1e-13, atol=1e-15, equal_nan=True)


def test_planners_side_by_side(panda, model):
    """Two threads, the same robot and model: buffers shared between them crashed the process."""
    start = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
    clamped = model.replaced(Regeneration(efficiency=0.0, level="bus"))
    moves = [
        Move(start, start + 0.4, mode, duration=d) for d, mode in ((1.0, "retime"), (1.3, "retime"), (1.0, "reshape"))
    ]
    together = threading.Barrier(2)

    def work(answers):
        planner = Planner(panda, clamped, Settings(starts=1, controls=16, compile="never"))
        together.wait()
        answers += [planner.solve(move).energy.total for move in moves]

    alone, both = [], ([], [])
    threads = [threading.Thread(target=work, args=(answers,)) for answers in both]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    planner = Planner(panda, clamped, Settings(starts=1, controls=16, compile="never"))
    alone = [planner.solve(move).energy.total for move in moves]
    assert both[0] == both[1] == alone
