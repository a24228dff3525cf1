"""Base class of what every verb returns."""

from __future__ import annotations

from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, Self

from energy_opt.files import to_json


def exit_of(interrupted: bool, good: bool) -> int:
    """The command line's exit code of an answer: 130 where it was interrupted, 0 where it is good, else 4."""
    return 130 if interrupted else 0 if good else 4


class Found:
    """What a verb found.

    Each result class has a `document`. It overrides `kept`, which writes its files, where it has any, and `text`
    where a terminal shows a table of it.
    """

    document: Any  # the content of its JSON file, or a method that returns it

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        return 0

    def to_json(self) -> str:
        """The document as JSON text."""
        return to_json(self.document() if callable(self.document) else self.document)

    def text(self, out: Path) -> str:
        """What the command prints of a result that is saved in `out`; empty where its messages said all."""
        return ""

    def save(self, out: str | PathLike[str]) -> Path:
        """Write its files into the folder `out`, whole or not at all; returns the folder."""
        self.kept(Path(out))
        return Path(out)

    def kept(self, out: Path) -> Self:
        """Write its files into the folder `out`; returns the same with what is known of them."""
        return self

    def _repr_html_(self) -> str:
        lines = self.text(Path(".")).splitlines() or str(self).splitlines()
        return f"<pre>{escape(chr(10).join(line for line in lines if line != 'files in .'))}</pre>"
