"""Arms of other sizes: the same problem with all lengths, masses and efforts scaled saves the same share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt.effects import COBOT, ArmSize, CopperLoss, CoulombFriction, Regeneration
from energy_opt.motion import Move, Planner, Settings
from energy_opt.power import PowerModel
from energy_opt.power.structure import size_of
from energy_opt.robot import load_robot

LINK = """<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0 0 {com}"/>
  <inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial></link>"""
JOINT = """<joint name="j{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/><axis xyz="0 1 0"/>
  <origin xyz="0 0 {at}"/><limit lower="-3" upper="3" effort="{effort}" velocity="{velocity}"
    acceleration="{acceleration}" jerk="{jerk}"/></joint>"""


def swing_of(folder: Path, s: float, mode: str) -> float:
    """Share of the loss that is saved on a swing of a two-link arm of s times the size."""
    rates = {"velocity": 3 * s**-0.5, "acceleration": 15 / s, "jerk": 1500 * s**-1.5}
    links = "".join(LINK.format(name=f"l{k}", mass=6 * s**3, com=0.2 * s, moment=0.1 * s**5) for k in (1, 2))
    joints = "".join(
        JOINT.format(k=k, before=k - 1, at=0.4 * s * (k - 1), effort=effort * s**4, **rates)
        for k, effort in ((1, 150), (2, 60))
    )
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="l0"/>{links}{joints}</robot>')
    robot = load_robot(str(folder / "arm.urdf"))
    effects = (
        CopperLoss(r_over_kt2=[0.001 * s**-4.5, 0.003 * s**-4.5]),
        CoulombFriction(tau_c=[3 * s**4, 1.2 * s**4]),
        Regeneration(efficiency=0.0),
    )
    planner = Planner(robot, PowerModel("", effects), Settings(compile="never"))
    result = planner.solve(Move([-1.2, 0.5], [0.9, -0.7], mode, 1.8 * s**0.5))
    return float(result.saving["loss_percent"])


@pytest.mark.parametrize(("mode", "s"), [("retime", 0.1), ("reshape", 0.1), ("reshape", 4.0)])
def test_scaled_arms_save_the_same_share(tmp_path: Path, mode: str, s: float) -> None:
    """Kinks were rounded over 0.5 W and 0.05 N m on all arms: those of small drives were rounded away."""
    assert swing_of(tmp_path, s, mode) == pytest.approx(swing_of(tmp_path, 1.0, mode), abs=0.5)


def test_known_arms_are_of_one_size() -> None:
    for name in ("panda", "ur3", "ur5e", "ur10e", "z1"):
        assert size_of(load_robot(name)) == COBOT
    assert ArmSize.of(0.3, 0.6) == pytest.approx((1e-3, 1e-3))
    assert np.isfinite(ArmSize.of(0.0, 0.0)).all()
