"""Checks of a description: unusable values are refused, doubtful values cause a warning.

Masses and inertias must be plausible for an arm. Effort limits are compared with each other
and with the gravity torques, to find placeholders.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.description import MOTOR, MOVING, Description, Pose
from energy_opt.robot.kinematics import Link, pose_of
from energy_opt.robot.limits import TURNS, Limits, unit_of


def placed(pose: Pose) -> np.ndarray:
    """(4, 4) matrix of a description's pose."""
    return pose_of(pose.xyz, pose.rpy)


def inertia_matrix(moments: Sequence[float]) -> np.ndarray:
    """(3, 3) from ixx, ixy, ixz, iyy, iyz, izz."""
    xx, xy, xz, yy, yz, zz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def carriers(description: Description, still: Collection[str] = ()) -> dict[str, str]:
    """For each link the joint that moves it ("" for the base); joints in `still` move nothing."""
    out = {description.base: ""}
    while len(out) < len(description.links):  # joints may be listed before those that carry them
        for name, joint in description.joints.items():
            if joint.parent in out:
                out[joint.child] = name if joint.kind in MOVING and name not in still else out[joint.parent]
    return out


def unused_values(description: Description, joints: Sequence[str], limits: Limits) -> list[str]:
    """Remarks on values of the URDF that no plan uses: friction, motors, and ranges within the limits.

    Args:
        joints: those that move, in the order of the limits.
    """
    rubbing, motors, narrower = [], [], dict[str, list[str]]()
    for j, joint in enumerate(joints):
        part = description.joints[joint]
        stated = part.unused | (part.bounds if part.kind == "continuous" else {})
        lower, upper, most = limits.lower[j], limits.upper[j], limits.velocity[j]
        if stated.get("damping") or stated.get("friction"):
            rubbing.append(joint)
        if MOTOR.keys() & stated.keys():
            motors.append(joint)
        for what, least, largest, lowest, highest in (
            ("soft limits of <safety_controller>", "soft_lower_limit", "soft_upper_limit", lower, upper),
            ("positions of <ros2_control>", "position_min", "position_max", lower, upper),
            ("velocities of <ros2_control>", "velocity_min", "velocity_max", -most, most),
            ("lower and upper in <limit> of a continuous joint", "lower", "upper", lower, upper),
        ):
            low, high = stated.get(least, -TURNS), stated.get(largest, TURNS)  # beyond, none is meant
            low, high = (low if low > -TURNS else -np.inf), (high if high < TURNS else np.inf)
            if low < high and (low > lowest + SLACK or high < highest - SLACK):
                narrower.setdefault(what, []).append(f"{joint} [{low:g}, {high:g}]")
    remarks = {
        "damping and friction of <dynamics> are not used; give --model with friction": rubbing,
        "reduction and rotor inertia of <transmission> are not used; give --model with armature": motors,
        **{f"{what} are narrower than the limits and are not held; give --limits": narrower[what] for what in narrower},
    }
    return [f"{few(found)}: {text}" for text, found in remarks.items() if found]


