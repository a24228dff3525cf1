"""Reading of XML files of robots (URDF, SRDF): bounded, without entities, and strict about numbers.

A number is digits with a point and an exponent, white space around it: no unit, no comma, no underscore, no infinity.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from difflib import get_close_matches
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.files import read_text

LARGEST = 20_000_000  # [bytes] largest file; the largest known description of a robot has a tenth of this
SMALLEST = 1e-290  # a smaller number is 0: readers written in C refuse numbers below 2.2e-308
SIMILAR = 0.75  # similarity from which an unknown tag counts as misspelt; "material" and "inertial" have 0.62
# Elements with poses and shapes that are not the arm's, most of them of simulators: ignored
FOREIGN = ("origin", "anchor", "contact", "surface", "self_filter", "collision_checking",
           "self_collision_checking")  # fmt: skip
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SPACE = " \t\r\n"


def read_robot_xml(path: Path) -> ElementTree.Element:
    """The element <robot> of a file.

    Raises:
        BadInput: the file is missing, too large, not XML, declares entities, or holds something else.
    """
    path = Path(path)
    if path.is_file() and path.stat().st_size > LARGEST:
        raise BadInput(f"{path}: {path.stat().st_size:,} bytes; expected at most {LARGEST:,}")
    text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput(f"{path}: declares a document type, which is not supported")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise BadInput(f"{path}: not XML; expected a URDF or SRDF: {error}") from None
    if any(map(_of_xacro, root.iter())):
        plain = "robot.srdf" if ".srdf" in path.suffixes else "robot.urdf"
        raise BadInput(f"{path}: a xacro file; run xacro first: xacro {path.name} > {plain}")
    if root.tag != "robot":
        raise BadInput(f"{path}: begins with <{root.tag}>; expected <robot>, as a URDF has; convert SDF or MJCF first")
    return root


def _of_xacro(element: ElementTree.Element) -> bool:
    """True for one of xacro's own elements, or an element with an expression that xacro has not replaced."""
    own = isinstance(element.tag, str) and "xacro" in element.tag
    return own or any("${" in value or "$(" in value for value in element.attrib.values())


def number_in(where: str, element: ElementTree.Element | None, attribute: str, default: float | None = None) -> float:
    """The number of an attribute.

    Raises:
        BadInput: it is not a finite number, or it is missing and has no default.
    """
    text = None if element is None else element.get(attribute)
    if text is None:
        if default is None:
            raise BadInput(f"{where}: {attribute} is missing; expected a number")
        return default
    value = _number(text.strip(_SPACE))
    if value is None:
        raise BadInput(f"{where}: {attribute}={text[:60]!r} is not a finite number")
    return value


def vector_in(
    where: str, element: ElementTree.Element | None, attribute: str, default: str | None = None
) -> tuple[float, float, float]:
    """Three numbers of an attribute, white space between them.

    Raises:
        BadInput: they are not three finite numbers, or missing without a default.
    """
    text = default if element is None else element.get(attribute, default)
    if text is None:
        raise BadInput(f"{where}: {attribute} is missing; expected three numbers")
    values = [_number(word) for word in re.split(f"[{_SPACE}]+", text.strip(_SPACE))]
    if len(values) != 3 or None in values:
        raise BadInput(f"{where}: {attribute}={text[:60]!r}; expected three finite numbers")
    x, y, z = (value or 0.0 for value in values)
    return x, y, z


def _number(word: str) -> float | None:
    """A word of an attribute as a number: None if it is no finite one, 0 below SMALLEST."""
    if not _NUMBER.fullmatch(word):
        return None
    value = float(word)
    if not math.isfinite(value):
        return None
    return value if abs(value) >= SMALLEST else 0.0


def only_child(where: str, element: ElementTree.Element, tag: str) -> ElementTree.Element | None:
    """The one child of that tag, None where there is none; equal copies count as one.

    Raises:
        BadInput: children of that tag differ: readers disagree on which of them counts.
    """
    found = element.findall(tag)
    # the content does not depend on white space and on the order of attributes
    contents = {repr([(e.tag, sorted((k, v.split()) for k, v in e.attrib.items())) for e in c.iter()]) for c in found}
    if len(contents) > 1:
        raise BadInput(f"{where}: <{tag}> is given {len(found)} times with different content; keep one")
    return found[0] if found else None


def _is_identity_pose(element: ElementTree.Element) -> bool:
    """True for a place at its default, whatever its name: only xyz and rpy, all of them 0."""
    values = [word for text in element.attrib.values() for word in text.split()]
    zero = bool(values) and all(re.fullmatch(r"[-+]?0+(\.0*)?", word) for word in values)
    return zero and element.attrib.keys() <= {"xyz", "rpy"} and len(element) == 0


def refuse_unread(
    where: str,
    element: ElementTree.Element,
    children: tuple[str, ...] = (),
    attributes: tuple[str, ...] | None = None,
    elsewhere: frozenset[str] = frozenset(),
    within: bool = True,
) -> None:
    """Refuse elements and attributes that would be ignored although their author meant them to count.

    Args:
        children: tags that are read here; a similar tag counts as misspelt.
        attributes: those that are read; None to allow others.
        elsewhere: tags that are read at another place only.
        within: True if unknown children must not contain places, shapes or masses either.

    Raises:
        BadInput: names the child or the attribute.
    """
    for child in element:
        tag = child.tag if isinstance(child.tag, str) else ""
        plain = tag.rpartition("}")[2].lower()
        if tag in children or _is_identity_pose(child):
            continue
        place = within and ({"xyz", "rpy"} & child.attrib.keys() or {part.tag for part in child.iter()} & elsewhere)
        if plain in elsewhere or (place and plain not in FOREIGN) or get_close_matches(plain, children, 1, SIMILAR):
            read = ", ".join(f"<{name}>" for name in children) or "nothing"
            raise BadInput(f"{where}: <{tag[:60]}> is not read here; expected {read}")
    unread = [] if attributes is None else [key for key in element.attrib if key not in attributes]
    if unread and attributes is not None:
        raise BadInput(
            f"{where}: attribute {unread[0]!r} is not known; expected {', '.join(attributes)}; if it changes no place, "
            "size or mass, remove it from the file"
        )
