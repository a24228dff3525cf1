"""Moves that keep clear of the arm's own body and of what stands around it, judged by Pinocchio's own loop."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from poses import GOAL, START

import energy_opt as eo
from energy_opt.batches.tables import random_moves
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.path import straight
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot
from energy_opt.robot.catalog import srdf_beside
from energy_opt.robot.description import urdf_text
from energy_opt.robot.kinematics import Kinematics
from energy_opt.robot.meshes import mesh_files

PROBLEMS = Path(__file__).parents[3] / "shared/data/mbm"
CAGE, PICK = "panda_cage_0030", "ur5_table_pick_0033"


@pytest.fixture(scope="module")
def planner(panda: Robot, model: PowerModel) -> Planner:
    return Planner(panda, model, Settings(starts=2, initial_paths=1))


def post(panda: Robot, share: float) -> Scene:
    """A ball of 5 cm where the tool is at a share of the straight line from START to GOAL."""
    poses = Kinematics(panda.body.tree())((START + share * (GOAL - START))[None])
    at = np.eye(4)
    at[:3, 3] = poses.origin[0, 6]
    return Scene((SceneObject("post", (Shape("sphere", (0.05,)),), at),))


def touches(robot: Robot, t: Trajectory, ball: np.ndarray | None = None, samples: int = 500) -> int:
    """Poses of a dense sampling in which Pinocchio finds a contact of links, or with a ball of 5 cm."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    geometry = pin.buildGeomFromUrdfString(
        model, urdf_text(robot.description, mesh_files(robot.description)), pin.GeometryType.COLLISION
    )
    locked = [model.getJointId(name) for name in robot.locked]
    model, geometry = pin.buildReducedModel(model, geometry, locked, pin.neutral(model))
    own = geometry.ngeoms
    geometry.addAllCollisionPairs()
    pin.removeCollisionPairs(model, geometry, str(srdf_beside(robot.name, robot.urdf)))
    if ball is not None:
        import coal

        geometry.addGeometryObject(pin.GeometryObject("ball", 0, pin.SE3(ball), coal.Sphere(0.05)))
        for k in range(own):
            if geometry.geometryObjects[k].parentJoint > 0:
                geometry.addCollisionPair(pin.CollisionPair(k, own))
    data, found = model.createData(), geometry.createData()
    q = t.sample(np.linspace(t.time[0], t.time[-1], samples))[0]
    return sum(pin.computeCollisions(model, data, geometry, found, row, True) for row in robot.body.configuration(q))


def test_a_large_clearance_costs_a_little_more_than_a_small_one(planner: Planner, panda: Robot) -> None:
    """Bodies nearer than what is to be kept count, however far it is; at 5 cm the first path's timing had remained."""
    losses = []
    for clearance in (0.002, 0.05):
        result = planner.around(Cell(panda, CellRequest(clearance=clearance), post(panda, 0.5))).solve(
            Move(START, GOAL, duration=2.0)
        )
        found = result.certificate.clearance
        assert result.status == "solved" and found is not None and found.proven
        assert found.lower_bound is not None and found.lower_bound >= clearance
        losses.append(result.energy.loss)
    assert losses[0] < losses[1] < 1.2 * losses[0]


def test_ends_beside_a_table_cost_little_more(panda: Robot, model: PowerModel) -> None:
    """Ends nearer than 0.4 mm, or 0 to 0.2 mm beyond the clearance, had the first path's timing and 2.7 times the loss,
    or were refused.
    """
    start, goal = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [1.0, 0.55, 0.1, -1.8, 0.0, 2.3, 0.9]
    under = 0.1246533785  # [m] the height of the finger's lowest point
    planner = Planner(panda, model, Settings(starts=4))
    losses = []
    for gap in (0.02, 0.0001, 0.002001, 0.0021):
        at = np.eye(4)
        at[:3, 3] = 0.9, 0.9, under - gap - 0.05
        table = Scene((SceneObject("table", (Shape("box", (1.2, 1.2, 0.1)),), at),))
        cell = Cell(panda, CellRequest(), table)
        result = planner.around(cell).solve(Move(np.array(start), np.array(goal), duration=2.5))
        found = result.certificate.clearance
        assert result.chosen == "reshape" and found is not None and found.proven
        losses.append(result.energy.loss)
    assert max(losses) < 1.1 * min(losses)


