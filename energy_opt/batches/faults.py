"""Faults of a suite, collected, and where its files may lie."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeGuard

from energy_opt.files import inside


def is_number(value: object) -> TypeGuard[int | float]:
    """Is an entry a number that a float can hold? (TOML's integers may have thousands of digits.)"""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


@dataclass
class Faults:
    """Faults found so far; `within` gives a view that names where it is."""

    lines: list[str] = field(default_factory=list)
    where: str = ""

    def add(self, key: str, text: str) -> None:
        """Note a fault once."""
        line = f"{self.where}{key}: {text}"
        if line not in self.lines:
            self.lines.append(line)

    def within(self, where: str) -> Faults:
        """The same list with `where` put before every key."""
        return Faults(self.lines, self.where + where)

    def __bool__(self) -> bool:
        return bool(self.lines)


@dataclass(frozen=True)
class Files:
    """Where a suite's files may lie: in its folder, or anywhere where that was allowed or an option named the file."""

    folder: Path
    allow_outside: bool = False
    options: frozenset[str] = frozenset()
    allow_large: bool = False

    def path(self, name: str, key: str) -> Path:
        """The path of a file that the entry `key` names."""
        return inside(self.folder, name, self.allow_outside or key in self.options)
