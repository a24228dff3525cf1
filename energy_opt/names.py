"""Names of joints, links and poses: readers accept only characters that every written format can hold."""

from __future__ import annotations

import re

from energy_opt.errors import BadInput

LONGEST = 128  # most characters of a name
_NAME = re.compile(rf"[\w\-./]{{1,{LONGEST}}}")


def check_name(name: str, where: str) -> str:
    """Return the name if it consists of letters, digits and _ - . / only.

    Args:
        where: the file and the named object, for the message.

    Raises:
        BadInput: another character, an empty name, or more than 128 characters.
    """
    if not _NAME.fullmatch(name):
        raise BadInput(f"{where}: name {name[:LONGEST]!r}; expected 1 to {LONGEST} letters, digits and _ - . /")
    return name


def commented(name: str) -> str:
    """The name without line breaks, quotes and control characters, for a comment or a word of a program."""
    return "".join(c if c.isprintable() and c not in "\"'`\\" else "_" for c in name)
