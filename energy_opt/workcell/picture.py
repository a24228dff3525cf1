"""The pictures on a cell's page: all arms in one scene, and the power of all over the cycle."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from energy_opt.reports.motion import Solid, cell_player, drawn
from energy_opt.robot import Link
from energy_opt.workcell.between import placed_links
from energy_opt.workcell.run import CellResult
from energy_opt.workcell.supply import Supply

FRAMES = 300  # frames of the cycle; the player interpolates between them
COLOURS = ("#2f74c0", "#e07b28", "#2e9a60", "#8a5cc2", "#b0394f", "#5d7f8c")


def power_of(result: CellResult) -> tuple[np.ndarray, np.ndarray]:
    """Power (N,) [W] of all robots over the cycle, at times (N,) [s]; a robot with only curves draws its mean."""
    supplied = result.supply or Supply(result.cell, result.arms).drawn(result.schedule, False)
    return supplied.time, supplied.power


def scene_of(result: CellResult) -> dict[str, Any] | None:
    """All arms over the cycle, for the page's player; None if no arm has bodies."""
    time = np.linspace(0, result.cell.cycle_time, FRAMES)
    links: list[Link] = []
    positions: list[np.ndarray] = []
    tools: list[int] = []
    bodies: list[tuple[Solid, str]] = []
    scene: list[Solid] = []
    for arm, motion in zip(result.arms, result.planned.motions, strict=True):
        cell = None if arm is None else arm.cell
        if cell is None or motion is None:
            continue
        base, shift, colour = cell.request.base_pose, len(links), COLOURS[len(tools) % len(COLOURS)]
        own, around = drawn(cell)
        links += placed_links(cell, shift)
        positions.append(motion.at(time))
        tools.append(shift + cell.robot.body.last)
        bodies += [(_placed(solid, base, shift), colour) for solid in own]
        scene = scene or [_placed(solid, base, 0) for solid in around]
    if not positions:
        return None
    return cell_player(links, (time, np.hstack(positions)), tools, bodies, scene)


def _placed(solid: Solid, base: np.ndarray, shift: int) -> Solid:
    """A body of an arm in the common tree: a moving one by its joint's number, a fixed one by its base's pose."""
    if solid.joint >= 0:
        return replace(solid, joint=solid.joint + shift)
    return replace(solid, vertices=solid.vertices @ base[:3, :3].T + base[:3, 3])
