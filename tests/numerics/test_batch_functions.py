"""Functions over many points: right in every block, and nobody writes into another's memory."""

import threading

import casadi as ca
import numpy as np

from energy_opt.effects import Regeneration
from energy_opt.motion import Move, Planner, Settings
from energy_opt.numerics.batch import BLOCK, Batch


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
