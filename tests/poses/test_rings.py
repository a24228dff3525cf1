"""The cheapest ring through layers of positions, and the estimates of its moves."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from energy_opt.front.given import source_model
from energy_opt.front.models import rivals_from
from energy_opt.motion.judge.energy import Scorer
from energy_opt.poses.estimate import curves
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.sets import Ring, layer


def test_the_ring_is_the_cheapest_of_all(ur: ToolKinematics) -> None:
    """Against all combinations, at the price of waiting."""
    scorer = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot)[0][0].model)]
    rng = np.random.default_rng(1)
    sizes = ((3, 0.5), (2, 0.0), (3, 1.0))
    layers = [replace(layer(scorer, rng.uniform(-1, 1, (count, 6))), wait=wait) for count, wait in sizes]
    ring = Ring(ur, layers, [scorer] * 3, [(0.0, np.inf)] * 3)
    chosen, energy = ring.cheapest(1e3, 0.0)

    def cost(picked: tuple[int, ...]) -> float:
        q = [each.positions[k] for each, k in zip(layers, picked, strict=True)]
        moves = sum(curves(scorer, q[k][None], q[(k + 1) % 3][None]).cheapest()[0][0] for k in range(3))
        return moves + sum(each.wait * each.standing[k] for each, k in zip(layers, picked, strict=True))

    costs = {picked: cost(picked) for picked in product(range(3), range(2), range(3))}
    assert tuple(chosen) == min(costs, key=lambda picked: costs[picked])
    assert energy == pytest.approx(min(costs.values()))


@pytest.mark.parametrize(("farther", "detour", "taken"), [(1.02, 0.1, 1), (1.5, 0.1, 0), (1.5, 1e4, 1)])
def test_a_move_in_contact_costs_a_detour(ur: ToolKinematics, farther: float, detour: float, taken: int) -> None:
    """Of two places, the nearer one is reached only past a body."""
    scorer = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot)[0][0].model)]
    away = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # a turn about the vertical: no gravity
    places = np.vstack([away, -farther * away])
    ring = Ring(ur, [layer(scorer, np.zeros((1, 6))), layer(scorer, places)], [scorer] * 2, [(0.0, np.inf)] * 2)

    def free(move: int, start: np.ndarray, goal: np.ndarray) -> bool:
        return bool(start[0] + goal[0] <= 0)

    assert ring.cheapest(3.0, 0.0, free, detour)[0] == [0, taken]


@pytest.mark.parametrize("seconds", [1e3, 0.1])
def test_a_ring_with_a_move_that_takes_too_long_comes_after_all_others(ur: ToolKinematics, seconds: float) -> None:
    """In little time its estimate was far below zero, so that `place` began at the placements that are impossible."""
    scorer = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot)[0][0].model)]
    near, far, quick = np.zeros((1, 6)), np.full((1, 6), 4.0), np.full((1, 6), 0.3)
    bounds = [(0.0, 0.5), (0.0, np.inf)]

    def ring(*second: np.ndarray) -> tuple[list[int], float]:
        return Ring(ur, [layer(scorer, near), layer(scorer, np.vstack(second))], [scorer] * 2, bounds).cheapest(
            seconds, 0.0
        )

    assert ring(far)[1] > 1e9
    assert ring(far, quick)[0] == [0, 1] and ring(far, quick)[1] == pytest.approx(ring(quick)[1], abs=0.1)


def test_an_estimate_does_not_fall_as_a_free_turn_nears_its_velocity_limit(ur: ToolKinematics) -> None:
    """Gravity gives energy back here; what it gives back grew with the turn of a joint that carries nothing."""
    scorer = [Scorer(ur.robot, source_model(ur.robot))]
    start = np.array([[-0.339, 1.016, -1.881, 2.436, 1.571, 0.0]])
    goals = np.array([[-0.529, 2.316, 1.926, 0.471, -1.571, turn] for turn in (0.0, 2.4, 3.8, 4.05)])
    energy = [curves(scorer, start, goal[None]).at(np.array([[1.5]]))[0, 0] for goal in goals]
    assert np.min(energy[1:]) > energy[0] - 0.01, energy
