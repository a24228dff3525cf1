"""Which effort limits of a URDF are real? A placeholder shows beside the others, and beside what gravity takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.robot.units import unit_of

SMALLEST = 1e-6  # [N m or N] weaker than this nothing moves
EQUAL = 100.0  # limits that are equal on all joints and this many times what gravity ever takes are placeholders
DOUBTFUL, ABSURD = 100.0, 1e4  # times what holds the arm out straight: named but used, and a placeholder if one alone
MOST = 0.5  # share of postures: a drive that cannot hold its arm in more of them is another one
DENSEST = 150.0  # [kg/m^2] mass over squared reach: industrial arms have 10 to 70
SHORTEST = 0.3  # [m] below it the rule says nothing of use
LIGHTEST = 4.0  # [kg/m^3] mass over cubed length: the lightest arms sold have 5 (Kinova Jaco), most have 10 to 20
REMEDY = "--limits with max_effort gives the real one"


def believed_efforts(
    effort: np.ndarray, given: np.ndarray, gravity: np.ndarray, holding: float, joints: Sequence[str],
    slides: Sequence[bool],
) -> tuple[np.ndarray, list[str]]:  # fmt: skip
    """Effort limits (n,) with inf in place of placeholders, and a line for each that is replaced or doubtful.

    Args:
        effort: stated (n,) [N m or N].
        given: (n,) those that a limits file states: nobody's number is overruled.
        gravity: (N, n) what holds the arm in postures all over its range.
        holding: what holds the whole arm out straight [N m].
    """
    out, said = effort.copy(), []
    most = float(np.abs(gravity).max()) or holding
    turning = ~np.asarray(slides, dtype=bool) & ~given
    same = turning.sum() > 1 and bool((effort[turning] == effort[turning][0]).all())
    short = np.mean(np.abs(gravity) > effort, axis=0)  # share of postures that each joint does not hold
    one_for_all = same and bool((short[turning] > MOST).any())
    for j, joint in enumerate(joints):
        unit = unit_of("effort", slides[j])
        stated, times = f"{joint}: effort limit {effort[j]:g} {unit}", effort[j] / max(holding, SMALLEST)
        large = f"{stated}, {times:.0f} times what holds the arm out straight"
        alike = same and bool(turning[j]) and effort[j] >= EQUAL * most
        weak = float(short[j])
        if not np.isfinite(effort[j]) or effort[j] < SMALLEST:
            said.append(f"{stated}; assumed: none")
        elif given[j]:
            continue
        elif alike:
            said.append(
                f"{stated}, the same on all joints and {effort[j] / most:.0f} times what gravity takes at most: a "
                f"placeholder; assumed: none; {REMEDY}"
            )
        elif holding > 0 and times >= ABSURD:
            said.append(f"{large}: a placeholder; assumed: none; {REMEDY}")
        elif weak > MOST:
            said.append(
                f"{stated} does not hold the arm in {100 * weak:.0f} % of its postures (up to "
                f"{np.abs(gravity[:, j]).max():.3g} {unit}): a placeholder, or masses that are wrong; assumed: none; "
                f"{REMEDY}"
            )
        elif one_for_all and turning[j]:
            said.append(
                f"{stated}, the same on all joints and too little for some: a placeholder; assumed: none; {REMEDY}"
            )
        else:
            if holding > 0 and times >= DOUBTFUL:
                said.append(f"{large} (a placeholder?); assumed: as stated")
            continue
        out[j] = np.inf
    return out, said


def doubtful_masses(effort: np.ndarray, gravity: np.ndarray, mass: float, reach: float, length: float) -> list[str]:
    """Lines where an arm of `mass` [kg] is too heavy for its drives, or too heavy or too light for its size.

    Args:
        effort: limits (n,) [N m or N].
        gravity: (N, n) what holds the arm in postures all over its range.
        reach: summed offsets of all joints from the base [m].
        length: summed offsets behind the first joint [m]; a column below the arm adds nothing.
    """
    out, stated = [], effort[np.isfinite(effort) & (effort >= SMALLEST)]
    share = float(np.mean(np.abs(gravity).max(axis=1) > stated.max())) if len(stated) else 0.0
    if share > MOST:
        out.append(
            f"{mass:.4g} kg move: holding them takes more than every effort limit ({stated.max():g} at most) in "
            f"{100 * share:.0f} % of the postures; masses or effort limits are wrong"
        )
    if mass > DENSEST * max(reach, SHORTEST) ** 2:
        out.append(f"{mass:.4g} kg move on an arm of {reach:.3g} m: several times what such arms weigh; used as it is")
    if mass < LIGHTEST * length**3:
        out.append(
            f"{mass:.4g} kg move on an arm of {length:.3g} m: a fraction of what such arms weigh; "
            "energies are too low; used as it is"
        )
    return out