def test_an_end_where_the_arm_nearly_touches_itself_costs_no_more_than_a_faster_path() -> None:
    """The first millimetres had to be left faster than an arm at rest can move: each search failed (1.18 J)."""
    start = [-2.60344, -1.65367, 0.946482, 0.516239, -2.55016, -0.420176]
    goal = [-0.131625, -2.13792, 0.736946, -2.42737, -0.683433, 0.105182]
    result = eo.optimize("ur5e", "source-method-2", start=start, goal=goal, duration=1.5)
    assert result.certificate.valid and result.certificate.clearance is not None
    assert result.certificate.clearance.proven and result.energy.loss < 0.8926  # that of the path of 1.2 s, retimed


def test_links_that_are_near_at_an_end_have_constraints() -> None:
    """At the goal, a wrist link is 3.5 mm from the forearm, and its hull 1.2 mm: all searches were blind to both links,
    and the first path's timing took 16.9 J.
    """
    start = [-1.8787, 3.3684, -1.1712, -2.4181, -1.1318, -2.0317]
    goal = [1.2851, -2.9022, 1.4941, 2.7002, -3.7486, 0.3126]
    result = eo.optimize("ur10e", "source-method-2", start=start, goal=goal, duration=4.893, starts=4)
    assert result.chosen == "reshape" and result.energy.loss < 10


def test_a_move_that_would_fold_the_arm_into_itself_keeps_clear(planner: Planner, panda: Robot) -> None:
    move = Move(START, GOAL, duration=2.0)
    planner = planner.around(None)
    folded = planner.solve(move)
    assert touches(panda, folded.trajectory) > 0 and folded.certificate.clearance is None
    planner = planner.around(Cell(panda, CellRequest()))
    result = planner.solve(move)
    clearance = result.certificate.clearance
    assert result.status == "solved" and clearance is not None and clearance.proven
    assert clearance.lower_bound is not None and clearance.lower_bound >= 0.002
    assert touches(panda, result.trajectory) == 0
    scaled, retimed = result.baseline("scaled"), planner.solve(Move(START, GOAL, "retime", 2.0))
    assert scaled is not None and folded.energy.total <= result.energy.total <= retimed.energy.total
    assert result.document()["certificate"]["clearance"]["verdict"] == "proven"


def test_a_move_whose_optimum_is_free_is_left_as_it_is(planner: Planner, panda: Robot) -> None:
    named, answers = random_moves(panda, 20, 1)[0], []
    for cell in (None, Cell(panda, CellRequest())):
        planner = planner.around(cell)
        answers.append(planner.solve(Move(named.start, named.goal, duration=2.5)))
    assert np.array_equal(answers[0].trajectory.position, answers[1].trajectory.position)
    assert answers[1].certificate.clearance.proven


def test_around_a_post(planner: Planner, panda: Robot) -> None:
    """The straight line goes through a ball: a way around is found, reshaped, and nothing is touched."""
    scene = post(panda, 0.5)
    planner = planner.around(Cell(panda, CellRequest(), scene))
    result = planner.solve(Move(START, GOAL, duration=3.0))
    assert result.status == "solved" and result.certificate.clearance.proven
    assert result.first_path is not None and result.first_path.source in ("own", "ompl")
    assert touches(panda, result.trajectory, scene.objects[0].pose) == 0


def test_what_cannot_be_free_is_refused(planner: Planner, panda: Robot) -> None:
    planner = planner.around(Cell(panda, CellRequest(), post(panda, 0.0)))
    with pytest.raises(Infeasible, match=r"start: .* touches .* mm deep") as info:
        planner.solve(Move(START, GOAL, duration=3.0))
    assert info.value.limit == "clearance"
    planner = planner.around(Cell(panda, CellRequest(), post(panda, 0.5)))
    with pytest.raises(Infeasible, match=r"the given path is not free: collision: .*–post at 0\.\d+ of it") as info:
        planner.solve(Move(START, GOAL, "retime", path=straight(START, GOAL)))
    assert info.value.position is not None and abs(info.value.position - 0.5) < 0.2


