"""The page of a cell: what its drawings show."""

from __future__ import annotations

import numpy as np

from energy_opt.reports.motion import Solid, cell_player
from energy_opt.reports.workcell import gantt, headline, table
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


def test_the_distance_of_the_arms_is_stated_beside_what_is_proven() -> None:
    """ "At least 2.02 mm apart" of arms that stay 217 mm apart: the proof ends where it suffices."""
    rows = [
        {"robots": ["a", "b"], "pair": ["wrist", "forearm"], "min_distance": 0.2175, "time": 3.4781},
        {"robots": ["a", "c"], "pair": None, "min_distance": None, "time": None},
    ]
    document = {
        "robots": [], "cycle_time": 9.0, "energy_total": 90.0, "bound": None, "supply": None,
        "levers": [{"name": "paths", "energy_total": 90.0, "moves": "optimized"}],
        "clearance": {"verdict": "proven", "lower_bound": 0.002017, "jitter": 0.02, "robots": rows},
    }  # fmt: skip
    proven = "the arms are proven to keep at least 2 mm apart, each up to 20 ms early or late"
    assert f"{proven}; nearest measured 218 mm (a wrist–b forearm, at 3.478 s)" in table(document, None)
    document["clearance"]["robots"] = rows[1:]
    assert f"{proven}\n" in table(document, None)
