"""The page of a cell: what its drawings show."""

from __future__ import annotations

import re

import numpy as np

from energy_opt.reports.motion import Solid, cell_player
from energy_opt.reports.workcell import gantt, waterfall
from energy_opt.robot import load_robot
from energy_opt.robot.kinematics import Kinematics

STEPS = [
    {"name": "to <it>", "start": 1.0, "duration": 2.0, "mode": None, "zone": "table"},
    {"name": "rest", "start": 3.0, "duration": 8.0, "mode": "brakes", "zone": None},
]


def bars(svg: str, title: str) -> list[float]:
    """Widths of the bars with a title."""
    return [float(w) for w in re.findall(rf'<title>{title}</title><rect [^>]*width="([\d.]+)"', svg)]


def test_a_gantt_chart_wraps_what_passes_the_end_of_the_cycle() -> None:
    svg = gantt([{"name": "a", "steps": STEPS}], 10.0, (np.linspace(0, 10, 50), np.full(50, 120.0)))
    (move,), rest = bars(svg, "to &lt;it&gt;"), bars(svg, r"rest \(brakes\)")
    assert len(rest) == 2 and abs(sum(rest) - 4 * move) < 0.3  # 8 s as 7 and 1
    assert svg.count("zone table") == 1 and "120 W" in svg


def test_a_waterfall_begins_where_the_lever_before_ends() -> None:
    svg = waterfall([("as is", 1000.0), ("speeds", 900.0), ("modes", 600.0)])
    boxes = [tuple(map(float, x)) for x in re.findall(r'y="([\d.]+)" width="[\d.]+" height="([\d.]+)"', svg)]
    (total, _), (first, high), (second, _), (left, _) = boxes
    assert total == first and abs(first + high - second) < 0.2 and left > second
    assert "-100 J" in svg and "-300 J" in svg and "600 J" in svg


def test_all_arms_are_in_one_scene() -> None:
    panda = load_robot("panda")
    links = list(panda.body.tree())
    q = np.vstack([np.full(7, -0.4), np.full(7, -0.5)])
    body = Solid(0, np.eye(3), np.array([[0, 1, 2]]))
    shown = cell_player(links, (np.array([0.0, 1.0]), q), [panda.body.last], [(body, "#123456")])
    assert shown is not None and shown["bodies"][0]["colour"] == "#123456"
    tool = Kinematics(links)(q).origin[:, panda.body.last]
    assert np.allclose(shown["motions"][0]["tools"][0], tool, atol=1e-3)
