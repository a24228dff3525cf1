"""Files of a plan for controllers: `--write`, `--rate`, `--as moves`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.errors import BadInput, Infeasible
from energy_opt.requests.groups import WriteGroup
from energy_opt.requests.moves import OptimizeRequest

if TYPE_CHECKING:
    from energy_opt.formats import Format
    from energy_opt.formats.controller_files import Written
    from energy_opt.formats.judging import Judging
    from energy_opt.motion import Move, Planner, Result
    from energy_opt.motion.plan.robust import RobustPlanner
    from energy_opt.profiles import StandardMoves
    from energy_opt.robot import Robot

ROOM = 1.001  # factor on the shortest duration of standard moves, which leaves no choice


def check_written(request: WriteGroup, robot: Robot) -> list[Format]:
    """The formats of --write for an arm; impossible requests are refused before any work."""
    from energy_opt.formats.controller_files import wanted

    check_rate_of(request)
    sliding = [joint for joint, slides in zip(robot.joints, robot.slides, strict=True) if slides]
    for name in PROGRAMS:
        if name in request.write and sliding:
            raise BadInput(f"--write {name}: {sliding[0]} slides; expected an arm whose joints all turn")
    return wanted(request.write, robot.n)


def check_rate_of(request: WriteGroup) -> None:
    """Refuse an impossible rate, or a rate without files."""
    from energy_opt.formats.resample import check_rate

    if request.rate is not None:
        if not request.write:
            raise BadInput(f"--rate {request.rate:g}: belongs to --write; give --write FORMAT, too")
        check_rate(request.rate)


PROGRAMS = "urscript", "franka"  # formats of one maker's arms, with positions in rad


@dataclass(frozen=True)
class Controllers:
    """Writes a plan for controllers, as a request asks for it.

    Attributes:
        request: the formats, the rate and the standard moves. planner: under the model that results are stated under.
            robust: plans under several models; None: `planner` does.
    """

    request: OptimizeRequest
    planner: Planner
    robust: RobustPlanner | None

    @property
    def solver(self) -> Planner | RobustPlanner:
        """The planner that is used: that of several models, or of one."""
        return self.planner if self.robust is None else self.robust

    def moves(self, move: Move, result: Result) -> tuple[Result, StandardMoves | None]:
        """The result with the standard moves of --as, and these moves. Without --as: the result itself, and None.

        If the duration is free and standard moves need longer than the free trajectory, everything is planned again for
        the longer duration.
        """
        if self.request.standard is None or result.interrupted:
            return result, None
        try:
            return self._standard(move, result)
        except Infeasible as error:
            if move.duration is not None or error.shortest_duration is None:
                raise
            longer = ROOM * error.shortest_duration
            if move.max_duration is not None and longer > move.max_duration:
                raise
        slower = replace(move, duration=longer, max_duration=None)
        return self._standard(slower, self.solver.solve(slower))

    def _standard(self, move: Move, result: Result) -> tuple[Result, StandardMoves | None]:
        """The result with the standard moves in its place, in the same time."""
        from energy_opt.profiles import standard_moves

        return standard_moves(self.planner, self.robust, move, result, self.request.vias or 0)

    def with_duration(self, move: Move, error: Infeasible) -> Infeasible:
        """The error with a shortest duration [s] that also works for the standard moves that --as asks for.

        The duration that an error names is that of a free trajectory; standard moves may need more.
        """
        if self.request.standard is None or move.duration is None or error.shortest_duration is None:
            return error
        slower = replace(move, duration=error.shortest_duration)
        try:
            self._standard(slower, self.solver.solve(slower))
        except Infeasible as fault:
            return error.with_shortest_duration(
                None if fault.shortest_duration is None else ROOM * fault.shortest_duration
            )
        return error

    def with_room(self, move: Move, result: Result, moves: StandardMoves | None) -> tuple[Result, StandardMoves | None]:
        """The result and its standard moves; planned again with smaller bounds if samples of --write break limits.

        Args:
            move: as solved. result: the plan. moves: standard moves that replace it, if any.
        """
        from energy_opt.formats.controller_files import Shares, certificates, said, wanted, with_room

        if result.interrupted or result.status != "solved":
            return result, moves
        judge = self.judge(move)
        formats = [form for form in wanted(self.request.write) if moves is None or form.name != "urscript"]

        def again(shares: Shares) -> tuple[Result, StandardMoves | None]:
            several = None if self.robust is None else self.robust.within(shares)
            narrow = replace(self, planner=self.planner.within(shares), robust=several)
            return narrow.moves(move, narrow.solver.solve(move))

        (found, chosen), shares = with_room(
            (result, moves),
            lambda answer: certificates(answer[0].trajectory, judge, formats, self.request.rate),
            again,
        )
        if not shares or found.status != "solved":
            return result, moves
        found = self.planner.with_trajectory(found, move, found.trajectory)
        found = found if self.robust is None else self.robust.solve_by(lambda _: found)
        return replace(found, message=said(shares, found.energy.total - result.energy.total)), chosen

    def judge(self, move: Move) -> Judging:
        """The judge of a move's files."""
        from energy_opt.formats.judging import Judging
        from energy_opt.motion.judge.energy import Scorer

        planner = self.planner
        limits = (planner if self.robust is None else self.robust.planner).limits(move)
        scorer, all_ = Scorer(planner.robot, planner.model), None if self.robust is None else self.robust.planner.scorer
        return Judging(scorer, limits, planner.cell, planner.settings.verify_samples, all_)

    def write(self, move: Move, moves: StandardMoves | None, result: Result, out: Path) -> list[Written]:
        """Write the files of --write and --as into `out`, and read each back and judge it.

        Args:
            move: as solved. moves: its standard moves, if any. result: the plan. out: a folder.
        """
        from energy_opt.formats import FORMATS, controller_files
        from energy_opt.formats.controller_program import in_tool, load_of
        from energy_opt.profiles import movej

        judge, robot, request = self.judge(move), self.planner.robot, self.request
        formats, records = controller_files.wanted(request.write), []
        if moves is not None:
            scripts = FORMATS["urscript"] in formats
            records += movej.write(moves, robot, judge, out, ["moves.yaml", *(["trajectory.script"] * scripts)])
            formats = [form for form in formats if form.name != "urscript"]
        payload = in_tool(robot, load_of(self.planner.model))
        return records + controller_files.write(
            result.trajectory, judge, formats, out, request.rate, request.joint_prefix, payload
        )


def kept_words(moves: StandardMoves) -> str:
    """Message on the share of a free trajectory's saving that standard moves keep."""
    kept = "nothing to save" if moves.kept is None else f"{100 * moves.kept:.1f} % of the free trajectory's saving"
    return f"standard moves ({moves.kind}, via points: {moves.vias}) keep {kept}"
