"""What the optimizer answers: a trajectory, its energy beside that of baselines, and the judge's certificate."""

from __future__ import annotations

from dataclasses import dataclass, field

from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Baseline:
    """Another trajectory of the same move, judged in the same way; `valid` where it is inside all limits."""

    name: str
    trajectory: Trajectory
    energy: Energy
    max_violation: float
    valid: bool

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.trajectory.duration

    def document(self) -> dict[str, object]:
        """As it stands in result.json."""
        return {
            "name": self.name,
            "duration": self.duration,
            "energy": self.energy.document(),
            "max_violation": self.max_violation,
            "valid": self.valid,
        }


@dataclass(frozen=True)
class Optimality:
    """How good the answer is known to be; "global" where a proven lower bound [J] is near (gap in % of the total)."""

    kind: str
    lower_bound: float | None = None
    gap_percent: float | None = None

    def document(self) -> dict[str, object]:
        """As it stands in result.json."""
        return {"kind": self.kind, "lower_bound": self.lower_bound, "gap_percent": self.gap_percent}


@dataclass(frozen=True)
class SolverReport:
    """Which solver, how much work; `starts` are those of a reshaping."""

    name: str
    iterations: int
    build_seconds: float
    solve_seconds: float
    compiled: bool = False
    starts: int = 0


ROUNDING = 1e-9  # share of an energy that its parts may miss by rounding alone


@dataclass(frozen=True)
class Result:
    """A solved move.

    Attributes:
        status: "solved", or "not_converged" where a solver gave up or was interrupted: then the trajectory is the best
            feasible one that is known, and `message` says why.
        chosen: where the trajectory comes from: "reshape", "retime", or the name of a baseline that nothing surpassed.
        trajectory: with effort and power.
    """

    status: str
    robot: str
    mode: str
    chosen: str
    trajectory: Trajectory
    energy: Energy
    baselines: tuple[Baseline, ...]
    certificate: Certificate
    optimality: Optimality
    solver: SolverReport
    message: str = ""
    interrupted: bool = False
    warnings: tuple[str, ...] = field(default=())

    def baseline(self, name: str) -> Baseline | None:
        """The baseline of that name; "toppra" and "scaled" are None where the first path has no timing."""
        return next((b for b in self.baselines if b.name == name), None)

    @property
    def saving(self) -> dict[str, float | None] | None:
        """Against "scaled", which has the same duration: percent of its total, percent of its loss, and joules.

        None where there is no such baseline within limits. A percentage of nothing is None, too: a model without losses
        leaves only rounding there.
        """
        baseline = self.baseline("scaled")
        if baseline is None or not baseline.valid:
            return None
        scaled = baseline.energy
        joules = scaled.total - self.energy.total
        rounding = ROUNDING * max(scaled.standby, abs(scaled.stored), abs(scaled.total))

        def percent(part: float, whole: float) -> float | None:
            return 100 * part / whole if whole > rounding else None

        return {
            "total_percent": percent(joules, scaled.total),
            "loss_percent": percent(scaled.loss - self.energy.loss, scaled.loss),
            "joules": joules,
        }

    def document(self) -> dict[str, object]:
        """result.json."""
        return {
            "status": self.status,
            "robot": self.robot,
            "joints": list(self.trajectory.joints),
            "mode": self.mode,
            "duration": self.trajectory.duration,
            "energy": self.energy.document(),
            "baselines": [b.document() for b in self.baselines],
            "saving": self.saving,
            "certificate": self.certificate.document(),
            "optimality": self.optimality.document(),
            "solver": {
                "name": self.solver.name,
                "iterations": self.solver.iterations,
                "build_seconds": self.solver.build_seconds,
                "solve_seconds": self.solver.solve_seconds,
                "compiled": self.solver.compiled,
                "starts": self.solver.starts,
            },
            "chosen": self.chosen,
            "message": self.message,
            "warnings": list(self.warnings),
        }