def few(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


SLACK = 1e-6  # [rad, m] smaller differences of limits are rounding
MASSLESS = 1e-6  # [kg] an arm with a smaller moving mass has no masses
FARTHEST = 50.0  # [m] an arm whose joints lie farther apart is in another unit: small arms in mm have 200 and more
BARE = 0.05  # [m] a link without mass that reaches farther is no intersection of axes: its <inertial> is missing
LIGHTEST = 0.1  # [kg] a smaller moving mass of an arm causes a warning
GRAMS = 0.2  # [kg] the inertia of a link with a smaller mass is not refused
ROUNDED = 1e-3  # share by which the largest principal moment may exceed the sum of the others, as in rounded files
SLIGHT = 0.2  # share up to which this is a warning: an xArm6 as shipped has 16 %
NOISE = 1e-9  # [kg m^2] a moment may be negative by this much


def check_masses(description: Description, still: Collection[str], links: Sequence[Link]) -> list[str]:
    """Warnings on implausible masses and inertias of the moving links, one line each.

    An impossible inertia is refused if it matters: on a moving link of more than 0.2 kg, by more than a fifth, and not
    compensated by parts that are fixed to the link.

    Args:
        still: joints that do not move.
        links: the moving links with all that is fixed to them.

    Raises:
        BadInput: nothing that moves has a mass, an inertia is impossible, or lengths are in millimetres.
    """
    length = sum(float(np.linalg.norm(link.placement[:3, 3])) for link in links)
    if length > FARTHEST:
        raise BadInput(
            f"{description.path}: from joint to joint the arm is {length:.4g} m long; is the unit mm? Expected m"
        )
    carried = carriers(description, still)
    moving = [name for name, on in carried.items() if on]
    mass = sum(link.mass for link in links)
    if mass <= MASSLESS:
        raise BadInput(
            f"{description.path}: none of the moving links has a mass: {', '.join(moving)}; energy needs a description "
            "with <inertial> elements (mass, centre of mass, inertia)"
        )
    said = []
    if mass < LIGHTEST:
        said.append(f"all that moves weighs {1e3 * mass:.3g} g; are the masses in kg?")
    whole = {link.name: _inertia_excess(link.inertia) for link in links}
    odd = []
    for name, on in carried.items():
        inertial = description.links[name].inertial
        if inertial is None or (inertial.mass == 0 and not any(inertial.moments)):
            continue
        inertia = inertia_matrix(inertial.moments)
        moments, excess = np.linalg.eigvalsh(inertia), _inertia_excess(inertia)
        if excess <= ROUNDED:
            continue
        odd.append(name)
        if on and excess > SLIGHT and inertial.mass > GRAMS and whole[on] > ROUNDED:
            at = f"{description.path}: link {name!r}, inertia: "
            if moments[0] < -NOISE:
                raise BadInput(f"{at}a principal moment of {moments[0]:.3g} kg m^2 is negative (ixx … izz)")
            raise BadInput(
                f"{at}principal moments {', '.join(f'{m:.3g}' for m in moments)} kg m^2 are impossible: the "
                "largest exceeds the sum of the others (ixx … izz)"
            )
    if odd:
        said.append(f"{few(odd)}: an impossible inertia with negligible effect; used unchanged")
    solid = {on for name, on in carried.items() if on and description.links[name].collisions}
    return [*said, *_link_warnings(links, solid)]


def _inertia_excess(inertia: np.ndarray) -> float:
    """Share by which the largest principal moment exceeds the sum of the others; inf if one is negative."""
    low, middle, high = np.linalg.eigvalsh(inertia)
    if low < -max(NOISE, ROUNDED * high):
        return np.inf
    return float((high - low - middle - NOISE) / max(low + middle, NOISE))


def _link_warnings(links: Sequence[Link], solid: Collection[str]) -> list[str]:
    """Warnings on masses and inertias of whole moving links that no real part has; they are used unchanged.

    Args:
        solid: the links with collision bodies, by their joints.
    """
    out = []
    for k, link in enumerate(links):
        if link.mass <= MASSLESS:
            ends = not any(child.parent == k for child in links)
            if link.name in solid or ends or _reach(links, k, 1) > BARE:
                out.append(f"{link.name}: its link has no mass; assumed: massless")
            continue
        largest = float(np.linalg.eigvalsh(link.inertia)[-1])
        size = max(0.125, float(np.linalg.norm(link.lever)), _reach(links, k, 2))
        gyration = float(np.sqrt(max(largest, 0.0) / link.mass))
        if gyration > 2 * size:
            out.append(
                f"{link.name}: radius of gyration {gyration:.2g} m of a link {size:.2g} m long is implausible "
                "(a placeholder inertia?); used as it is"
            )
        elif largest <= 0:
            out.append(f"{link.name}: its link has mass but no inertia; assumed: a point mass")
    return out


def _reach(links: Sequence[Link], k: int, depth: int) -> float:
    """Summed offsets [m] of the next `depth` joints after link k, an estimate of the link's extent."""
    children = [c for c, other in enumerate(links) if other.parent == k]
    if depth == 0 or not children:
        return 0.0
    return max(float(np.linalg.norm(links[c].placement[:3, 3])) + _reach(links, c, depth - 1) for c in children)


SMALLEST = 1e-6  # [N m or N] a smaller limit counts as none
# equal limits of all joints are placeholders from this multiple of the largest gravity torque on. Two or three joints
# may have the same drive; of four and more, arms as sold have limits of 1.5 to 6 times it, and not all the same
EQUAL, EQUAL_OF_MANY, MANY = 100.0, 8.0, 4
# multiples of the torque that holds the arm out straight: from here on a warning, and a placeholder on one joint
DOUBTFUL, ABSURD = 100.0, 1e4
MOST = 0.5  # share of postures: a drive that cannot hold its arm in more of them has a wrong limit
DENSEST = 150.0  # [kg/m^2] mass over squared reach: industrial arms have 10 to 70
SHORTEST = 0.3  # [m] least reach in this rule
LIGHTEST_OF_SIZE = (
    4.0  # [kg/m^3] mass over cubed length: the lightest arms sold have 5 (Kinova Jaco), most have 10 to 20
)
REMEDY = "--limits with max_effort gives the real one"


def believed_efforts(
    effort: np.ndarray, given: np.ndarray, gravity: np.ndarray, holding: float, joints: Sequence[str],
    slides: Sequence[bool], fingers: Sequence[bool],
) -> tuple[np.ndarray, list[str]]:  # fmt: skip
    """Effort limits (n,) with inf in place of placeholders, and a line for each that is replaced or doubtful.

    Args:
        effort: stated (n,) [N m or N].
        given: (n,) True for limits of a limits file, which are never replaced.
        gravity: (N, n) torque that holds the arm in postures all over its range.
        holding: torque that holds the whole arm out straight [N m].
        slides, fingers: the joints that slide, and those of a gripper.
    """
    out, said = effort.copy(), []
    most = float(np.abs(gravity).max()) or holding
    stated = ~given & np.isfinite(effort) & (effort >= SMALLEST)
    alike = _alike(effort, stated, np.asarray(slides, dtype=bool), np.asarray(fingers, dtype=bool))
    far = (EQUAL if alike.sum() < MANY else EQUAL_OF_MANY) * most
    short = np.mean(np.abs(gravity) > effort, axis=0)  # share of postures that each joint cannot hold
    one_for_all = bool((short[alike] > MOST).any())
    for j, joint in enumerate(joints):
        unit = unit_of("effort", slides[j])
        text, times = f"{joint}: effort limit {effort[j]:g} {unit}", effort[j] / max(holding, SMALLEST)
        large = f"{text}, {times:.4g} times what holds the arm out straight"
        weak = float(short[j])
        if not np.isfinite(effort[j]) or effort[j] < SMALLEST:
            said.append(f"{joint}: no effort limit; assumed: none")
        elif given[j]:
            continue
        elif alike[j] and effort[j] >= far:
            said.append(
                f"{text}, the same on all joints and {effort[j] / most:.4g} times what gravity takes at most: a "
                f"placeholder; assumed: none; {REMEDY}"
            )
        elif holding > 0 and times >= ABSURD:
            said.append(f"{large}: a placeholder; assumed: none; {REMEDY}")
        elif weak > MOST:
            said.append(
                f"{text} does not hold the arm in {100 * weak:.0f} % of its postures (up to "
                f"{np.abs(gravity[:, j]).max():.3g} {unit}): a placeholder, or masses that are wrong; assumed: none; "
                f"{REMEDY}"
            )
        elif one_for_all and alike[j]:
            said.append(
                f"{text}, the same on all joints and too little for some: a placeholder; assumed: none; {REMEDY}"
            )
        else:
            if holding > 0 and times >= DOUBTFUL:
                said.append(f"{large} (a placeholder?); assumed: as stated")
            continue
        out[j] = np.inf
    return out, said


def _alike(effort: np.ndarray, stated: np.ndarray, slides: np.ndarray, fingers: np.ndarray) -> np.ndarray:
    """The joints (n,) with one limit for all of the arm, or for all of it that turns, and the fingers with the same."""
    for arm in (stated & ~fingers, stated & ~fingers & ~slides):
        if arm.sum() > 1 and np.ptp(effort[arm]) == 0:
            return arm | (stated & fingers & (effort == effort[arm][0]))
    return np.zeros_like(stated)


def doubtful_masses(effort: np.ndarray, gravity: np.ndarray, mass: float, reach: float, length: float) -> list[str]:
    """Warnings if an arm of `mass` [kg] is too heavy for its drives, or too heavy or too light for its size.

    Args:
        effort: limits (n,) [N m or N].
        gravity: (N, n) torque that holds the arm in postures all over its range.
        reach: summed offsets of all joints from the base [m].
        length: summed offsets behind the first joint of the longest branch [m]; a column below adds nothing.
    """
    out, stated = [], effort[np.isfinite(effort) & (effort >= SMALLEST)]
    share = float(np.mean(np.abs(gravity).max(axis=1) > stated.max())) if len(stated) else 0.0
    if share > MOST:
        out.append(
            f"{mass:.4g} kg move: holding them takes more than every effort limit ({stated.max():g} at most) in "
            f"{100 * share:.0f} % of the postures; masses or effort limits are wrong"
        )
    if mass > DENSEST * max(reach, SHORTEST) ** 2:
        out.append(
            f"{mass:.4g} kg move on an arm of {reach:.3g} m: several times the mass of such arms; used unchanged"
        )
    if mass < LIGHTEST_OF_SIZE * length**3:
        out.append(
            f"{mass:.4g} kg move on an arm of {length:.3g} m: a fraction of the mass of such arms; "
            "energies are too low; used unchanged"
        )
    return out
