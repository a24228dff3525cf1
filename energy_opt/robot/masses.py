"""Are the masses and inertias of a description those of an arm? What no plan can rest on is refused, the rest named."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.description import Description
from energy_opt.robot.held import carriers, inertia_matrix
from energy_opt.robot.links import Link

MASSLESS = 1e-6  # [kg] moving mass below which an arm has none
LIGHTEST = 0.1  # [kg] moving mass below which an arm is worth a warning
GRAMS = 0.2  # [kg] mass of a link below which its inertia is
ROUNDED = 1e-3  # share by which the largest principal moment may exceed the sum of the others: rounded files do
SLIGHT = 0.2  # share up to which it is a warning: an xArm6 as shipped has 16 %
NOISE = 1e-9  # [kg m^2] that a moment may be negative by


def check_masses(description: Description, still: Collection[str], links: Sequence[Link]) -> list[str]:
    """What is doubtful of the moving links' masses and inertias, one line each.

    An inertia that belongs to no body is refused where it matters: on a link that moves, of more than 0.2 kg, by more
    than a fifth, and not made good by what is fixed to the link.

    Args:
        still: joints that do not move.
        links: the moving links with all that is fixed to them.

    Raises:
        BadInput: nothing that moves has a mass, or an inertia is that of no body.
    """
    carried = {name: on for name, (on, _) in carriers(description, still).items()}
    moving = [name for name, on in carried.items() if on]
    mass = sum(link.mass for link in links)
    if mass <= MASSLESS:
        raise BadInput(
            f"{description.path}: none of the moving links has a mass: {', '.join(moving)}; energy needs a description "
            "with <inertial> elements (mass, centre of mass, inertia)"
        )
    said = []
    if mass < LIGHTEST:
        said.append(f"{description.path.stem}: all that moves weighs {1e3 * mass:.3g} g; are the masses in kg?")
    whole = {link.name: _excess(link.inertia) for link in links}
    odd = []
    for name, on in carried.items():
        inertial = description.links[name].inertial
        if inertial is None or (inertial.mass == 0 and not any(inertial.moments)):
            continue
        inertia = inertia_matrix(inertial.moments)
        moments, excess = np.linalg.eigvalsh(inertia), _excess(inertia)
        if excess <= ROUNDED:
            continue
        odd.append(name)
        if on and excess > SLIGHT and inertial.mass > GRAMS and whole[on] > ROUNDED:
            at = f"{description.path}: link {name!r}, inertia: "
            if moments[0] < -NOISE:
                raise BadInput(f"{at}a principal moment of {moments[0]:.3g} kg m^2 is negative (ixx … izz)")
            raise BadInput(
                f"{at}principal moments {', '.join(f'{m:.3g}' for m in moments)} kg m^2 are those of no body: the "
                "largest exceeds the sum of the others (ixx … izz)"
            )
    if odd:
        shown = ", ".join(odd[:6]) + (f" and {len(odd) - 6} more" if len(odd) > 6 else "")
        said.append(f"{shown}: inertia of no body, too slight, too light or too still to matter; used as it is")
    return [*said, *_doubtful(links)]


def _excess(inertia: np.ndarray) -> float:
    """By what share the largest principal moment exceeds the sum of the others; inf where one is negative."""
    low, middle, high = np.linalg.eigvalsh(inertia)
    if low < -max(NOISE, ROUNDED * high):
        return np.inf
    return float((high - low - middle - NOISE) / max(low + middle, NOISE))


def _doubtful(links: Sequence[Link]) -> list[str]:
    """Masses and inertias of whole moving links that cannot be those of real parts; used as they are."""
    out = []
    for k, link in enumerate(links):
        if link.mass <= MASSLESS:
            if not any(child.parent == k for child in links):
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
    """Summed offsets of the next `depth` joints after link k, m: how far the link may extend."""
    children = [c for c, other in enumerate(links) if other.parent == k]
    if depth == 0 or not children:
        return 0.0
    return max(float(np.linalg.norm(links[c].placement[:3, 3])) + _reach(links, c, depth - 1) for c in children)