@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="the planning problems are not beside the checkout")
def test_a_real_problem_with_its_planners_path(planner: Planner, panda: Robot) -> None:
    from energy_opt.formats import read_path

    name = "panda_bookshelf_tall_0070"
    path = read_path(PROBLEMS / "paths" / f"{name}.csv", panda.joints)
    planner = planner.around(Cell(panda, CellRequest(), read_scene(PROBLEMS / "scenes" / f"{name}.yaml")))
    move = Move(path.start, path.goal, path=path)
    move = Move(path.start, path.goal, path=path, duration=1.5 * planner.minimum_time(move))
    result = planner.solve(move)
    assert result.status == "solved" and result.certificate.clearance.proven and result.chosen == "reshape"
    assert result.saving is not None and result.saving["loss_percent"] > 35


@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="the planning problems are not beside the checkout")
def test_costly_optima_that_are_nearly_clear_are_tried(panda: Robot, model: PowerModel) -> None:
    """The best optimum without bodies is deep in a box; one that costs 27 % more leads to the best clear curve."""
    from energy_opt.formats import read_path

    name = "panda_table_pick_0070"
    path = read_path(PROBLEMS / "paths" / f"{name}.csv", panda.joints)
    planner = Planner(panda, model, cell=Cell(panda, CellRequest(), read_scene(PROBLEMS / "scenes" / f"{name}.yaml")))
    move = Move(path.start, path.goal, path=path)
    result = planner.solve(Move(path.start, path.goal, path=path, duration=1.5 * planner.minimum_time(move)))
    assert result.status == "solved" and result.certificate.clearance.proven
    assert result.saving is not None and result.saving["loss_percent"] > 48  # 43 without


def test_another_optimum_may_lead_to_less_beside_the_own_body(panda: Robot, model: PowerModel) -> None:
    """The first mixture saves most of what the best optimum would, and another one a tenth of the loss."""
    start = np.array([-1.6511, -0.7279, 1.4557, -2.2308, -0.4404, 2.8872, -1.3443])
    goal = np.array([-0.3135, 0.637, -1.672, -2.3492, 1.4948, 2.2842, -0.8308])
    result = Planner(panda, model, cell=Cell(panda, CellRequest())).solve(Move(start, goal, duration=2.48346))
    assert result.status == "solved" and touches(panda, result.trajectory) == 0
    assert result.energy.loss < 1.5  # 1.56 without


def test_a_result_says_that_self_collision_was_off(panda: Robot) -> None:
    import energy_opt as eo

    asked = CellRequest(self_collision=False)
    result = eo.optimize(panda, start=START, goal=START + 0.1, mode="retime", cell=asked, model="source-method-2")
    assert result.certificate.clearance is None and any("self-collision is off" in line for line in result.warnings)
    checked = eo.optimize(panda, start=START, goal=START + 0.1, mode="retime", model="source-method-2")
    assert checked.certificate.clearance.proven and not any("self-collision" in line for line in checked.warnings)


def test_a_way_that_leads_to_little_is_not_the_last(
    monkeypatch: pytest.MonkeyPatch, panda: Robot, model: PowerModel
) -> None:
    """Where reshaping from the way found saves little another one is looked for, and the cheaper answer is given."""
    from energy_opt.motion.plan import clearing
    from energy_opt.motion.plan import planner as module

    planner = Planner(panda, model, Settings(starts=2, controls=20), cell=Cell(panda, CellRequest(), post(panda, 0.5)))
    asked, first_path = [], module.first_path

    def noted(*given):
        asked.append((given[3].initial_paths, given[3].seed))
        return first_path(*given)

    monkeypatch.setattr(module, "first_path", noted)
    plain = planner.solve(Move(START, GOAL, duration=3.0))
    assert plain.status == "solved" and asked == [(None, 0)]
    monkeypatch.setattr(clearing, "LITTLE", 1.0)
    again = planner.solve(Move(START, GOAL, duration=3.0))
    assert asked == [(None, 0), (1, module.OTHER)]
    assert again.status == "solved" and again.energy.total <= plain.energy.total


def test_further_initial_paths_never_cost_more(panda: Robot, model: PowerModel) -> None:
    cell = Cell(panda, CellRequest(planner="none"), post(panda, 0.5))
    alone, more = (
        Planner(panda, model, Settings(starts=1, controls=14, initial_paths=count), cell=cell) for count in (None, 1)
    )
    begin, _, _ = alone.first_path(Move(START, GOAL))
    move = Move(START, GOAL, path=begin.path, duration=3.0)
    first, found = alone.solve(move), more.solve(move)
    assert found.status == "solved" and found.certificate.clearance.proven
    assert found.energy.total <= first.energy.total * (1 + 1e-9)
    assert found.solver.iterations > first.solver.iterations  # more was tried


