"""An arm whose poses have eight branches."""

from __future__ import annotations

import pytest

from energy_opt.poses.inverse import ToolKinematics
from energy_opt.robot import load_robot


@pytest.fixture(scope="module")
def ur() -> ToolKinematics:
    return ToolKinematics(load_robot("ur5e"))
