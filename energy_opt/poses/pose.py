"""A pose of the tool, with its free directions and its tolerance.

The error of a pose is the shift and the rotation vector from it, without what lies in its free directions and their
ranges. Inverse kinematics, checks and results all use this error.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.scene import FARTHEST
from energy_opt.errors import BadInput, shown
from energy_opt.files import finite_number, words_of
from energy_opt.robot.kinematics import no_degrees, pose_of

TURNS = ("rx", "ry", "rz")
AXES = ("x", "y", "z", *TURNS)
FAR = 100.0  # [m] largest length from the base: a longer one is probably in the wrong unit
LEAST = 1e-9  # [m, rad] least tolerance, for rounding
EXACT = 1e-6, 1e-6  # [m, rad] tolerance of a pose that is to be reached exactly
WIDEST = 0.5, np.pi  # [m, rad] largest tolerance: a larger one is probably in another unit
UNIT = 1e-2  # largest deviation of a quaternion's norm, or of a matrix's axes, from 1; it is then scaled
ROUNDED = 1e-9  # the same, of a matrix that is used as it is


@dataclass(frozen=True)
class Freedom:
    """A direction of the tool's frame in which the pose is free.

    Attributes:
        axis: "x", "y", "z" (shifts) or "rx", "ry", "rz" (turns).
        low, high: range [m or rad]; without one, a turn or shift is unbounded.
    """

    axis: str
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise BadInput(f"--free {self.axis}: expected one of {', '.join(AXES)}")
        if not self.low <= self.high:
            unit, scale = ("deg", 180 / np.pi) if self.axis in TURNS else ("mm", 1e3)
            ends = f"begins at {scale * self.low:g} {unit} and ends at {scale * self.high:g} {unit}"
            raise BadInput(f"--free {self.axis}: the range {ends}; give the lower end first")

    @classmethod
    def of(cls, word: str) -> Freedom:
        """From AXIS or AXIS:FROM:TO, with degrees for turns and millimetres for shifts.

        Raises:
            BadInput: another form, an unknown axis, or ends that are no range.
        """
        axis, *ends = word.split(":") if isinstance(word, str) else ("", word)
        if len(ends) not in (0, 2):
            raise BadInput(f"--free {word}: expected AXIS or AXIS:FROM:TO, in degrees or millimetres")
        unit = np.pi / 180 if axis.startswith("r") else 1e-3
        low, high = (finite_number(end, f"--free {word}", "AXIS:FROM:TO") * unit for end in ends or ("0", "0"))
        return cls(axis, low, high) if ends else cls(axis)


@dataclass(frozen=True, eq=False)
class Pose:
    """A required pose of the tool: `Pose([0.4, 0, 0.3, 3.14, 0, 0], ["rz"], "1mm,1deg")`.

    Attributes:
        matrix: (4, 4) pose of the tool in the robot's base frame, lengths in m; given as such, or as x, y, z, roll,
            pitch, yaw or x, y, z and a quaternion x, y, z, w [m, rad], also in one text with commas.
            R = Rz(yaw) Ry(pitch) Rx(roll), as in URDF.
        free: directions of the tool's frame in which it may differ; given as such, or in words (`Freedom.of`).
        tolerance: distance [m] and angle [rad] by which it may be missed; given as such, or as `1mm,1deg`.
        name: for messages.
        frame: the frame of `matrix`: "" for the robot's base, else an object of the scene, or "world" for the
            scene's own frame (see `poses.given.in_base`).

    Raises:
        BadInput: another count of numbers, no pose, or an axis that is free twice.
    """

    matrix: np.ndarray
    free: tuple[Freedom, ...] = ()
    tolerance: tuple[float, float] = EXACT
    name: str = "pose"
    frame: str = ""

    def __post_init__(self) -> None:
        words: Any = self.free
        words = words if isinstance(words, Iterable) and not isinstance(words, str) else (words,)
        try:
            free = tuple(f if isinstance(f, Freedom) else Freedom.of(f) for f in words)
        except BadInput as error:
            raise BadInput(_of_key(str(error), self.name)) from None
        for freedom in free:
            if [other.axis for other in free].count(freedom.axis) > 1:
                raise BadInput(f"{self.name}: an axis is free twice: {', '.join(other.axis for other in free)}")
        allowed = tolerance_of(self.tolerance, self.name)
        matrix = matrix_of(self.matrix, self.name, FARTHEST if self.frame else FAR)
        for name, value in (("matrix", matrix), ("free", free), ("tolerance", allowed)):
            object.__setattr__(self, name, value)

    def document(self) -> dict[str, object]:
        """Its record in a result's request."""
        return {
            "matrix": self.matrix.tolist(),
            "free": [[f.axis, f.low, f.high] for f in self.free],
            "tolerance": list(self.tolerance),
            **({"frame": self.frame} if self.frame else {}),
        }

    def same_as(self, other: object) -> bool:
        """True if both require the same, whatever their names."""
        return isinstance(other, Pose) and self.document() == other.document()


