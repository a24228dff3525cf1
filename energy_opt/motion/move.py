"""The input of the optimizer: a move, and settings for solving it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from energy_opt.arguments import check_fields, expect
from energy_opt.errors import BadInput, shown
from energy_opt.motion.conditions import BOUNDS, check_bound, kept, tube_of
from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory, whole
from energy_opt.names import labels_of
from energy_opt.numerics.compile import POLICIES
from energy_opt.robot import Robot

Mode = Literal["retime", "reshape"]
SHORTEST, LONGEST = 1e-6, 1e5  # [s] bounds of a given duration: a sample of any controller is longer, a day is shorter
LARGEST = 1e4  # [rad, m] largest position: 1,600 turns of a joint without limits
COUNTS = (  # settings: name, least, most without `allow_large` (the effort at the most)
    ("starts", 1, 10_000),  # hours
    ("seed", 0, 2**63 - 1),
    ("verify_samples", 100, 2_000_000),  # some seconds for each evaluation, block by block
    ("initial_paths", 0, 100),  # minutes of planning each
    ("controls", 10, 400),  # 2,800 unknowns for seven joints: minutes per start
)
SOLVERS = ("ipopt", "sqp")
OBJECTIVES = ("energy", "torque", "power_squared", "path_length", "time")


@dataclass(frozen=True, eq=False)
class Move:
    """A joint move between fixed ends.

    Attributes:
        start, goal: (n,) [rad]; any sequence of numbers is accepted.
        mode: "retime" keeps the path, "reshape" is free to change it.
        duration: exactly this long [s], to the nanosecond; max_duration: at most; neither: free.
        path: the path to follow (retime) or to start from (reshape); a straight line in joint space by default.
        via: points (n,) [rad] that a reshaped move passes in order, at times it chooses.
        input: a given trajectory, the baseline "input"; its end velocities are kept.

    Raises:
        BadInput: a value of another type, positions that are not finite or differ in number, a duration that is not
            between 1e-6 and 1e5 s, or two durations.
    """

    start: np.ndarray
    goal: np.ndarray
    mode: Mode = "reshape"
    duration: float | None = None
    max_duration: float | None = None
    path: JointPath | None = None
    via: tuple[np.ndarray, ...] = ()
    input: Trajectory | None = None

    if TYPE_CHECKING:  # what may be given; `__post_init__` makes arrays of it

        def __init__(
            self, start: Sequence[float] | np.ndarray, goal: Sequence[float] | np.ndarray, mode: Mode = "reshape",
            duration: float | None = None, max_duration: float | None = None, path: JointPath | None = None,
            via: Sequence[Sequence[float] | np.ndarray] = (), input: Trajectory | None = None,
        ) -> None: ...  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("start", "goal"):
            object.__setattr__(self, name, _vector(getattr(self, name), name))
        expect(self.via, Sequence | np.ndarray, "--via")
        object.__setattr__(self, "via", tuple(_vector(q, "via") for q in self.via))
        check_fields(self)
        if self.mode not in ("retime", "reshape"):
            raise BadInput(f"--mode {self.mode!r}; expected retime or reshape")
        if self.duration is not None and self.max_duration is not None:
            raise BadInput("both --duration and --max-duration are given; give one")
        for name, value in (("--duration", self.duration), ("--max-duration", self.max_duration)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise BadInput(f"{name} {value:g}: not a duration; expected seconds above 0")
            if value is not None and not SHORTEST <= value <= LONGEST:
                raise BadInput(f"{name} {value:g}: expected {SHORTEST:g} to {LONGEST:g} s")
            if value is not None:
                object.__setattr__(self, name[2:].replace("-", "_"), float(whole(value)))
        if self.via and self.mode == "retime":
            raise BadInput("--via belongs to --mode reshape; for retime give the points as a --path file")
        for what, q in (("--start", self.start), ("--goal", self.goal), *(("--via", q) for q in self.via)):
            if np.asarray(q).shape != np.asarray(self.start).shape or not np.isfinite(q).all():
                raise BadInput(f"{what}: expected {np.asarray(self.start).size} finite joint positions [rad]")
            if np.abs(q).max(initial=0.0) > LARGEST:
                raise BadInput(f"{what}: a position of {np.abs(q).max():.3g}; expected at most {LARGEST:g} rad")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Move):
            return NotImplemented
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        return hash((self.start.tobytes(), self.goal.tobytes(), self.mode, self.duration, self.max_duration))

    @property
    def longest(self) -> float | None:
        """The longest duration [s] that is asked for; None where it is free."""
        return self.duration if self.duration is not None else self.max_duration

    @property
    def end_velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity (n,) [rad/s] at start and goal: the input trajectory's, else rest."""
        if self.input is None:
            return np.zeros_like(self.start), np.zeros_like(self.goal)
        return self.input.velocity[0], self.input.velocity[-1]


def _vector(values: Any, name: str) -> np.ndarray:
    """A copy as floats: the caller may change its array later."""
    if labels_of(values):
        raise BadInput(f"--{name}: {shown(values)} has labels; a Move takes joint positions [rad] in the robot's order")
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"--{name}: {values!r} is not joint positions [rad]") from None


