"""Every arm that example-robot-data ships, or any URDF, as it is: loaded, a move solved, and judged (`arm_trial`).

    python benchmarks/public_arms.py [ARM ...] [--json FILE] [--limit SECONDS] [--options "WORDS"]
    python benchmarks/public_arms.py --urdf FILE ... [--moving PATTERN] [--package-dir DIR ...] [--srdf FILE] ...

Hands, legged and flying bases are no arms; of arms on them, and of two-armed robots, one arm moves and the rest is
locked.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from arm_trial import Arm, Row, one

from energy_opt.robot.catalog import CATALOG, urdf_of

ROOT = urdf_of(CATALOG["panda"]).parents[2]

# The file, and the joints that move (a pattern; the others are locked where they are nearest to 0).
ARMS: dict[str, tuple[str, str]] = {
    "panda": ("panda_description/urdf/panda.urdf", r"panda_joint\d"),
    "panda_capsules": ("panda_description/urdf/panda_collision.urdf", r"panda_joint\d"),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", ".*"),
    "ur3_limited": ("ur_description/urdf/ur3_joint_limited_robot.urdf", ".*"),
    "ur3_gripper": ("ur_description/urdf/ur3_gripper.urdf", ".*"),
    "ur3_unexpanded": ("ur_description/urdf/ur3.urdf", ".*"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ".*"),
    "ur5_limited": ("ur_description/urdf/ur5_joint_limited_robot.urdf", ".*"),
    "ur5_gripper": ("ur_description/urdf/ur5_gripper.urdf", ".*"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ".*"),
    "ur10_limited": ("ur_description/urdf/ur10_joint_limited_robot.urdf", ".*"),
    "kinova": ("kinova_description/robots/kinova.urdf", ".*"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ".*"),
    "z1": ("z1_description/urdf/z1.urdf", r"joint\d"),
    "so100": ("so_arm_description/urdf/so100.urdf", r"(?!.*(?i:gripper|jaw|6$)).*"),
    "so101": ("so_arm_description/urdf/so101.urdf", r"(?!.*(?i:gripper|jaw|6$)).*"),
    "talos_left_arm": ("talos_data/robots/talos_left_arm.urdf", ".*"),
    "talos_arm": ("talos_data/robots/talos_reduced.urdf", r"arm_left_\d_joint"),
    "baxter_arm": ("baxter_description/urdf/baxter.urdf", r"left_[sew]\d"),
    "tiago_arm": ("tiago_description/robots/tiago.urdf", r"arm_\d_joint"),
    "tiago_no_hand_arm": ("tiago_description/robots/tiago_no_hand.urdf", r"arm_\d_joint"),
    "tiago_dual_arm": ("tiago_description/robots/tiago_dual.urdf", r"arm_left_\d_joint"),
    "tiago_pro_arm": ("tiago_pro_description/urdf/tiago_pro.urdf", r"arm_left_\d_joint"),
    "pr2_arm": ("pr2_description/urdf/pr2.urdf", r"l_(?:shoulder|upper|elbow|forearm|wrist)\w*_joint"),
    "anymal_kinova": ("anymal_b_simple_description/robots/anymal-kinova.urdf", r"j2s6s200_joint_\d"),
    "b1_z1": ("b1_description/urdf/b1-z1.urdf", r"joint\d"),
    "borinot_arm": ("borinot_description/urdf/borinot_flying_arm_2.urdf", ".*"),
    "hextilt_arm": ("hextilt_description/urdf/hextilt_flying_arm_5.urdf", ".*"),
    "centauro_arm": ("centauro_description/urdf/centauro.urdf", r"j_arm1_\d"),
    "romeo_arm": ("romeo_description/urdf/romeo.urdf", r"L(?:Shoulder|Elbow|Wrist)\w*"),
    "icub_arm": ("icub_description/robots/icub.urdf", r"l_(?:shoulder|elbow|wrist)\w*"),
    "g1_arm": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", r"left_(?:shoulder|elbow|wrist)\w*_joint"),
    "two_dofs": ("asr_twodof_description/urdf/TwoDofs.urdf", ".*"),
    "double_pendulum": ("double_pendulum_description/urdf/double_pendulum.urdf", ".*"),
    "double_pendulum_simple": ("double_pendulum_description/urdf/double_pendulum_simple.urdf", ".*"),
    "double_pendulum_continuous": ("double_pendulum_description/urdf/double_pendulum_continuous.urdf", ".*"),
    "finger": ("finger_edu_description/robots/finger_edu.urdf", ".*"),
}
# SRDFs that the package ships and that fit: links of these arms touch by design.
SRDFS = {
    "baxter_arm": "baxter_description/srdf/baxter_manipulation.srdf",
    "pr2_arm": "pr2_description/srdf/pr2_manipulation.srdf",
}


def public_arm(name: str, options: Sequence[str] = ()) -> Arm:
    """One of `ARMS`."""
    file, moving = ARMS[name]
    srdf = SRDFS.get(name)
    return Arm(name, ROOT / file, moving, (), None if srdf is None else ROOT / srdf, tuple(options))


def line(row: Row) -> str:
    """A line of the table."""

    def shown(value: Any, form: str) -> str:
        return "–" if value is None else format(value, form)

    assumed = ", ".join(f"{what} ×{count}" for what, count in row.assumed.items()) or "–"
    return (
        f"| {row.arm} | {row.joints} | {row.mass:.3g} | {row.warnings} | {row.status} | {shown(row.saving, '.1f')} | "
        f"{shown(row.acceleration, '.3g')} | {shown(row.broken, '.1e')} | {shown(row.touching, 'd')} | "
        f"{row.seconds:.0f} | {assumed} | {'yes' if row.right else 'no'} | {row.reason[:160]} |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 where an arm does not end right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="*", metavar="ARM", help=f"of {', '.join(ARMS)} (all)")
    parser.add_argument("--urdf", nargs="+", type=Path, default=[], metavar="FILE", help="these instead")
    parser.add_argument("--moving", default=".*", metavar="PATTERN", help="the joints of a --urdf that move (all)")
    parser.add_argument("--package-dir", nargs="+", type=Path, default=[], metavar="DIR", help="of a --urdf's meshes")
    parser.add_argument("--srdf", type=Path, metavar="FILE", help="of the --urdf")
    parser.add_argument("--json", type=Path, metavar="FILE", help="one document a line, added as arms end")
    parser.add_argument("--limit", type=float, default=300.0, metavar="SECONDS", help="of CPU time per arm (300)")
    parser.add_argument("--options", default="", metavar="WORDS", help="of optimize, such as '--starts 2'")
    args = parser.parse_args(arguments)
    options = tuple(args.options.split())
    arms = [public_arm(name, options) for name in args.arms or ([] if args.urdf else ARMS)]
    arms += [Arm(file.stem, file, args.moving, tuple(args.package_dir), args.srdf, options) for file in args.urdf]
    print("| arm | joints | mass kg | warnings | status | loss saved % | largest acceleration rad/s² | worst limit | "
          "touching poses of 500 | CPU s | assumed | right | reason |\n|" + "---|" * 13)  # fmt: skip
    rows = []
    for arm in arms:
        rows.append(one(arm, args.limit))
        print(line(rows[-1]), flush=True)
        if args.json is not None:
            with args.json.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(rows[-1])) + "\n")
    print(f"\n{sum(row.right for row in rows)} of {len(rows)} end right")
    return int(not all(row.right for row in rows))


if __name__ == "__main__":
    sys.exit(main())
