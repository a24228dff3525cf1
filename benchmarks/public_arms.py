"""Every arm that example-robot-data ships, as it is: loaded, a move solved, and the answer judged by others.

    python benchmarks/public_arms.py [ARM ...] [--json FILE] [--limit SECONDS] [--options "WORDS"]

For each arm: joints, moving mass, warnings; a move between two free postures that are held under gravity (seeded, the
same for all); whether the file that is written holds the limits of the description (Pinocchio's torque of the original
URDF, the quintic between rows by SciPy) and touches nothing (`dense_judge`); the largest acceleration, and what was
assumed. Hands, legged and flying bases are no arms; of arms on them, and of two-armed robots, one arm moves and the
rest is locked.

A refusal counts as right where it names its reason. An arm that touches itself in all postures is right where the
judge finds the same, the refusal names the remedy, and the move is solved with it.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from dense_judge import DenseJudge, named_apart
from scipy.interpolate import BPoly

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.robot import Robot, load_robot
from energy_opt.robot.catalog import CATALOG, urdf_of
from energy_opt.robot.description import MOVING, read_description
from energy_opt.robot.postures import postures

ROOT = urdf_of(CATALOG["panda"]).parents[2]
BELIEVABLE = 50.0  # [rad/s^2]
POSTURES = 300  # that are looked at
ALLOWED = 1e-4  # share of a bound that rounding of the file may break
DENSE = 20  # instants between two rows

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
REMEDY = "--self-collision off"


@dataclass
class Row:
    """What became of one arm."""

    arm: str
    joints: int = 0
    mass: float = 0.0
    warnings: int = 0
    status: str = ""
    saving: float | None = None
    acceleration: float | None = None
    broken: float | None = None
    touching: int | None = None
    assumed: dict[str, int] = field(default_factory=dict)
    reason: str = ""

    @property
    def right(self) -> bool:
        """Refused with a reason, or solved, judged right, and with accelerations that one believes."""
        if self.status == "refused":
            return bool(self.reason)
        good = self.broken is not None and self.broken <= ALLOWED and self.touching == 0
        return self.status == "solved" and good and (self.acceleration or np.inf) <= BELIEVABLE


@dataclass(frozen=True)
class Arm:
    """A description, the joints that move (a pattern), folders of its packages, an SRDF that fits, further options."""

    name: str
    urdf: Path
    moving: str
    packages: tuple[Path, ...] = ()
    srdf: Path | None = None
    options: tuple[str, ...] = ()

    @property
    def by_name(self) -> bool:
        """Is it what the catalogue has by this name?"""
        return self.name in CATALOG and urdf_of(CATALOG[self.name]) == self.urdf


def public_arm(name: str, options: Sequence[str] = ()) -> Arm:
    """One of `ARMS`."""
    file, moving = ARMS[name]
    srdf = SRDFS.get(name)
    return Arm(name, ROOT / file, moving, (), None if srdf is None else ROOT / srdf, tuple(options))


def one(arm: Arm, seconds: float) -> Row:
    """Load, solve and judge an arm."""
    row = Row(arm.name)
    if not arm.urdf.is_file():  # that is no refusal
        row.status, row.reason = "no file", f"{arm.urdf.name} is not there"
        return row
    try:
        lock = {
            name: float(np.clip(0.0, joint.bounds.get("lower", -1.0), joint.bounds.get("upper", 1.0)))
            for name, joint in read_description(arm.urdf).joints.items()
            if joint.kind in MOVING and joint.mimic is None and not re.fullmatch(arm.moving, name)
        }
        robot = load_robot(arm.name if arm.by_name else arm.urdf, lock=lock)
        cell = Cell(robot, CellRequest(srdf=arm.srdf, package_dirs=arm.packages))
        row.joints, row.mass = robot.n, sum(link.mass for link in robot.body.tree())
        row.warnings = len(robot.warnings) + len(cell.warnings)
    except BadInput as error:
        row.status, row.reason = "refused", shortened(str(error))
        return row
    judge = DenseJudge(robot, srdf=arm.srdf, packages=arm.packages)
    found = ends(robot, cell)
    if found is None:
        refused_for_touching(arm, lock, robot, judge, row, seconds)
        return row
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        document = solved(arm, lock, *found, out, seconds)
        row.status, row.reason = document["status"], shortened(str(document.get("message", "")))
        if (out / "trajectory.csv").is_file():
            row.saving = (document.get("saving") or {}).get("loss_percent")
            row.assumed = dict(Counter(a["what"] for a in document.get("assumptions", []) if a["source"] == "assumed"))
            row.acceleration, row.broken = judged(robot, lock, out / "trajectory.csv")
            row.touching = judge.file(out / "trajectory.csv", 500).touching
    return row


def refused_for_touching(
    arm: Arm, lock: dict[str, float], robot: Robot, judge: DenseJudge, row: Row, seconds: float
) -> None:
    """What becomes of an arm without a free posture: it has to be refused, and solved with what the refusal names."""
    q = postures(robot.limits, 2)
    with tempfile.TemporaryDirectory() as folder:
        document = solved(arm, lock, q[0], q[1], Path(folder) / "refused", seconds)
        row.status, row.reason = document["status"], shortened(str(document.get("message", "")))
        if row.status != "infeasible" or REMEDY not in row.reason or (judge.pose(q[0]) or judge.pose(q[1])) is None:
            return
        again = solved(arm, lock, q[0], q[1], Path(folder) / "solved", seconds, REMEDY.split())
        row.status = "refused" if again["status"] == "solved" else "remedy fails"


def solved(
    arm: Arm, lock: dict[str, float], start: np.ndarray, goal: np.ndarray, out: Path, seconds: float,
    more: Sequence[str] = (),
) -> dict[str, Any]:  # fmt: skip
    """What `optimize` answers, files in `out`; a document with the status "failed" where it answers nothing."""
    words = [
        "optimize", "--robot", arm.name if arm.by_name else str(arm.urdf),
        *(word for name, value in lock.items() for word in ("--lock", f"{name}={value!r}")),
        *(word for folder in arm.packages for word in ("--package-dir", str(folder))),
        *(() if arm.srdf is None else ("--srdf", str(arm.srdf))),
        "--start=" + ",".join(map(repr, start.tolist())), "--goal=" + ",".join(map(repr, goal.tolist())),
        "--out", str(out), "--json", "--quiet", *more, *arm.options,
    ]  # fmt: skip
    command = [sys.executable, "-m", "energy_opt", *words]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=seconds, check=False)
        document: dict[str, Any] = json.loads(answer.stdout)
    except (subprocess.TimeoutExpired, json.JSONDecodeError) as error:
        return {"status": "failed", "message": type(error).__name__}
    return document


def shortened(text: str) -> str:
    """A message without the folder of the package."""
    return text.replace(f"{ROOT}/", "")[:240]


def ends(robot: Robot, cell: Cell) -> tuple[np.ndarray, np.ndarray] | None:
    """The first two of the seeded postures that are held within the efforts and touch nothing, half a range apart."""
    q = postures(robot.limits, POSTURES)
    held = (np.abs(robot.body.torque(q, 0 * q, 0 * q)) <= 0.9 * robot.limits.effort).all(axis=1)
    start = None
    for k in np.flatnonzero(held).tolist():
        if not cell.free(q[k]):
            continue
        if start is None:
            start = q[k]
        elif np.abs(q[k] - start).max() > 0.3:
            middle = start + 0.5 * (q[k] - start)
            goal = middle if cell.free(middle) else q[k]
            return start, goal
    return None


def judged(robot: Robot, lock: dict[str, float], file: Path) -> tuple[float, float]:
    """The largest acceleration, and by what share of a bound the worst limit is broken (below 0: none is)."""
    model = named_apart(pin.buildModelFromUrdf(str(robot.urdf)))
    still = {**lock, **robot.locked}
    full = pin.neutral(model)
    for name, value in still.items():
        joint = model.joints[model.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    model = pin.buildReducedModel(model, [model.getJointId(name) for name in still], full)
    data = model.createData()
    table = np.genfromtxt(file, delimiter=",", names=True, deletechars="", encoding="utf-8")
    columns = [[table[f"{j}.{kind}"] for j in robot.joints] for kind in ("position", "velocity", "acceleration")]
    rows, time = np.array(columns).transpose(2, 0, 1), table["time"]
    curve = BPoly.from_derivatives(time, rows)
    at = np.unique(np.concatenate([np.linspace(a, b, DENSE + 1) for a, b in zip(time[:-1], time[1:], strict=True)]))
    q, v, a = curve(at), curve(at, 1), curve(at, 2)
    names = list(model.names)[1:]
    order = [names.index(j) for j in robot.joints]
    tau = np.zeros_like(q)
    if len(names) == len(robot.joints):
        for k in range(len(at)):
            angles = np.zeros(len(names))
            angles[order] = q[k]
            c = np.concatenate(
                [
                    [np.cos(x), np.sin(x)] if j.nq == 2 else [x]
                    for x, j in zip(angles, list(model.joints)[1:], strict=True)
                ]
            )
            speeds, changes = np.zeros(len(names)), np.zeros(len(names))
            speeds[order], changes[order] = v[k], a[k]
            tau[k] = pin.rnea(model, data, c, speeds, changes)[order]
    limits = robot.limits
    shares = [
        (np.abs(value) / bound - 1).max()
        for value, bound in ((v, limits.velocity), (a, limits.acceleration), (tau, limits.effort))
    ]
    span = np.maximum(limits.upper - limits.lower, 1e-9)
    shares.append((np.maximum(limits.lower - q, q - limits.upper) / np.where(np.isfinite(span), span, 1.0)).max())
    return float(np.abs(a).max()), float(max(shares))


def line(row: Row) -> str:
    """A row of the table."""

    def shown(value: Any, form: str) -> str:
        return "–" if value is None else format(value, form)

    assumed = ", ".join(f"{what} ×{count}" for what, count in row.assumed.items()) or "–"
    return (
        f"| {row.arm} | {row.joints} | {row.mass:.3g} | {row.warnings} | {row.status} | {shown(row.saving, '.1f')} | "
        f"{shown(row.acceleration, '.3g')} | {shown(row.broken, '.1e')} | {shown(row.touching, 'd')} | {assumed} | "
        f"{'yes' if row.right else 'no'} | {row.reason[:160]} |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 where an arm does not end right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="*", metavar="ARM", help=f"of {', '.join(ARMS)} (all)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--limit", type=float, default=300.0, metavar="SECONDS")
    parser.add_argument("--options", default="", metavar="WORDS", help="of optimize, such as '--starts 2'")
    args = parser.parse_args(arguments)
    print("| arm | joints | mass kg | warnings | status | loss saved % | largest acceleration rad/s² | worst limit | "
          "touching poses of 500 | assumed | right | reason |\n|" + "---|" * 12)  # fmt: skip
    rows = []
    for arm in args.arms or ARMS:
        rows.append(one(public_arm(arm, args.options.split()), args.limit))
        print(line(rows[-1]), flush=True)
    print(f"\n{sum(row.right for row in rows)} of {len(rows)} end right")
    if args.json is not None:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    return int(not all(row.right for row in rows))


if __name__ == "__main__":
    sys.exit(main())
