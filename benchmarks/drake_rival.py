"""Drake's KinematicTrajectoryOptimization with minimum-distance constraints, given the same arm, bodies and pairs.

The plant is built from the robot's own joints, the convex hulls of its bodies and the scene's shapes; pairs that may
touch are filtered. Its answer is a curve; what it is worth between the samples at which Drake constrained it, our proof
says. Needs the extra of that name on PyPI: `pip install drake`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.motion import Trajectory
from energy_opt.motion.path import JointPath

CONTROLS, ORDER = 20, 4  # of its B-spline
SAMPLES = 40  # places at which distances are constrained, as its users choose some dozens
DISTANCE, INFLUENCE = 0.002, 0.02  # [m] kept, and from where on distances count
ROWS = 400  # of the trajectory that is judged


@dataclass(frozen=True)
class Answer:
    """What came of it: a trajectory (None where it failed), and its seconds."""

    trajectory: Trajectory | None
    seconds: float


class Drake:
    """A plant for one cell."""

    def __init__(self, cell: Cell) -> None:
        import pydrake.geometry as dg
        from pydrake.math import RigidTransform
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
        from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, RevoluteJoint, SpatialInertia
        from pydrake.systems.framework import DiagramBuilder

        self.cell, self.robot = cell, cell.robot
        builder = DiagramBuilder()
        self.plant, graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self.plant.set_adjacent_bodies_collision_filters(False)
        bodies = []
        mass = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
        for link in self.robot.body.tree():
            parent = bodies[link.parent] if link.parent >= 0 else self.plant.world_body()
            body = self.plant.AddRigidBody(link.name, mass)
            kind = PrismaticJoint if link.prismatic else RevoluteJoint
            frame = RigidTransform(link.placement)
            offset = self.plant.AddFrame(FixedOffsetFrame(f"{link.name} at", parent.body_frame(), frame))
            self.plant.AddJoint(kind(link.name, offset, body.body_frame(), link.axis))
            bodies.append(body)
        friction, known = CoulombFriction(0.0, 0.0), {}
        for k, body in enumerate(cell.bodies.all):
            on = bodies[body.joint] if body.joint >= 0 else self.plant.world_body()
            piece = body.solid.hull
            # a half-space is the large box that stands for it
            points = np.ascontiguousarray(piece.points.T)
            shape = dg.Sphere(piece.radius) if len(piece.points) == 1 else dg.Convex(points, f"{body.name} {k}")
            pose = RigidTransform(body.pose)
            known[k] = self.plant.RegisterCollisionGeometry(on, pose, shape, f"{body.name} {k}", friction)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        kept = {tuple(sorted(pair)) for pair in cell.bodies.pairs.tolist()}
        filters = graph.collision_filter_manager(graph.GetMyMutableContextFromRoot(self.context))
        for a, b in combinations(known, 2):
            if (a, b) not in kept:
                one, two = dg.GeometrySet(known[a]), dg.GeometrySet(known[b])
                filters.Apply(dg.CollisionFilterDeclaration().ExcludeBetween(one, two))

    def solve(self, start: np.ndarray, goal: np.ndarray, first: JointPath) -> Answer:
        """The shortest path and time that it finds from `first`, at rest at both ends."""
        from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
        from pydrake.planning import KinematicTrajectoryOptimization
        from pydrake.solvers import SnoptSolver

        begin = time.process_time()
        limits, n = self.robot.limits, self.robot.n
        problem = KinematicTrajectoryOptimization(n, CONTROLS, ORDER)
        program = problem.get_mutable_prog()
        problem.AddDurationCost(1.0)
        problem.AddPathLengthCost(1.0)
        wide = 4 * np.pi
        problem.AddPositionBounds(np.maximum(limits.lower, -wide), np.minimum(limits.upper, wide))
        problem.AddVelocityBounds(-limits.velocity, limits.velocity)
        problem.AddAccelerationBounds(-limits.acceleration, limits.acceleration)
        problem.AddDurationConstraint(0.1, 30.0)
        for s, q in ((0.0, start), (1.0, goal)):
            problem.AddPathPositionConstraint(q, q, s)
            problem.AddPathVelocityConstraint(np.zeros(n), np.zeros(n), s)
        guess = first(np.linspace(0, 1, CONTROLS)).T
        program.SetInitialGuess(problem.control_points(), guess)
        program.SetInitialGuess(problem.duration(), 3.0)
        plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        apart = MinimumDistanceLowerBoundConstraint(self.plant, DISTANCE, plant_context, None, INFLUENCE)
        for s in np.linspace(0, 1, SAMPLES + 2)[1:-1]:
            problem.AddPathPositionConstraint(apart, s)
        result = SnoptSolver().Solve(program)
        seconds = time.process_time() - begin
        if not result.is_success():
            return Answer(None, seconds)
        curve = problem.ReconstructTrajectory(result)
        t = np.linspace(curve.start_time(), curve.end_time(), ROWS)
        rows = [np.hstack([curve.EvalDerivative(x, k) for x in t]).T for k in range(3)]
        return Answer(Trajectory(self.robot.joints, t - t[0], *rows), seconds)
