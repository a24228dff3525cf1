"""A cell's arms in an arrangement of their steps, as a scheduling problem; and what each lever saves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

from energy_opt.errors import Infeasible
from energy_opt.schedule import Exclusion, Problem, Ring, Schedule, solve
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.arrange import arrangements, cheapest, listed
from energy_opt.workcell.curves import problem_of, ring_of
from energy_opt.workcell.file import WorkCell, groups_of
from energy_opt.workcell.levers import Levers, pull, with_lever


class Stage:
    """A cell's arms, and the times at which they may not meet.

    Args:
        arms: by robot; None for a robot that is known by its curves alone.
    """

    def __init__(
        self,
        cell: WorkCell,
        arms: Sequence[Arm | None],
        seconds: float,
        progress: Callable[[str, float], None],
        stopped: Callable[[], bool],
    ) -> None:
        self.cell, self.arms, self.seconds = cell, tuple(arms), seconds
        self.progress, self.stopped = progress, stopped
        self.plain = self.arms  # in the order of the file, as far as `after` allows it
        self.exclusions: dict[tuple[int, int, int, int], Exclusion] = {}

    @property
    def moving(self) -> bool:
        """Is any arm known, not by its curves alone?"""
        return any(arm is not None for arm in self.arms)

    def arranged(self) -> Levers:
        """What each lever saves with evenly slowed moves; the arms take the arrangement of steps that costs least.

        Raises:
            Infeasible: no schedule keeps cycle time, lags and zones.
        """
        given = self.arms
        self.arms = tuple(None if arm is None else listed(arm) for arm in given)
        self.plain = self.arms
        for k, arm in enumerate(self.arms):
            if arm is not None:
                self.progress(f"{arm.name}: evenly slowed", 0.1 * k / len(self.arms))
                arm.slow()
        found: Levers | None = None
        fault: Infeasible | None = None
        try:
            found = pull(self.problem(False).as_listed, seconds=self.seconds)
        except Infeasible as error:
            fault = error
        self.progress("poses to wait in", 0.12)
        better = self._cheapest(given, False)
        if better is not None:
            found = with_lever(found, "modes", better)
        if any(groups_of(robot) for robot in self.cell.robot):
            self.progress("orders of steps", 0.15)
            better = self._cheapest(given, True)
            if better is not None:
                found = with_lever(found, "order", better)
        if found is None:
            raise fault or Infeasible("no order of the steps keeps the cycle time", limit="duration")
        return found

    def _cheapest(self, given: Sequence[Arm | None], orders: bool) -> Schedule | None:
        """The schedule of the best arrangement, where there is more than one; the arms take it."""
        choices = [[] if arm is None else arrangements(arm, orders, self.stopped) for arm in given]
        if not orders and all(len(choice) < 2 for choice in choices):
            return None

        def problem(arms: Sequence[Arm | None]) -> Problem:
            out = self.problem(False, arms=arms)
            return out if orders else out.as_listed

        if not self.moving:
            with suppress(Infeasible):
                return solve(problem(given), seconds=self.seconds)
        found = cheapest(given, choices, problem)
        if found is None:
            return None
        self.arms = found[0]
        return found[1]

    def problem(
        self,
        optimized: bool,
        hold: Sequence[dict[int, float] | None] | None = None,
        arms: Sequence[Arm | None] | None = None,
        lossless: bool = False,
        anywhere: bool = False,
    ) -> Problem:
        """The scheduling problem with all that is known now; `anywhere`: but for the times that keep arms apart."""
        rings: dict[str, Ring] = {}
        for k, (robot, arm) in enumerate(zip(self.cell.robot, self.arms if arms is None else arms, strict=True)):
            held = None if hold is None else hold[k]
            rings[robot.name] = ring_of(self.cell, robot) if arm is None else arm.ring(optimized, held, lossless)
        return problem_of(self.cell, rings, () if anywhere else tuple(self.exclusions.values()))

    def bound(self, lossless: bool) -> float:
        """J that no schedule of these curves goes below, wherever the arms are and whatever supply they share.

        Args:
            lossless: a supply that loses nothing; else each robot has its own, which loses all that is braked.
        """
        return solve(self.problem(True, lossless=lossless, anywhere=True), seconds=self.seconds).bound
