"""The optimizer's answer: a trajectory, its energy and that of baselines, and the judge's certificate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from html import escape
from operator import itemgetter

from energy_opt.errors import BadInput, suggest
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.trajectory import Filled
from energy_opt.power.assumptions import Assumption
from energy_opt.reports.words import INVALID, first_path_words, limits_words, of_models


@dataclass(frozen=True, eq=False)
class Baseline:
    """Another trajectory of the same move, judged in the same way.

    Attributes:
        max_violation: largest excess over a limit, as a share of its bound; below 0 inside.
        valid: inside all limits, and clear of bodies.
        peak_power: of the whole arm [W].
        remark: why it is not valid although it is inside all limits under the first of several models.
    """

    name: str
    trajectory: Filled
    energy: Energy
    max_violation: float
    valid: bool
    peak_power: float | None = None
    remark: str = ""

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.trajectory.duration

    @property
    def marked(self) -> str:
        """The name, with a star if it is not valid."""
        return self.name if self.valid else f"{self.name}*"

    def document(self) -> dict[str, object]:
        """As result.json has it."""
        return {
            "name": self.name,
            "duration": self.duration,
            "energy": self.energy.document(),
            "max_violation": self.max_violation,
            "valid": self.valid,
            "peak_power": self.peak_power,
        }


@dataclass(frozen=True)
class Optimality:
    """The proven quality of the answer; "global" if a proven lower bound [J] is near (gap in % of the total).

    What is proven: no timing of this path whose squared speed is a quadratic spline on the program's grid, and which
    holds the limits (less a margin of 5e-7) at the grid's points, takes less than `lower_bound` by the grid's
    quadrature, with dry friction against the motion wherever the path moves a joint, however slowly. Timings off the
    grid and other paths are not covered.
    """

    kind: str
    lower_bound: float | None = None
    gap_percent: float | None = None

    def document(self) -> dict[str, object]:
        """As result.json has it."""
        return asdict(self)


@dataclass(frozen=True)
class FirstPath:
    """The source of a move's first path: "straight", "given", "own" or "ompl"; and the time to find it [s].

    `blocked`: the reason why it is not free, if it is not.
    """

    source: str
    seconds: float = 0.0
    blocked: str = ""

    def document(self) -> dict[str, object]:
        """As result.json has it."""
        return {"source": self.source, "seconds": self.seconds}


@dataclass(frozen=True)
class SolverReport:
    """The solver and its effort: iterations, time [s] to build functions and to solve, starts of a reshaping."""

    name: str
    iterations: int
    build_seconds: float
    solve_seconds: float
    compiled: bool = False
    starts: int = 0

    def whole(self, seconds: float, build_seconds: float = 0.0) -> SolverReport:
        """The report of a solve that took so many `seconds` in all, with a first path and a choice among answers."""
        build = max(self.build_seconds, build_seconds)
        return replace(self, build_seconds=build, solve_seconds=seconds - build)


BASELINES = ("toppra", "scaled", "input")
ROUNDING = 1e-9  # share of an energy by which its parts may differ by rounding alone


class Saving(dict[str, float | None]):
    """Percent of the total, percent of the loss, and joules: `saving.joules` is `saving["joules"]`."""

    total_percent = property(itemgetter("total_percent"))
    loss_percent = property(itemgetter("loss_percent"))
    joules = property(itemgetter("joules"))


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """A solved move.

    Attributes:
        status: "solved", or "not_converged" if a solver gave up or was interrupted: then the trajectory is the best
            known feasible one, and `message` says why.
        chosen: the source of the trajectory: "reshape", "retime", or the name of a baseline if nothing is better.
        trajectory: with effort [N m] and power [W].
        energy: total, standby, stored and loss [J], and the total by effect; under the (first) model.
        baselines: other timings of the first path, with their energies: "toppra", "scaled" and, if given, "input".
        certificate: how much of each limit is used, and the clearance; recomputed from the samples.
        optimality: a lower bound [J], if there is one. solver: its name, iterations and times [s].
        first_path: the source of the path that it starts from.
        moves: data of the standard moves that it consists of; None for a free trajectory.
        models: its energies under each of several models: name, total and loss [J], share of the loss saved [%].
        robust: what was minimised if it is not `energy.total` but the "mean" or "worst" (`kind`) of the models'
            totals, its value (`total`) [J], that of the `baselines` by name, and a bound below it (`lower_bound`) or
            None; the gap in `optimality` is between `total` and this bound.
        assumptions: assumed values that were not given, with their source.
        break_even_friction: share of the effort limits at which dry friction, added to the model, ends the saving
            against "scaled"; None if no share below 0.2 does.
        travel: joints that travel more than 1.5 times the distance from start to goal: joint, path, straight [rad, m].
        written: files for controllers, read back and judged: file, format, rate, valid, worst; a saved result.json
            also lists trajectory.csv and trajectory.yaml.
        progress: seconds since the search began, and the least loss [J] of a proven answer until then.
    """

    status: str
    robot: str
    mode: str
    chosen: str
    trajectory: Filled
    energy: Energy
    baselines: tuple[Baseline, ...]
    certificate: Certificate
    optimality: Optimality
    solver: SolverReport
    message: str = ""
    interrupted: bool = False
    warnings: tuple[str, ...] = field(default=())
    moves: Mapping[str, object] | None = None
    models: tuple[Mapping[str, object], ...] = ()
    robust: Mapping[str, object] | None = None
    first_path: FirstPath | None = None
    assumptions: tuple[Assumption, ...] = ()
    break_even_friction: float | None = None
    travel: tuple[Mapping[str, object], ...] = ()
    written: tuple[Mapping[str, object], ...] = ()
    progress: tuple[tuple[float, float], ...] = ()

    def baseline(self, name: str) -> Baseline | None:
        """The baseline "toppra", "scaled" or "input"; None where the first path has no timing, or no input was given.

        Raises:
            BadInput: another name.
        """
        if name not in BASELINES:
            raise BadInput(f"no baseline {name!r}; baselines are {', '.join(BASELINES)}{suggest(str(name), BASELINES)}")
        return next((b for b in self.baselines if b.name == name), None)

    @property
    def duration(self) -> float:
        """Of the trajectory, s."""
        return self.trajectory.duration

    @property
    def saving(self) -> Saving | None:
        """Against "scaled", which has the same duration: percent of its total, percent of its loss, and joules.

        None if there is no such baseline within limits. A percentage is None if its base is only rounding error, as in
        a model without losses.
        """
        baseline = self.baseline("scaled")
        if baseline is None or not baseline.valid:
            return None
        scaled = baseline.energy
        joules = scaled.total - self.energy.total
        rounding = ROUNDING * max(scaled.standby, abs(scaled.stored), abs(scaled.total))

        def percent(part: float, whole: float) -> float | None:
            return 100 * part / whole if whole > rounding else None

        return Saving(
            total_percent=percent(joules, scaled.total),
            loss_percent=percent(scaled.loss - self.energy.loss, scaled.loss),
            joules=joules,
        )

    @property
    def saved(self) -> str:
        """The saving at equal duration, in words."""
        saving = self.saving
        if saving is None:
            fastest, own = self.baseline("toppra"), f"{self.duration:.4g} s"
            path = first_path_words(None if self.first_path is None else self.first_path.source)
            if fastest is None:
                return f"no saving is stated: no timing of the {path} keeps the limits, so there is none to slow evenly"
            if fastest.duration <= self.duration:
                return "no saving is stated: the evenly slowed move breaks a limit or touches something"
            return (
                f"no saving is stated: this move takes {own}, the {path} at least {fastest.duration:.4g} s, so it "
                f"cannot be compared at {own}"
            )
        shares = (saving["total_percent"], saving["loss_percent"])
        total, loss = ("-" if share is None else f"{share:.2f} %" for share in shares)
        return f"saved at equal duration: {saving['joules']:.3f} J, {total} of the total, {loss} of the loss"

    @property
    def bound(self) -> str:
        """The lower bound in J, with its meaning if it is not of the energy itself; empty without one."""
        known = self.optimality.lower_bound if self.robust is None else self.robust["lower_bound"]
        return "" if known is None else f"{known:.6f} J{of_models(self.robust)}"

    def __repr__(self) -> str:
        e = self.energy
        return (
            f"{type(self).__name__}({self.status!r}, {self.robot!r}, {self.mode!r}, {self.duration:.4g} s, "
            f"{e.total:.5g} J, loss {e.loss:.4g} J)"
        )

    def __str__(self) -> str:
        e, known = self.energy, self.optimality
        proof = "a local optimum; no bound"
        if self.bound:
            proof = f"lower bound {self.bound}, gap {known.gap_percent:.2g} %"
        reason = f"; {self.message}" if self.message else ""
        unchecked = "" if self.certificate.clearance is not None else "; collisions are not checked"
        return "\n".join(
            [
                f"{self.robot}, {self.mode}, {self.duration:.4g} s: {self.status}{reason}",
                f"energy {e.total:.5g} J = standby {e.standby:.5g} + stored {e.stored:.5g} + loss {e.loss:.5g}",
                self.saved,
                limits_words(self.certificate.document(), lambda *_: "(SI units)") + unchecked,
                f"{proof}; {self.solver.iterations} iterations, {self.solver.solve_seconds:.3g} s",
            ]
        )

    def _repr_html_(self) -> str:
        head = ["", *("this move", *(b.marked for b in self.baselines))]
        energies = [self.energy, *(b.energy for b in self.baselines)]
        table = [
            [part, *(f"{getattr(e, part):.5g}" for e in energies)] for part in ("total", "standby", "stored", "loss")
        ]
        cells = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in table)
        title = "".join(f"<th>{escape(c)}</th>" for c in head)
        lines = "<br>".join(escape(line) for line in str(self).splitlines())
        note = "" if all(b.valid for b in self.baselines) else f"<p>{INVALID}</p>"
        return f"<p>{lines}</p><table><caption>energy [J]</caption><tr>{title}</tr>{cells}</table>{note}"

    def document(self) -> dict[str, object]:
        """The content of result.json."""
        return {
            "status": self.status,
            "robot": self.robot,
            "joints": list(self.trajectory.joints),
            "mode": self.mode,
            "duration": self.duration,
            "energy": self.energy.document(),
            "baselines": [b.document() for b in self.baselines],
            "saving": self.saving,
            **({"remark": self.saved} if self.saving is None else {}),
            "certificate": self.certificate.document(),
            "first_path": None if self.first_path is None else self.first_path.document(),
            "peak_power": self.certificate.peak_power,
            "optimality": self.optimality.document(),
            "solver": asdict(self.solver),
            "chosen": self.chosen,
            "models": [dict(row) for row in self.models],
            **({} if self.robust is None else {"robust": dict(self.robust)}),
            "assumptions": [asdict(row) for row in self.assumptions],
            "break_even_friction": self.break_even_friction,
            "travel": [dict(row) for row in self.travel],
            "written": [dict(row) for row in self.written],
            "progress": [{"seconds": seconds, "loss": loss} for seconds, loss in self.progress],
            "message": self.message,
            "warnings": list(self.warnings),
            **({} if self.moves is None else {"moves": self.moves}),
        }