def test_via_points_leave_no_further_lines_to_start_from(panda: Robot, model: PowerModel) -> None:
    """`initial_paths` adds no start where no planner adds one."""
    middle = (START + GOAL) / 2
    low = post(panda, 0.5).objects[0]
    low.pose[2, 3] -= 0.3  # [m] beside the arm: the optimum without bodies touches it
    cell = Cell(panda, CellRequest(planner="none"), Scene((low,)))
    planner = Planner(panda, model, Settings(starts=4, initial_paths=1), cell=cell)
    found = planner.solve(Move(START, GOAL, via=(middle,), duration=3.0))
    assert found.status == "solved" and found.certificate.clearance.proven


@pytest.mark.slow
@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="the scenes are not in the repository")
def test_a_search_in_a_scene_goes_on_while_it_saves() -> None:
    """Under dry friction it ended after 30 iterations: searching again from its answer took 20 % less loss."""
    problem = next(p for p in json.loads((PROBLEMS / "problems.json").read_text())["problems"] if p["id"] == CAGE)
    scene = str(PROBLEMS / "scenes" / f"{CAGE}.yaml")
    first = eo.optimize(problem["robot"], start=problem["start"], goal=problem["goal"], scene=scene, duration=4.0)
    again = eo.optimize(problem["robot"], path=first.trajectory.position, scene=scene, duration=4.0)
    assert first.status == again.status == "solved"
    assert first.energy.loss < 1.05 * again.energy.loss


@pytest.mark.slow
@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="the scenes are not in the repository")
@pytest.mark.parametrize("duration", [1.2, 2.0])
def test_a_plan_under_several_models_saves_where_no_mean_of_motions_keeps_clear(duration: float) -> None:
    """The best motion under the models' mean costs more under one of them, a second one more under another.

    Means of both touch the table. So the evenly slowed move was the answer.
    """
    problem = next(p for p in json.loads((PROBLEMS / "problems.json").read_text())["problems"] if p["id"] == PICK)
    scene = str(PROBLEMS / "scenes" / f"{PICK}.yaml")
    ends = {"start": problem["start"], "goal": problem["goal"]}
    result = eo.optimize(problem["robot"], **ends, scene=scene, duration=duration)
    assert result.status == "solved" and result.chosen == "reshape"
    savings = [record["saving_joules"] for record in result.models]
    assert min(savings) > 0 and max(savings) > 3


@pytest.mark.parametrize(("duration", "height"), [(0.98, 0.5), pytest.param(None, 0.5, marks=pytest.mark.slow)])
def test_a_low_wall_costs_no_more_than_a_high_one(
    panda: Robot, model: PowerModel, duration: float | None, height: float
) -> None:
    """The arm folds before it passes: 7.4 J are lost beside a wall of 1.2 m. In the least time, searches went over
    one of 0.5 m (13.2 J): the optimum without bodies is 0.12 m deep in it.
    """
    start, goal = ([turn, 0.1, 0.0, -2.1, 0.0, 2.2, 0.785] for turn in (-0.9, 0.9))
    at = np.eye(4)
    at[:3, 3] = 0.6, 0.0, height / 2
    wall = Scene((SceneObject("wall", (Shape("box", (0.4, 0.04, height)),), at),))
    dry = eo.effects.CoulombFriction(tau_c=[0.5, 0.9, 0.6, 1.2, 0.8, 0.3, 0.5])
    lossy = model + dry + eo.effects.Regeneration(efficiency=0.0, level="bus")
    planner = Planner(panda, lossy, Settings(starts=4), cell=Cell(panda, CellRequest(), wall))
    assert planner.solve(Move(start, goal, duration=duration)).energy.loss < 8.5


@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="needs the shared data")
def test_first_paths_keep_little_more_than_the_clearance(panda: Robot) -> None:
    """Out of a cage with 20 mm; paths that keep twice as much do not fit through."""
    (row,) = [row for row in json.loads((PROBLEMS / "problems.json").read_text())["problems"] if row["id"] == CAGE]
    scene = PROBLEMS / "scenes" / f"{CAGE}.yaml"
    result = eo.optimize(panda, start=row["start"], goal=row["goal"], scene=scene, clearance=0.02, mode="retime")
    assert result.status == "solved" and result["certificate"]["clearance"]["verdict"] == "proven"
