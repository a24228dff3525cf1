"""One arm as its description has it: loaded, a move solved, and the answer judged by others.

A move between two free postures that are held under gravity (seeded, the same for all); whether the file that is
written holds the limits of the description (Pinocchio's torque of the original URDF, the quintic between samples by
SciPy) and touches nothing (`dense_judge`); the largest acceleration, and what was assumed.

A refusal counts as right where it names its reason. An arm that touches itself in all postures is right where the
judge finds the same, the refusal names the remedy, and the move is solved with it.
"""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
from energy_opt.robot.limits import postures

BELIEVABLE = 50.0  # [rad/s^2]
POSTURES = 300  # that are looked at
ALLOWED = 1e-4  # share of a bound that rounding of the file may break
DENSE = 20  # instants between two samples

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
    seconds: float = 0.0
    assumed: dict[str, int] = field(default_factory=dict)
    reason: str = ""

    @property
    def right(self) -> bool:
        """Refused with a reason, or solved, judged right, and with accelerations that one believes."""
        if self.status == "refused":
            return bool(self.reason)
        good = self.broken is not None and self.broken <= ALLOWED and self.touching == 0
        return self.status == "solved" and good and (self.acceleration or np.inf) <= BELIEVABLE * (1 + ALLOWED)


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
        row.seconds = document["seconds"]
        if (out / "trajectory.csv").is_file():
            row.saving = saved(document.get("models") or [])
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
    command = ["prlimit", f"--cpu={seconds:.0f}", sys.executable, "-m", "energy_opt", *words]
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    spent = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    try:
        document: dict[str, Any] = json.loads(answer.stdout)
    except json.JSONDecodeError:
        last = (answer.stderr.strip() or "no answer").splitlines()[-1]
        document = {"status": "failed", "message": f"exit {answer.returncode}: {last}"}
    return {**document, "seconds": spent}


def saved(models: Sequence[dict[str, Any]]) -> float | None:
    """Of the loss of the evenly slowed move what is saved, %: the mean over the models that were planned under."""
    planned = [row for row in models if ", friction " not in row["name"] and row["saving_joules"] is not None]
    slowed = sum(row["loss"] + row["saving_joules"] for row in planned)
    return 100 * sum(row["saving_joules"] for row in planned) / slowed if slowed > 0 else None


def shortened(text: str) -> str:
    """A message without folders."""
    return re.sub(r"/\S*/", "", text)[:240]


def ends(robot: Robot, cell: Cell) -> tuple[np.ndarray, np.ndarray] | None:
    """The first two of the seeded postures that are held within the efforts and touch nothing, half a range apart."""
    q = postures(robot.limits, POSTURES)
    q = q[(np.abs(robot.body.torque(q, 0 * q, 0 * q)) <= 0.9 * robot.limits.effort).all(axis=1)]
    return apart(q, cell.free) or apart(q, lambda pose: cell.touching(pose) is None)


def apart(q: np.ndarray, free: Callable[[np.ndarray], bool]) -> tuple[np.ndarray, np.ndarray] | None:
    """The first two of the postures (N, n) that are free, half a range apart; None where there are not two."""
    start = None
    for pose in q:
        if not free(pose):
            continue
        if start is None:
            start = pose
        elif np.abs(pose - start).max() > 0.3:
            middle = start + 0.5 * (pose - start)
            return start, middle if free(middle) else pose
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
