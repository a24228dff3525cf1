"""Base class of what every verb returns."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, KeysView, Mapping
from dataclasses import dataclass
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, Self

from energy_opt.errors import BadInput, shown, suggest
from energy_opt.files import plain, to_json
from energy_opt.folders import digest_of, no_foreign_files, no_other_verb, written_whole


def exit_of(interrupted: bool, good: bool) -> int:
    """Exit code of the command line: 130 if the work was interrupted, 0 if the answer is good, else 4."""
    return 130 if interrupted else 0 if good else 4


def interrupted_words(interrupted: bool, more: str = "") -> list[str]:
    """The warning of a result whose work was interrupted; `more` says how to go on."""
    return [f"interrupted: this is the best so far, not a finished search{more}"] if interrupted else []


class Document(dict[str, Any]):
    """The content of a JSON file, from a result's `document()`; `document[name]` is version 0.1's form of it."""

    def __call__(self) -> Self:
        """The content."""
        return self


class Found:
    """The result of a verb.

    Each result class has a method `document`. It overrides `kept`, which writes its files, where it has any, and `text`
    where a terminal shows a table of it.
    """

    document: Any  # a method that returns the content of its JSON file
    answer = ""  # the file in a folder that shows that it holds such a result, see `folders.ANSWERS`

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        return 0

    def __getitem__(self, key: str) -> Any:
        """A value of the document: `found["energy_total"]` is what its JSON file has under this name.

        Raises:
            KeyError: the document has no such name; says which it has.
        """
        content = self.document()
        if key not in content:
            raise KeyError(f"no value {key!r}; values are {', '.join(content)}{suggest(str(key), content)}")
        return plain(content[key])

    def keys(self) -> KeysView[str]:
        """The names of the document's values; with these and `[key]`, `dict(found)` is the document."""
        return self.document().keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def to_json(self) -> str:
        """The document as JSON text."""
        return to_json(self.document())

    def text(self, out: Path) -> str:
        """Text that the command prints for a result saved in `out`; empty if the messages are enough."""
        return ""

    def save(self, out: str | PathLike[str], *, force: bool = False) -> Path:
        """Write all files of the result into the folder `out`, or none on an error; return the folder.

        The files of an earlier result of the same verb are replaced. Results that only show something (`check`,
        `robots`) have no files: nothing is written.

        Args:
            force: replace all files that are in the way.

        Raises:
            BadInput: files of another verb, or files that no result there lists, would be replaced; or `out` cannot be
                written.
        """
        if not isinstance(out, (str, PathLike)):
            raise BadInput(f"save {shown(out)}: expected the name of a folder")
        folder = Path(out)
        if not force:
            self.guarded(folder)
        self.kept(folder)
        return folder

    def guarded(self, out: Path) -> None:
        """Refuse a folder where the result's files would replace those of another verb, or foreign ones."""
        if self.answer:
            no_other_verb(out, self.answer)
            no_foreign_files(out, self.answer)

    def kept(self, out: Path) -> Self:
        """Write the result's files into the folder `out`; return the result, completed with data on these files."""
        return self

    def __str__(self) -> str:
        """The text that the command prints, without the line on the folder; the `repr` if there is none."""
        lines = (line for line in self.text(Path(".")).splitlines() if line != "files in .")
        return "\n".join(lines) or repr(self)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


class FoundSet(Found):
    """A measured set that its verb wrote into the folder `out`; `save` copies it."""

    out: Path
    answer = "log.toml"

    def guarded(self, out: Path) -> None:
        """Refuse a folder with the results of a verb, or with another file of the same name."""
        no_other_verb(out, self.answer)
        for path in (file for file in self.out.rglob("[!.]*") if file.is_file()):
            held = out / path.relative_to(self.out)
            if digest_of(held) not in (None, digest_of(path)):
                raise BadInput(f"{held}: another file of this name; choose another folder, or add --force")

    def kept(self, out: Path) -> Self:
        """Copy the folder, except hidden files."""
        if out.resolve() != self.out.resolve():
            with written_whole(out, self.answer) as aside:
                shutil.copytree(self.out, aside, ignore=shutil.ignore_patterns(".*"), dirs_exist_ok=True)
        return self


@dataclass(frozen=True, eq=False)
class Listing(Found):
    """Records that a verb only shows: `found` holds them by name, and `words` is the text that is printed."""

    found: Mapping[str, Any]
    words: str

    def document(self) -> Mapping[str, Any]:
        """The records."""
        return self.found

    def text(self, out: Path) -> str:
        """The words."""
        return self.words
