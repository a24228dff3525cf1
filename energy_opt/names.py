"""Names of joints, links and poses: readers accept only characters that every written format can hold.

Values that carry the names of joints are matched by these.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np

from energy_opt.errors import BadInput, suggest

LONGEST = 128  # most characters of a name
_NAME = re.compile(rf"(?=.{{1,{LONGEST}}}\Z)[\w\-./]+( [\w\-./]+)*")


def check_name(name: str, where: str) -> str:
    """Return the name if it consists of letters, digits, _ - . / and single inner spaces only.

    Args:
        where: the file and the named object, for the message.

    Raises:
        BadInput: another character, an empty name, or more than 128 characters.
    """
    if not _NAME.fullmatch(name):
        raise BadInput(
            f"{where}: name {name[:LONGEST]!r}; expected 1 to {LONGEST} letters, digits, _ - . / and single "
            "inner spaces"
        )
    return name


def commented(name: str) -> str:
    """The name without line breaks, quotes and control characters, for a comment or a word of a program."""
    return "".join(c if c.isprintable() and c not in "\"'`\\" else "_" for c in name)


def labels_of(values: Any) -> list[Any]:
    """Labels of a mapping or a pandas Series, or of a table's columns; empty where it has none, or only numbers."""
    names = getattr(values, "columns", None)
    names = values.keys() if names is None and hasattr(values, "keys") else names
    labels = [] if names is None else list(names)
    return [] if all(isinstance(label, Integral) for label in labels) else labels


def in_order(values: Any, joints: Sequence[str], what: str) -> Any:
    """Labelled values, or a table's columns, in the order of `joints`; values without labels as they are.

    Args:
        values: one per joint, or a column per joint. what: they are, for messages.

    Raises:
        BadInput: a label that is no joint, or is there twice, a joint without a value, or a masked or complex value.
    """
    labels = labels_of(values)
    for label in labels:
        if label not in joints:
            raise BadInput(f"{what}: unknown joint {label!r}{suggest(str(label), joints)}; joints: {', '.join(joints)}")
        if labels.count(label) > 1:
            raise BadInput(f"{what}: joint {label} is given twice")
    if labels and (missing := [joint for joint in joints if joint not in labels]):
        raise BadInput(f"{what}: no value for {', '.join(missing)}")
    found = [values[joint] for joint in joints] if labels else [values]
    if any(np.ma.is_masked(each) or np.iscomplexobj(each) for each in found):
        raise BadInput(f"{what}: masked or complex values; expected real numbers")
    return np.stack(found, axis=-1) if labels else values
