"""URDFs with joints that follow others, for tests: a palletizing arm with its rods and a gripper, and a random tree."""

from __future__ import annotations

import numpy as np

INERTIA = '<inertia ixx="{0}" iyy="{1}" izz="{2}" ixy="0" ixz="0" iyz="0"/>'


LIMIT = '<limit lower="-9" upper="9" velocity="9" effort="900"/>'


def _link(name: str, mass: float, centre: str, box: str) -> str:
    x, y, z = (float(word) for word in box.split())
    moments = [mass * (a * a + b * b) / 12 for a, b in ((y, z), (x, z), (x, y))]
    solid = f'<collision><origin xyz="{centre}"/><geometry><box size="{box}"/></geometry></collision>'
    body = f'<inertial><mass value="{mass}"/><origin xyz="{centre}"/>{INERTIA.format(*moments)}</inertial>'
    return f'<link name="{name}">{body}{solid}</link>'


def _joint(name: str, kind: str, parent: str, child: str, place: str, axis: str, limit: str, mimic: str = "") -> str:
    lower, upper, velocity, effort = limit.split()
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
        f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>'
        f"{mimic and f'<mimic {mimic}/>'}</joint>"
    )


START, GOAL = np.array([0.0, 0.0, 0.0, 0.0, 0.0]), np.array([1.2, 0.5, 0.4, 1.0, 0.03])  # of the palletizer [rad, m]

# Turret, upper arm on a parallelogram (the elbow plate keeps its orientation, a rod runs beside), forearm on another
# (the head stays level), a turning flange, and a gripper whose second finger mirrors the first. "rod" sorts after all.
PALLETIZER = "\n".join(
    [
        '<robot name="palletizer">',
        _link("base", 30, "0 0 0.1", "0.3 0.3 0.2"),
        _link("turret", 20, "0 0 0.1", "0.2 0.2 0.2"),
        _link("upper", 12, "0 0 0.3", "0.1 0.1 0.5"),
        _link("plate", 1, "0 0 0", "0.06 0.06 0.06"),
        _link("forearm", 8, "0.3 0 0", "0.5 0.08 0.08"),
        _link("head", 2, "0 0 -0.05", "0.06 0.06 0.06"),
        _link("flange", 1, "0 0 -0.05", "0.05 0.05 0.05"),
        _link("finger_a", 0.2, "0 0.02 -0.05", "0.02 0.01 0.06"),
        _link("finger_b", 0.2, "0 -0.02 -0.05", "0.02 0.01 0.06"),
        _link("rod", 2, "0 0 0.3", "0.03 0.03 0.5"),
        _joint("j1", "revolute", "base", "turret", "0 0 0.2", "0 0 1", "-2.9 2.9 2 400"),
        _joint("j2", "revolute", "turret", "upper", "0 0 0.2", "0 1 0", "-0.9 1.2 2 800"),
        _joint("j2_plate", "revolute", "upper", "plate", "0 0 0.6", "0 1 0", "-3 3 9 0", 'joint="j2" multiplier="-1"'),
        _joint("j2_rod", "revolute", "turret", "rod", "-0.15 0 0.2", "0 1 0", "-3 3 9 0", 'joint="j2"'),
        _joint("j3", "revolute", "plate", "forearm", "0 0 0", "0 1 0", "-0.5 1.3 2 500"),
        _joint("j3_head", "revolute", "forearm", "head", "0.6 0 0", "0 1 0", "-3 3 9 0", 'joint="j3" multiplier="-1"'),
        _joint("j4", "continuous", "head", "flange", "0 0 -0.1", "0 0 1", "0 0 4 50"),
        _joint("tip_a", "prismatic", "flange", "finger_a", "0 0 -0.06", "0 1 0", "0 0.05 0.2 40"),
        _joint(
            "tip_b", "prismatic", "flange", "finger_b", "0 0 -0.06", "0 1 0", "-0.04 0 0.2 0",
            'joint="tip_a" multiplier="-1"',
        ),
        "</robot>",
    ]
)  # fmt: skip
PALLETIZER_ALL = ("j1", "j2", "j2_plate", "j3", "j3_head", "j4", "tip_a", "tip_b", "j2_rod")

# Followers before their leaders, in another branch, of another kind, one of a follower, one without an end.
ODD = [  # name, kind, parent, mimic: leader, multiplier, offset
    ("a", "revolute", -1, ("d", 0.7, 0.2)),
    ("b", "prismatic", 0, ("c", -0.3, 0.05)),
    ("c", "revolute", 1, None),
    ("d", "continuous", 2, None),
    ("e", "continuous", 1, ("a", -2.0, -0.1)),  # follows d by way of a: -1.4 d - 0.5
    ("f", "prismatic", 4, None),
    ("g", "revolute", 5, ("f", 3.0, 0.0)),
]
ODD_OWN = ("c", "d", "f")


def odd_arm(seed: int = 0) -> str:
    """The tree `ODD` with random placements, axes and inertias."""
    rng = np.random.default_rng(seed)

    def words(x: np.ndarray) -> str:
        return " ".join(repr(float(v)) for v in x)

    out = ['<robot name="odd"><link name="base"/>']
    for name, kind, parent, mimic in ODD:
        inertia, mass = INERTIA.format(*rng.uniform(0.05, 0.08, 3)), rng.uniform(1, 3)
        origin = f'<origin xyz="{words(rng.normal(size=3) / 5)}" rpy="{words(rng.normal(size=3))}"/>'
        out.append(f'<link name="l{name}"><inertial><mass value="{mass:.3f}"/>{origin}{inertia}</inertial></link>')
        follow = "" if mimic is None else f'<mimic joint="{mimic[0]}" multiplier="{mimic[1]}" offset="{mimic[2]}"/>'
        above = "base" if parent < 0 else "l" + ODD[parent][0]
        out.append(
            f'<joint name="{name}" type="{kind}"><parent link="{above}"/><child link="l{name}"/>'
            f'<origin xyz="{words(rng.normal(size=3) / 3)}" rpy="{words(rng.normal(size=3))}"/>'
            f'<axis xyz="{words(rng.normal(size=3))}"/>{LIMIT}{follow}</joint>'
        )
    return "\n".join([*out, "</robot>"])