class AnyOf(tuple[object, ...]):
    """Alternative goals: `AnyOf([pose, positions, ...])`; the move goes to the cheapest one.

    Each goal is a pose of the tool (see `pose_from`), a sequence (n,) of joint positions [rad, m], or a mapping from
    joint names to positions.
    """

    def __new__(cls, goals: Iterable[object] = ()) -> AnyOf:
        """Goals as a tuple.

        Raises:
            BadInput: they are no sequence.
        """
        if not isinstance(goals, Iterable):
            raise BadInput(f"AnyOf {shown(goals)}: expected a sequence of goals")
        return super().__new__(cls, goals)


def pose_from(
    given: str | Sequence[float] | np.ndarray | Pose,
    free: Iterable[str | Freedom] = (),
    tolerance: str | tuple[float, float] | None = None,
    name: str = "--goal-pose",
    frame: str = "",
) -> Pose:
    """A pose from text or from the arguments of `Pose`; a `Pose` is returned unchanged.

    Args:
        given: x, y, z [m] and roll, pitch, yaw [rad], or x, y, z and a quaternion x, y, z, w, as numbers or as text
            with commas; or a matrix (4, 4).
        free: axes of the tool's frame that are free, such as "rz" or "rz:-30:30" [deg], "z:-5:5" [mm].
        tolerance: "1mm,1deg", or a distance [m] and an angle [rad].
        name: of the argument, for messages. frame: see `Pose`.

    Raises:
        BadInput: another count of numbers, or no pose.
    """
    if isinstance(given, Pose):
        return given
    return Pose(given, free, tolerance or EXACT, name, frame)  # type: ignore[arg-type]


def matrix_of(given: str | Sequence[float] | np.ndarray, name: str, most: float) -> np.ndarray:
    """A pose (4, 4), no farther than `most` [m], from six or seven numbers, also as text, or from itself; see `Pose`.

    Raises:
        BadInput: no such numbers, or no pose; the line begins with `name`.
    """
    if isinstance(given, str):
        given = [finite_number(word, f"{name} {given}", FORM) for word in words_of(given)]
    try:
        numbers = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"{name}: expected {FORM}") from None
    if not (finite := np.isfinite(numbers)).all():
        raise BadInput(f"{name}: {numbers[~finite][0]} is not finite; expected {FORM}")
    if numbers.shape == (6,):
        no_degrees(f"{name} {','.join(f'{x:g}' for x in numbers)}", numbers[3:].tolist())
        numbers = pose_of(tuple(numbers[:3]), tuple(numbers[3:]))
    elif numbers.shape == (7,):
        size = float(np.linalg.norm(numbers[3:]))
        if not abs(size - 1) <= UNIT:
            raise BadInput(f"{name}: the quaternion has norm {size:.4g}; expected 1")
        turn = Rotation.from_quat(numbers[3:]).as_matrix()
        numbers = np.block([[turn, numbers[:3, None]], [np.zeros(3), 1.0]])
    elif numbers.ndim < 2:
        raise BadInput(f"{name}: {numbers.size} numbers; expected {FORM}")
    if numbers.shape != (4, 4):
        raise BadInput(f"{name}: expected {FORM}")
    if (far := np.abs(numbers[:3, 3]).max()) > most:
        raise BadInput(f"{name}: {far:g} m is too far; expected m (are these millimetres? {far / 1000:g} m then)")
    off = max(np.abs(numbers[:3, :3] @ numbers[:3, :3].T - np.eye(3)).max(), np.abs(numbers[3] - np.eye(4)[3]).max())
    if off > 2 * UNIT or np.linalg.det(numbers[:3, :3]) < 0:
        raise BadInput(
            f"{name}: the matrix is no pose; expected a rotation with the position beside it, and 0, 0, 0, 1"
        )
    if off > ROUNDED:
        left, _, right = np.linalg.svd(numbers[:3, :3])
        numbers = np.block([[left @ right, numbers[:3, 3:]], [np.zeros(3), 1.0]])
    return numbers


