"""Reshaping at one level of detail: the problems of one shape, and what curves of it cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.motion.limits.base import Limit, values_of
from energy_opt.motion.reshape.curve import Curve
from energy_opt.motion.reshape.evaluation import OpenGoal
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics.batch import Batch


class Level:
    """All problems of one shape."""

    def __init__(self, shape: Shape, nodes: NodeFunctions) -> None:
        self.shape, self._nodes = shape, nodes
        self._value = Batch(nodes.value, len(shape.grid[0]))

    def model(
        self, ends: Ends, limits: Sequence[Limit], parameters: np.ndarray, durations: tuple[float, float],
        offset: float, width: float = 1.0, goal: OpenGoal | None = None,
    ) -> Model:  # fmt: skip
        """The problem for sequential quadratic programming."""
        return Model(self.shape, self._nodes, ends, limits, parameters, durations, offset, width, goal)

    def shares(
        self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit], width: float = 1.0
    ) -> tuple[float, dict[int, np.ndarray]]:
        """Cost, and the share of its bound that each limit uses at every place, (sites or nodes, columns) by number."""
        s = self.shape
        u, w = s.grid
        q = [m @ curve.points for m in s.matrices[:3]]
        z = np.hstack([*q, np.full((len(u), 1), curve.duration)])
        rate, limited = self._value(z, u[:, None], np.concatenate([parameters, values_of(limits, width)]))
        shares, used = {}, 0
        for number, limit in enumerate(limits):
            if limit.order:
                moved = s.sites[limit.order - 1] @ curve.points
                shares[number] = np.abs(moved) / curve.duration**limit.order / limit.bound
            if limit.scale.size:
                values = limited[:, used : used + limit.scale.size]
                shares[number] = (values if limit.one_sided else np.abs(values)) / limit.scale
                used += limit.scale.size
        return float(w @ rate[:, 0]), shares

    def standing(self, q: np.ndarray, duration: float, parameters: np.ndarray, limits: Sequence[Limit]) -> np.ndarray:
        """What standing at each of q (M, n) costs, by the second (M,)."""
        count, rates = len(self.shape.grid[0]), []
        values, z = np.concatenate([parameters, values_of(limits)]), np.zeros((count, 3 * self.shape.joints + 1))
        z[:, -1] = duration
        for first in range(0, len(q), count):
            block = q[first : first + count]
            z[: len(block), : self.shape.joints] = block
            rates.append(self._value(z, np.full((count, 1), 0.5), values)[0][: len(block), 0] / duration)
        return np.concatenate(rates)

    def excess(self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit]) -> tuple[float, float]:
        """Cost, and the worst excess over a limit; planes between bodies aside, as they are no limit of their own."""
        cost, shares = self.shares(curve, parameters, limits)
        placed = [limit.excess_at(self.shape.matrices[0] @ curve.points) for limit in limits]
        return cost, max([float(share.max()) - 1 for share in shares.values()] + placed)
