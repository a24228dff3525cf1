"""Means of motions of one move, and robust plans that are such a mean."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from energy_opt import Result, optimize
from energy_opt.motion import Move, Planner, Trajectory
from energy_opt.motion.plan import robust as robust_plan
from energy_opt.motion.plan.blend import best_mean, blended, least_weights
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

LINK = """<link name="l{k}"><inertial><origin xyz="0 0 {half}"/><mass value="{mass}"/>
<inertia ixx="{turn}" iyy="{turn}" izz="{spin}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/><origin xyz="0 0 {height}"/>
<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="{speed}" effort="{effort}"/></joint>"""
LINKS = [  # mass [kg], length [m], joint's height above the last one [m], axis, speed [rad/s], effort [N m]
    (3.0, 0.3, 0.0, "0 1 0", 3, 50),
    (1.5, 0.3, 0.3, "0 1 0", 3, 25),
    (0.5, 0.1, 0.3, "0 0 1", 6, 5),
]
MOVE = Move(np.zeros(3), np.array([0.3, 0.7, -1.5]))


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    links = [
        LINK.format(
            k=k, before=k - 1, mass=m, half=length / 2, turn=m * length**2 / 12 + 1e-3, spin=m * 2e-3, height=z,
            axis=axis, speed=v, effort=tau,
        )
        for k, (m, length, z, axis, v, tau) in enumerate(LINKS, 1)
    ]  # fmt: skip
    urdf = tmp_path_factory.mktemp("arm") / "arm.urdf"
    urdf.write_text('<robot name="arm"><link name="l0"/>' + "\n".join(links) + "</robot>")
    return load_robot(Path(urdf))


def _optimized(arm: Robot, max_duration: float | None = None) -> Result:
    """Under the two models of the default."""
    return optimize(
        arm, start=MOVE.start, goal=MOVE.goal, max_duration=max_duration, starts=1, controls=16, compile="never",
        self_collision=False,
    )  # fmt: skip


def test_shares_cost_least_among_means_that_hold() -> None:
    costs, excess = np.array([10.0, 4.0, 6.0]), np.array([[0.0, 0.0], [1.0, -2.0], [-3.0, 1.0]])
    shares = least_weights(costs, excess)
    assert shares is not None
    rng = np.random.default_rng(3)
    others = rng.dirichlet(np.ones(3), 20_000)
    holding = others[(others @ excess <= 0).all(axis=1)]
    assert (shares @ excess <= 1e-12).all() and shares @ costs <= (holding @ costs).min() + 1e-12
    assert least_weights(costs, np.ones((3, 1))) is None


def test_the_mean_of_two_motions_is_their_mean_at_every_instant() -> None:
    curves = Polynomial([0, 0, 3, -2]), Polynomial([0, 0, 0, 10, -15, 6])

    def motion(curve: Polynomial, samples: int) -> Trajectory:
        t = np.linspace(0, 1, samples)
        return Trajectory(("j",), t, *(curve.deriv(order)(t)[:, None] for order in range(3)))

    mean = blended([motion(curves[0], 7), motion(curves[1], 12)], np.array([0.25, 0.75]))
    t = np.linspace(0, 1, 301)
    for order, close in ((0, 1e-12), (1, 1e-10), (2, 1e-8)):
        exact = 0.25 * curves[0].deriv(order)(t) + 0.75 * curves[1].deriv(order)(t)
        assert np.abs(mean(t, order)[:, 0] - exact).max() < close


def test_a_mean_can_cost_less_than_the_first_motion_where_the_other_motion_costs_more() -> None:
    """Energies were interpolated: a mean was given up if the other motion costs more under any model."""
    t = np.linspace(0, 1, 3)
    first, other = (Trajectory(("j",), t, *(x * np.ones((3, 1)) for x in (height, 0, 0))) for height in (0.0, 1.0))

    def energies(motion: Trajectory) -> np.ndarray:
        share = motion.position[1, 0]
        return np.array([5 - share, 1 - share + 3 * share**2])

    totals = np.stack([energies(first), energies(other)])
    assert best_mean([first, other], totals, 1) is None
    mean = best_mean([first, other], totals, 1, energies)
    assert mean is not None and mean.position[1, 0] > 0.2
    assert (energies(mean) <= energies(first) + 1e-9).all()


RAIL = """<robot name="rail"><link name="base"/><link name="slide"><inertial><mass value="20"/>
<inertia ixx="0.2" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="x" type="prismatic">
<parent link="base"/><child link="slide"/><axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="1" effort="2000"/>
</joint></robot>"""


def test_a_tilted_rail_saves_energy_although_one_friction_forbids_most_of_the_change(tmp_path: Path) -> None:
    """The answer was the evenly slowed move."""
    (tmp_path / "rail.urdf").write_text(RAIL)
    result = optimize(
        tmp_path / "rail.urdf", start=[-1], goal=[1], duration=3, base=[0, 0, 1, 0.2, 0.3, 1], mode="retime",
        self_collision=False, compile="never",
    )  # fmt: skip
    savings = [float(str(row["saving_joules"])) for row in result.models]
    assert min(savings) >= 0 and savings[1] > 1.5


def test_a_mean_of_motions_saves_most_of_what_one_model_would_forbid(arm: Robot) -> None:
    result = _optimized(arm)
    assert result.status == "solved" and result.certificate.valid
    savings = [float(str(row["saving_joules"])) for row in result.models]
    assert len(savings) > 2 and min(savings) >= 0
    assert savings[1] > 0.6  # J under `careful`; the models' weights alone come to 0.41


def test_the_evenly_slowed_move_has_its_own_certificate_and_a_message(
    arm: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(robust_plan.ROUNDS, "mean", 1)
    monkeypatch.setattr(robust_plan, "best_mean", lambda *_: None)
    result = _optimized(arm)
    assert result.chosen in ("scaled", "toppra")
    assert re.search(r"one that saves .* J under 'careful.*' takes .* J more under ", result.message)
    even = result.baseline(result.chosen)
    assert even is not None and np.array_equal(even.trajectory.position, result.trajectory.position)
    other = Planner(arm, source_method_2()).certify(result.trajectory, MOVE)
    assert result.certificate.max_violation == pytest.approx(other.max_violation, rel=1e-9)


@pytest.mark.slow
def test_the_longest_duration_is_kept_where_several_models_share_the_plan(arm: Robot) -> None:
    free = _optimized(arm)
    most = 1.5 * free.trajectory.duration
    held = _optimized(arm, max_duration=most)
    assert held.status == "solved" and held.trajectory.duration <= most
