"""The input of every part of a solve: robot, model, settings, limits, judge, built functions, and when to stop.

Functions take a while to build and compile. They depend on the structure of model and limits alone, so a `Workshop`
keeps them for all moves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.motion.dense import LONG, Dense
from energy_opt.motion.judge.certificate import Certificate, certificate_of, certify, certify_and_score
from energy_opt.motion.judge.clearance import clearance_of, measured
from energy_opt.motion.judge.energy import DENSER, Energy, Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.via import distinct
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.plan.anytime import Progress
from energy_opt.motion.reshape.curve import Curve
from energy_opt.motion.reshape.nodes import NodeFunctions, node_functions
from energy_opt.motion.reshape.search import Reshaper, trajectory_of
from energy_opt.motion.retime.fastest import minimum_time
from energy_opt.motion.retime.sums import LimitByStructure
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Filled, Trajectory
from energy_opt.numerics.compile import compiled
from energy_opt.power import PowerModel
from energy_opt.power.structure import SharedByStructure
from energy_opt.robot import RigidBody, Robot


@dataclass(frozen=True)
class Judged:
    """A trajectory and its results on the judge's grid, each computed when first asked for.

    A long trajectory is evaluated once for all results, and its grid is not kept.

    Attributes:
        limits: those of the move. cell: bodies to keep clear of; None for nothing.
        samples: least number of places of the certificate's grid; None for ten between samples.
    """

    trajectory: Trajectory
    scorer: Scorer
    limits: tuple[Limit, ...]
    cell: Cell | None
    samples: int | None

    @cached_property
    def _dense(self) -> Dense | None:
        short = DENSER * self.trajectory.position.size <= LONG
        return self.scorer.dense(self.trajectory) if short else None

    @cached_property
    def _looked_at(self) -> tuple[Certificate, Energy, Filled]:
        return certify_and_score(self.trajectory, self.scorer, self.limits)

    @cached_property
    def filled(self) -> Filled:
        """The trajectory with effort and power."""
        return self._looked_at[2] if self._dense is None else self._dense.filled

    @cached_property
    def energy(self) -> Energy:
        """Its energy under the model."""
        return self._looked_at[1] if self._dense is None else self.scorer.energy_of(self._dense)

    @cached_property
    def within(self) -> Certificate:
        """Its certificate under the limits, without clearance."""
        if self.samples is not None and self.samples > DENSER * (len(self.trajectory.time) - 1):
            return certify(self.trajectory, self.scorer, self.limits, self.samples)
        return self._looked_at[0] if self._dense is None else certificate_of(self._dense, self.limits, self.scorer)

    @cached_property
    def clearance(self) -> Clearance | None:
        """Its clearance from the cell's bodies; None without a cell."""
        return None if self.cell is None else clearance_of(self.cell, self.trajectory)

    @cached_property
    def certificate(self) -> Certificate:
        """Its certificate under the limits, with the proof of clearance."""
        return replace(self.within, clearance=self.clearance)

    @cached_property
    def stated(self) -> Certificate:
        """The certificate with the least distance all along the trajectory, which no search needs."""
        return measured(self.cell, self.trajectory, self.certificate)


class Judge:
    """Judges trajectories of one move; each is evaluated once, however often it is asked for."""

    def __init__(self, scorer: Scorer, limits: tuple[Limit, ...], samples: int | None, cell: Cell | None) -> None:
        self._scorer, self._limits, self._samples, self._cell = scorer, limits, samples, cell
        self._known: dict[int, Judged] = {}
        self._of: dict[tuple[int, float], tuple[Curve | Timing, Judged]] = {}

    def __call__(self, trajectory: Trajectory) -> Judged:
        """The trajectory, judged on a grid ten times denser than its samples, or with the settings' samples."""
        known = self._known.get(id(trajectory))
        if known is None:  # Judged holds the trajectory, so no other one can get the same id
            known = Judged(trajectory, self._scorer, self._limits, self._cell, self._samples)
            self._known[id(trajectory)] = known
        return known

    def of(self, curve: Curve) -> Judged:
        """The trajectory of a curve, judged."""
        return self._once(curve, curve.duration, lambda: trajectory_of(curve, self._scorer.robot.joints))

    def slowed(self, timing: Timing, duration: float) -> Judged:
        """The trajectory of a timing that is slowed evenly to `duration` s, judged."""
        return self._once(timing, duration, lambda: timing.slowed(duration).trajectory(self._scorer.robot.joints))

    def _once(self, source: Curve | Timing, duration: float, build: Callable[[], Trajectory]) -> Judged:
        key = id(source), duration  # the kept value holds the source
        if key not in self._of:
            self._of[key] = source, self(build())
        return self._of[key][1]


