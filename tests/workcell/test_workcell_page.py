"""The page of a cell: what its drawings show."""

from __future__ import annotations

import numpy as np

from energy_opt.reports.motion import Solid, cell_player
from energy_opt.reports.workcell import gantt, headline
from energy_opt.robot import load_robot
from energy_opt.robot.kinematics import Kinematics

STEPS = [
    {"name": "to <it>", "start": 1.0, "duration": 2.0, "mode": None, "zone": "table"},
    {"name": "rest", "start": 3.0, "duration": 8.0, "mode": "brakes", "zone": None},
]


def test_a_gantt_chart_wraps_what_passes_the_end_of_the_cycle() -> None:
    blocks = [(b.lane, b.name, b.start, b.duration, b.kind) for b in gantt([{"name": "a", "steps": STEPS}], 10.0)]
    assert blocks == [
        ("a", "to <it>", 1.0, 2.0, "moves"),
        ("a: zone", "to <it>", 1.0, 2.0, "zone table"),
        ("a", "rest", 3.0, 7.0, "waits: brakes"),
        ("a", "rest", 0.0, 1.0, "waits: brakes"),
    ]


def test_the_headline_compares_with_the_first_lever() -> None:
    for name, against in (("as_is", "the cycle as it is"), ("speeds", "with the lever speeds alone")):
        document = {
            "energy_total": 90.0,
            "levers": [{"name": name, "energy_total": 100.0}],
            "optimality": {"gap_percent": None},
        }
        assert headline(document) == f"90 J a cycle; 10 % less than {against}."


def test_all_arms_are_in_one_scene() -> None:
    panda = load_robot("panda")
    links = list(panda.body.tree())
    q = np.vstack([np.full(7, -0.4), np.full(7, -0.5)])
    body = Solid(0, np.eye(3), np.array([[0, 1, 2]]))
    shown = cell_player(links, (np.array([0.0, 1.0]), q), [panda.body.last], [(body, "#123456")])
    assert shown is not None and shown["bodies"][0]["colour"] == "#123456"
    tool = Kinematics(links)(q).origin[:, panda.body.last]
    assert np.allclose(shown["motions"][0]["tools"][0], tool, atol=1e-3)
