"""Reading of XML files of robots (URDF, SRDF): bounded, and without entities, which such files have no use for."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.files import read_text

LARGEST = 20_000_000  # bytes; the largest description of a robot that is known is a tenth of it


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
        raise BadInput(f"{path}: declares a document type, which is not read")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise BadInput(f"{path}: not XML that can be read: {error}") from None
    if any(map(_of_xacro, root.iter())):
        made = "robot.srdf" if ".srdf" in path.suffixes else "robot.urdf"
        raise BadInput(f"{path}: a xacro file; run xacro first: xacro {path.name} > {made}")
    if root.tag != "robot":
        raise BadInput(f"{path}: begins with <{root.tag}>; expected <robot>")
    return root


def _of_xacro(element: ElementTree.Element) -> bool:
    """Is this one of xacro's own elements, or does it hold an expression that xacro has not replaced yet?"""
    own = isinstance(element.tag, str) and "xacro" in element.tag
    return own or any("${" in value or "$(" in value for value in element.attrib.values())