def _same(a: object, b: object) -> bool:
    """Equality that looks into arrays, sequences and dataclasses."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b)
    if isinstance(a, (tuple, list)) and isinstance(b, (tuple, list)):
        return len(a) == len(b) and all(map(_same, a, b))
    if is_dataclass(a) and type(a) is type(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


@dataclass(frozen=True)
class Settings:
    """Settings for solving.

    Attributes:
        starts: largest number of starting points of a reshaped move, the straight path included; fewer are tried if
            no better answer is expected.
        seed: of the random starting points.
        compile: "auto", "always" or "never" (see `numerics.compile`).
        objective: what is minimised; all but "energy" are common proxies, scored under the full model.
        solver: "ipopt", which continues if the search without bodies has not converged, or "sqp" alone.
        dynamics: source of the symbolic dynamics (see `dynamics`).
        verify_samples: least number of samples of the certificate; None for ten between every two samples.
        end_acceleration: of a reshaped move, "zero" or "free". If the best timing of the first path, whose end
            accelerations are free, takes less energy than a move with "zero", "free" is solved too; with or without
            the conditions and bodies.
        controls: control points per joint of a reshaped move.
        max_power: bound of the arm's electrical power [W]; None for none.
        tool_speed: bound of the speed of the tool's origin [m/s]; None for none.
        tool_acceleration: bound of the acceleration of the tool's origin [m/s^2]; None for none.
        keep: "upright[:DEG]", "orientation[:DEG]", "line[:MM]": conditions on the tool's pose; one word, words with
            commas between them, or a sequence of words.
        tube: "0.1rad" or "0.02m": largest distance of any joint, or of the tool, from the nearest point of the given
            path (of the straight line if none is given); None for no bound.
        allow_large: allow more starts, samples and control points than usual.
        tool: FRAME[,X,Y,Z[,R,P,Y]], the frame of a joint or link and the tool's pose there [m, rad]; None for the
            last joint's.
        deadline: seconds after which the search for a motion ends with the best proven answer so far; None for none.
        initial_paths: number of collision-free paths to look for and start from if the straight line touches
            something, and in addition to a given path; None for one, or two if the first saves little, and zero for a
            given path without collision.
        own_limits: user-defined limits (`motion.limits.own.OwnLimit`), in addition to all others.

    Raises:
        BadInput: a value of another type, outside of its range, or not among the known words.
    """

    starts: int = 24
    seed: int = 0
    compile: str = "auto"
    objective: str = "energy"
    solver: str = "ipopt"
    dynamics: str = "auto"
    verify_samples: int | None = None
    end_acceleration: str = "zero"
    controls: int = 48
    max_power: float | None = None
    tool_speed: float | None = None
    tool_acceleration: float | None = None
    keep: str | tuple[str, ...] = ()
    tube: str | None = None
    tool: str | None = None
    allow_large: bool = False
    initial_paths: int | None = None
    own_limits: tuple[Any, ...] = ()
    deadline: float | None = None

    def __post_init__(self) -> None:
        expect(self.keep, str | Sequence, "--keep")
        words = self.keep.split(",") if isinstance(self.keep, str) else self.keep
        object.__setattr__(self, "keep", tuple(words))
        check_fields(self)
        kept(tuple(words))
        if self.tube is not None:
            tube_of(self.tube)
        for name in BOUNDS:
            check_bound(name, getattr(self, name))
        for name, least, most in COUNTS:
            value = getattr(self, name)
            larger = self.allow_large and name != "seed"
            if value is not None and (value < least or (value > most and not larger)):
                hint = ", or --allow-large" if value > most and name != "seed" else ""
                raise BadInput(f"--{name.replace('_', '-')} {value!s:.24}; expected {least} to {most}{hint}")
        if self.deadline is not None and not (np.isfinite(self.deadline) and self.deadline > 0):
            raise BadInput(f"--deadline {self.deadline!s:.24}: expected seconds above 0")
        if self.objective not in OBJECTIVES:
            raise BadInput(f"--objective {self.objective!r}; expected one of {', '.join(OBJECTIVES)}")
        if self.solver not in SOLVERS:
            raise BadInput(f"--solver {self.solver!r}; expected one of {', '.join(SOLVERS)}")
        if self.compile not in POLICIES:
            raise BadInput(f"--compile {self.compile!r}; expected one of {', '.join(POLICIES)}")
        if self.end_acceleration not in ("zero", "free"):
            raise BadInput(f"--end-acceleration {self.end_acceleration!r}; expected zero or free")


def long_turns(robot: Robot, move: Move) -> list[str]:
    """As `turns_between`; a move with a given path or via points has none: there the turn is meant."""
    return [] if move.path is not None or move.via else turns_between(robot, move.start, move.goal)


def turns_between(robot: Robot, start: np.ndarray, goal: np.ndarray) -> list[str]:
    """Warnings for joints without limits that reach the same pose by a shorter turn the other way.

    Args:
        start, goal: (n,) [rad].
    """
    out = []
    for k, link in enumerate(robot.body.own_links()):
        turn = float(goal[k] - start[k])
        short = float(np.remainder(turn + np.pi, 2 * np.pi) - np.pi)
        if link.continuous and abs(turn) > np.pi + 1e-9:
            out.append(
                f"{link.name} turns {turn:.4g} rad, but has no position limits: {start[k] + short:.6g} rad is the "
                f"same pose {abs(short):.4g} rad away"
            )
    return out
