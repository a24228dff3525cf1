"""Names of joints, links and poses: what is taken where they come in, so that no writer can be broken by one."""

from __future__ import annotations

import re

from energy_opt.errors import BadInput

LONGEST = 128  # most characters of a name
_NAME = re.compile(rf"[\w\-./]{{1,{LONGEST}}}")


def check_name(name: str, where: str) -> str:
    """The name, where it consists of letters, digits and _ - . / alone.

    Args:
        where: the file, and what bears the name, for the message.

    Raises:
        BadInput: another character, none at all, or more than 128.
    """
    if not _NAME.fullmatch(name):
        raise BadInput(f"{where}: name {name[:LONGEST]!r}; expected 1 to {LONGEST} letters, digits and _ - . /")
    return name


def commented(name: str) -> str:
    """A name as it may stand in a comment or a word of a program: no line breaks, quotes or other controls."""
    return "".join(c if c.isprintable() and c not in "\"'`\\" else "_" for c in name)
