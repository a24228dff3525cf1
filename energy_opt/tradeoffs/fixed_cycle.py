"""The fixed cycle: an arm that arrives early waits at the goal, and waiting costs energy.

With E(d) the energy of the move in duration d and T the cycle,

    C(d) = E(d) + integral from d to T of the power that holds the goal,

so the best d balances a slower move (less loss) against a shorter wait. The free optimum, which minimises E alone, pays
standby only while it moves and is often the opposite answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.effects import Standby
from energy_opt.errors import BadInput
from energy_opt.motion.judge.energy import Past, Scorer
from energy_opt.motion.trajectory import standing
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


@dataclass(frozen=True)
class Waiting:
    """Energy while waiting, J: the overhead (or the idle power in its place), and the energy to hold the goal."""

    standby: float
    holding: float

    @property
    def total(self) -> float:
        """Total energy of the wait, J."""
        return self.standby + self.holding


class Cycle:
    """A cycle of `length` s that begins with the move and ends with a wait at its goal."""

    def __init__(
        self, robot: Robot, model: PowerModel, goal: np.ndarray, length: float, idle_power: float | None = None
    ) -> None:
        """For a move that ends at rest at `goal` (n,) [rad].

        Args:
            idle_power: overhead while waiting [W], in place of the model's standby.

        Raises:
            BadInput: a length that is not above zero, a negative idle power.
        """
        if not 0 < length < np.inf:
            raise BadInput(f"--cycle {length:g}: expected a duration above 0 s")
        if idle_power is not None:
            if not 0 <= idle_power < np.inf:
                raise BadInput(f"--idle-power {idle_power:g}: expected 0 W or more")
            model = model.kept(lambda effect: not effect.overhead).replaced(Standby(power=idle_power))
        self.length, self.idle_power = length, idle_power
        self._goal = np.asarray(goal, dtype=float)
        self._scorer = Scorer(robot, model)

    def under(self, model: PowerModel) -> Cycle:
        """The same cycle under another model."""
        return Cycle(self._scorer.robot, model, self._goal, self.length, self.idle_power)

    def waiting(self, duration: float) -> Waiting:
        """Energy of the wait after a move of `duration` s."""
        span = self.length - duration
        if span <= 0:
            return Waiting(0.0, 0.0)
        still = standing(self._scorer.robot.joints, self._goal, span)
        energy, _ = self._scorer.energy_after(Past(duration, idle=0.0), still)
        return Waiting(energy.standby, energy.total - energy.standby)