class Workshop:
    """Reshapers, each built once for all moves that share what it depends on."""

    def __init__(self) -> None:
        self._reshapers: dict[Hashable, Reshaper] = {}
        self.compiled = False
        self.seconds = 0.0  # total time spent on building

    def __reduce__(self) -> tuple[type[Workshop], tuple[()]]:
        """A pickled workshop is empty."""
        return Workshop, ()

    def reshaper(
        self, robot: Robot, model: PowerModel, settings: Settings, limits: Sequence[Limit], objective: str
    ) -> Reshaper:
        """The reshaper for a robot, a model's structure, the settings it depends on, and the limits' structure."""
        held = tuple(map(LimitByStructure, limits))
        built = SharedByStructure.on(robot, model), robot.body, held, objective, settings.dynamics, settings.compile
        key = *built, settings.controls, settings.end_acceleration, settings.solver
        if key not in self._reshapers:
            begin = time.perf_counter()
            nodes, self.compiled = _built(*built)
            free = settings.end_acceleration == "free"
            polished = settings.solver == "ipopt"
            self._reshapers[key] = Reshaper(nodes, robot.n, settings.controls, free, polished)
            self.seconds += time.perf_counter() - begin
        return self._reshapers[key]


@lru_cache(maxsize=16)
def _built(
    shared: SharedByStructure, body: RigidBody, limits: tuple[LimitByStructure, ...], objective: str, dynamics: str,
    compile: str,
) -> tuple[NodeFunctions, bool]:  # fmt: skip
    """The node functions, which all planners of a process share, and whether they are compiled."""
    nodes = node_functions(shared.model, body, [by.limit for by in limits], objective, dynamics, shared.size)
    functions, done = compiled(nodes.as_list(), compile)
    cost, limited, curvature, value = functions
    return NodeFunctions(cost, limited, curvature, value, nodes.kinked), done


@dataclass(frozen=True)
class Context:
    """The input of a solve; it never changes and holds no reference to its owner.

    Attributes:
        scorer: gives energies by the exact laws under the model.
        limits: in force for the move. standing: those of every move, by whose structure functions are built.
        judge: of the move's trajectories. workshop: keeps what was built.
        stopped: True ends a search with the best so far. progress: how the best answer improves over time.
        cell: bodies to keep clear of; None for nothing.
        initial_paths: free paths of the move besides its first. further: looks for another one where little is saved.
    """

    robot: Robot
    model: PowerModel
    settings: Settings
    scorer: Scorer
    limits: tuple[Limit, ...]
    standing: tuple[Limit, ...]
    judge: Judge
    workshop: Workshop
    stopped: Callable[[], bool]
    cell: Cell | None = None
    initial_paths: tuple[JointPath, ...] = ()
    further: Callable[[], tuple[JointPath, ...]] = tuple
    progress: Progress = field(default_factory=lambda: Progress(None))

    @cached_property
    def values(self) -> np.ndarray:
        """The model's parameter values (P,), in the order that solvers take them."""
        return self.model.values(self.robot.n)

    @property
    def freed(self) -> Context:
        """The context with free accelerations at a move's ends."""
        return replace(self, settings=replace(self.settings, end_acceleration="free"))

    def reshaper(self, objective: str) -> Reshaper:
        """The reshaper that minimises `objective`."""
        return self.workshop.reshaper(self.robot, self.model, self.settings, self.standing, objective)

    def fastest(self, path: JointPath, limits: Sequence[Limit] | None = None) -> Timing:
        """The fastest timing of a path within the move's limits or others; by TOPP-RA if it supports all of them.

        Raises:
            Infeasible: the path breaks limits at any timing.
        """
        return minimum_time(self.robot, self.model, path, self.limits if limits is None else limits)


def path_of(move: Move) -> JointPath:
    """The path that a move follows, or starts from."""
    if move.path is not None:
        return move.path
    if move.via:
        return through(np.vstack([move.start, *distinct(move), move.goal]))
    return straight(move.start, move.goal)
