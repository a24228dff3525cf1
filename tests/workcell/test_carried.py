"""Objects of a scene that one of several arms carries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.errors import BadInput
from energy_opt.robot import Robot, load_robot
from energy_opt.workcell.between import TwoArms

BASE = (0.5, 0.0, 0.2, 0.1, 0.0, 2.0)


def test_what_a_link_of_one_arm_carries_is_a_body_of_this_arm_alone(panda: Robot) -> None:
    """It was "attached to no link" of the other arm, and there is one scene for all."""
    ur5, shape = load_robot("ur5"), (Shape("box", (0.03, 0.03, 0.3)),)
    rod = SceneObject("rod", shape, np.eye(4), "panda_hand", "panda_hand", ("panda_leftfinger", "panda_rightfinger"))
    one = Cell(panda, CellRequest(beside=(("b", ur5, BASE),)), Scene((rod,)))
    two = Cell(ur5, CellRequest(base=BASE, beside=(("a", panda, (0.0,) * 6),)), Scene((rod,)))
    assert [[body.name for body in cell.bodies.all].count("rod") for cell in (one, two)] == [1, 0]
    arms = TwoArms(one, two)
    assert ("rod", "forearm_link") in {arms.names(pair) for pair in range(len(arms.bodies.pairs))}
    assert not [said for cell in (one, two) for said in cell.warnings if "neither a link" in said]
    for link, words in (("panda_hnd", "did you mean 'panda_hand'"), ("panda_link0", "no link")):  # the last is fixed
        scene = Scene((replace(rod, attached_to=link, frame=link),))
        with pytest.raises(BadInput, match=words):
            Cell(panda if link == "panda_hnd" else ur5, two.request, scene)