def numbers_of(matrix: np.ndarray) -> tuple[float, ...]:
    """x, y, z [m], roll, pitch, yaw [rad] of a pose (4, 4)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # if two axes coincide, any split between them is valid
        return *matrix[:3, 3].tolist(), *Rotation.from_matrix(matrix[:3, :3]).as_euler("xyz").tolist()


FORM = "X,Y,Z,R,P,Y or X,Y,Z,QX,QY,QZ,QW with lengths in m and angles in rad"


def tolerance_of(given: str | Sequence[float], name: str) -> tuple[float, float]:
    """Distance [m] and angle [rad], given as such or as `1mm,1deg`; a text may lack one, or be in m and rad.

    Raises:
        BadInput: another unit or count, a negative number, or one that is too large; the line names the pose `name`.
    """
    if isinstance(given, str):
        found = _tolerances(given, _of_key(f"--pose-tolerance {given}", name))
    else:
        try:
            numbers = np.asarray(given)
        except ValueError:  # lists of different lengths
            numbers = np.empty(0)
        if numbers.shape != (2,) or numbers.dtype.kind not in "fiu" or not ((numbers >= 0) & (numbers < np.inf)).all():
            raise BadInput(f'{name}: tolerance {given!r}; expected "1mm,1deg", or a distance [m] and an angle [rad]')
        found = float(numbers[0]), float(numbers[1])
    for value, most, unit, other in zip(found, WIDEST, ("m", "rad"), ("mm", "deg"), strict=True):
        if value > most:
            raise BadInput(f"{name}: a tolerance of {value:g} {unit}; expected {most:.3g} {unit} at most (or {other}?)")
    return max(found[0], LEAST), max(found[1], LEAST)


def _tolerances(given: str, name: str) -> tuple[float, float]:
    """Distance [m] and angle [rad] that a text contains, or the exact ones."""
    units = {"mm": (0, 1e-3), "m": (0, 1.0), "deg": (1, np.pi / 180), "rad": (1, 1.0)}
    found: dict[int, float] = {}
    for word in given.split(","):
        unit = next((u for u in ("mm", "deg", "rad", "m") if word.strip().endswith(u)), None)
        if unit is None:
            raise BadInput(f"{name}: expected a distance and an angle, such as 1mm,1deg")
        which, scale = units[unit]
        value = finite_number(word.strip().removesuffix(unit), name, "1mm,1deg") * scale
        if not value >= 0:
            raise BadInput(f"{name}: expected no negative number")
        if which in found:
            what = ("distance", "angle")[which]
            raise BadInput(f"{name}: two {what}s; expected a distance and an angle, such as 1mm,1deg")
        found[which] = value
    return found.get(0, EXACT[0]), found.get(1, EXACT[1])


def _of_key(line: str, name: str) -> str:
    """A line about an option, as one about the key of a file if the pose is that of a step."""
    return line if name.startswith("--") else f"{name}: {line.removeprefix('--').replace('pose-tol', 'pose_tol', 1)}"


def about(k: int, angle: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) about x, y or z (k = 0, 1, 2) by angles (N,) [rad]."""
    i, j = (k + 1) % 3, (k + 2) % 3
    out = np.zeros((len(angle), 3, 3))
    out[:, k, k] = 1.0
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i] = np.sin(angle)
    out[:, i, j] = -out[:, j, i]
    return out


def free_values(pose: Pose, rotation: np.ndarray, origin: np.ndarray) -> dict[str, np.ndarray]:
    """How far the tool at `rotation` (N, 3, 3), `origin` (N, 3) is along each free direction, (N,) [m or rad] by axis.

    One free turn is the twist of the quaternion, 2 atan2(q_k, q_w) = atan2(R_ji - R_ij, R_ii + R_jj); several are Euler
    angles. Whole turns bring an angle as near as they can to the middle of its range.
    """
    wanted, ranges = pose.matrix[:3, :3], {freedom.axis: (freedom.low, freedom.high) for freedom in pose.free}
    shift = (origin - pose.matrix[:3, 3]) @ wanted
    out = {axis: shift[:, k] for k, axis in enumerate("xyz") if axis in ranges}
    axes = [k for k in range(3) if TURNS[k] in ranges]
    if not axes:
        return out
    turned = np.matmul(wanted.T, rotation)
    if len(axes) == 1:
        i, j = (axes[0] + 1) % 3, (axes[0] + 2) % 3
        angles = np.arctan2(turned[:, j, i] - turned[:, i, j], turned[:, i, i] + turned[:, j, j])[:, None]
    else:
        order = [*axes, *(k for k in range(3) if k not in axes)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # if two axes coincide, any split between them is valid
            angles = Rotation.from_matrix(turned).as_euler("".join("XYZ"[k] for k in order))
    for k, angle in zip(axes, angles.T, strict=False):
        low, high = ranges[TURNS[k]]
        middle = (low + high) / 2 if np.isfinite([low, high]).all() else 0.0
        out[TURNS[k]] = (angle - middle + np.pi) % (2 * np.pi) + middle - np.pi
    return out


def pose_error(pose: Pose, rotation: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Error (N, 6) of the tool at `rotation` (N, 3, 3), `origin` (N, 3) from a pose: shift [m] in the wanted tool's
    frame, and rotation vector [rad].

    Shifts and turns in free directions, clipped to their ranges, are removed from the difference from the wanted pose
    one after the other; the rest is the error.
    """
    wanted = pose.matrix[:3, :3]
    shift = (origin - pose.matrix[:3, 3]) @ wanted
    limits = {freedom.axis: (freedom.low, freedom.high) for freedom in pose.free}
    anyhow = all(np.isinf(limits.get(turn, (0.0, 0.0))).all() for turn in TURNS)  # rotation is completely free
    turned = np.matmul(wanted.T, rotation)
    shifts_only = replace(pose, free=tuple(f for f in pose.free if f.axis not in TURNS)) if anyhow else pose
    for axis, value in free_values(shifts_only, rotation, origin).items():
        held, k = np.clip(value, *limits[axis]), "xyz".index(axis[-1])
        if axis in TURNS:
            turned = about(k, -held) @ turned
        else:
            shift[:, k] -= held
    return np.hstack([shift, np.zeros_like(shift) if anyhow else Rotation.from_matrix(turned).as_rotvec()])
