"""A field of a request, and the request itself: checked when it is built, written down as a document, read back.

A request is a frozen dataclass. Each field is declared once with `option(...)`: default, one sentence, unit. From these
the command line derives its options, `document` and `from_document` the JSON that repeats a request, and `schema` its
JSON schema.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from energy_opt.arguments import expect
from energy_opt.errors import BadInput, shown, suggest
from energy_opt.files import path_of
from energy_opt.files import plain as of_json

ON_OFF = ("on", "off")  # True and False, as words
KINDS = {float: "number", int: "integer", bool: "boolean"}  # types of JSON schema, by kind of value
TEXTS = {"str", "Sequence[str]", "None"}  # parts of the types of fields that take only text
NESTED = ("settings", "cell", "per_year")  # tables in requests of earlier versions, whose keys are options now
STAMP = ("verb", "version", "command")  # entries of a document besides the request's own fields
RENAMED = {"locked": "lock", "ways": "initial_paths"}  # names of fields in earlier versions, with their present names


@dataclass(frozen=True)
class Option:
    """Help text, spelling on the command line, and type of a field.

    Attributes:
        help: one sentence, with the unit and the default.
        metavar: what the value is called; for a positional argument, its name.
        kind: float, int, bool, Path, or str for what is parsed later (numbers, names, poses); as the field's type says.
        many: it may be given several times, and is a tuple; several: it may, and is a tuple if it is.
        place: how many of a positional argument there are: "1", "?", "*" or "+"; empty where it has a flag.
        nargs: how many words an option takes where that is not one.
        flag: the option's name where it is not the field's; aliases: others that mean the same.
        choices: the values there are.
        main: it is one of the few that `--help` shows; hidden: it is taken, so that scripts may give it to every verb
            with a cell, and no help shows it.
        internal: the command line has no option for it; written: it is in the request's document.
    """

    help: str
    metavar: str = ""
    kind: type = str
    many: bool = False
    several: bool = False
    place: str = ""
    nargs: str | int | None = None
    flag: str = ""
    aliases: tuple[str, ...] = ()
    choices: tuple[str, ...] = ()
    main: bool = False
    hidden: bool = False
    internal: bool = False
    written: bool = True


def option(default: Any, help: str, metavar: str = "", **more: Any) -> Any:
    """A dataclass field with its `Option`.

    Args:
        default: the field's; ... if it has none. help: one line. metavar: how the help shows its value.
        more: further attributes of the `Option`.
    """
    if default is ...:
        return field(metadata={"option": Option(help, metavar, **more)})
    return field(default=default, metadata={"option": Option(help, metavar, **more)})


def options_of(request: type[Request]) -> dict[str, tuple[Field[Any], Option]]:
    """The fields of a request and how each is spelled, by name."""
    out = {}
    for f in (f for f in fields(request) if "option" in f.metadata):
        words = set(re.findall(r"\w+", str(f.type))) - {"None", "Sequence"}
        alone = {"float": float, "int": int, "bool": bool}.get(words.pop(), str) if len(words) == 1 else str
        out[f.name] = f, replace(f.metadata["option"], kind=Path if words == {"str", "PathLike"} else alone)
    return out


def flag_of(name: str, spelled: Option) -> str:
    """The option's name on the command line, such as `--max-duration`."""
    return spelled.flag or f"--{name.replace('_', '-')}"


@dataclass(frozen=True, kw_only=True)
class Request:
    """The request to a verb: an immutable value whose fields are checked.

    Each verb states its name, its `summary` (its purpose in one line), the default folder of its `results` (empty if it
    has none, or if a field says it), whether that folder gets a `report`.html, the file of its `answer` there, and
    whether its text is `printed` with --quiet, too, because it is the answer.

    Attributes:
        stopped: called from time to time while a verb searches; True ends the work with the best result so far.
    """

    verb: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    results: ClassVar[str] = ""
    report: ClassVar[bool] = False
    answer: ClassVar[str] = ""
    printed: ClassVar[bool] = False
    always: ClassVar[tuple[str, ...]] = ()  # fields that the document always contains

    stopped: Callable[[], bool] | None = option(
        None, "a function; if it returns True, optimize, tradeoff, job, place and diagnose end with the best result so "
        "far; other verbs ignore it", internal=True, written=False,
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name, (declared, spelled) in options_of(type(self)).items():
            flag, value = flag_of(name, spelled), getattr(self, name)
            value = declared.default if spelled.many and value is None else value
            if value is None and declared.default is MISSING:
                raise BadInput(f"{flag} is missing: {spelled.help}")
            if declared.default is None and type(value) in (list, tuple) and not value:
                raise BadInput(f"{flag}: an empty list; give at least one, or leave it out")
            if value is not None and spelled.written:
                text = TEXTS.issuperset(str(declared.type).split(" | "))
                object.__setattr__(self, name, _checked(flag, spelled, value, text))

    def document(self) -> dict[str, Any]:
        """The request as JSON values: the fields that differ from their defaults, and those in `always`."""
        out: dict[str, Any] = {"verb": self.verb}
        for name, (declared, spelled) in options_of(type(self)).items():
            if not spelled.written:
                continue
            value = plain(getattr(self, name))
            usual = None if declared.default is MISSING else plain(declared.default)
            if name in self.always or value != usual:
                out[name] = value
        return out

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """The request that a document describes.

        Raises:
            BadInput: an unknown key, or a value of another type; the message names it.
        """
        given = {key: value for key, value in document.items() if key not in (*STAMP, *NESTED)}
        for table in NESTED:
            if not isinstance(document.get(table) or {}, Mapping):
                raise BadInput(f"{table} = {shown(document[table])}: expected a table")
            given |= document.get(table) or {}
        given = {RENAMED.get(key, key): value for key, value in given.items()}
        known = {name for name, (_, spelled) in options_of(cls).items() if spelled.written}
        given = cls.read(given)
        for key in given:
            if key not in known:
                raise BadInput(f"a request of {cls.verb} has no {key!r}{suggest(key, known)}")
        try:
            return cls(**{key: value for key, value in given.items() if value is not None})
        except TypeError as fault:
            raise BadInput(f"a request of {cls.verb}: {str(fault).partition('() ')[2]}") from None

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """The keys of a document as fields. Requests whose documents differ from their fields override this."""
        return given

    @classmethod
    def schema(cls) -> dict[str, Any]:
        """The JSON schema of the request's document."""
        properties: dict[str, Any] = {"verb": {"const": cls.verb}}
        for name, (_, spelled) in options_of(cls).items():
            if not spelled.written:
                continue
            row: dict[str, Any] = {"type": KINDS[spelled.kind]} if spelled.kind in KINDS else {}
            row |= {"enum": list(spelled.choices)} if spelled.choices else {}
            row = {"type": "array", "items": row} if spelled.many else row
            properties[name] = {**row, "description": spelled.help}
        required = [f.name for f, s in options_of(cls).values() if f.default is MISSING and s.written]
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": cls.__name__,
            "type": "object",
            "properties": properties,
            "required": required,
        }

    def __getitem__(self, key: str) -> Any:
        """A value as it is in the document."""
        return self.document()[key]


def _checked(flag: str, spelled: Option, value: Any, text: bool) -> Any:
    """A value of the kind that its option has; `text`: nothing else than text is taken.

    Raises:
        BadInput: it is of another kind, or none of the choices.
    """
    if isinstance(value, Iterator):  # it can be read only once
        value = list(value)
    if spelled.many or spelled.place in ("*", "+"):
        several = list(value) if isinstance(value, (list, tuple)) or hasattr(value, "tolist") else [value]
        return tuple(_one(flag, spelled, each, text) for each in several)
    return _one(flag, spelled, value, text)


def _one(flag: str, spelled: Option, value: Any, text: bool) -> Any:
    """One value of the kind of its option.

    Raises:
        BadInput: it is of another kind, or none of the choices.
    """
    if getattr(value, "ndim", None) == 0:  # one of NumPy's
        value = value.item()
    if spelled.kind is Path:
        return path_of(value, flag)
    if spelled.kind is bool and isinstance(value, str) and value in ON_OFF:
        return value == "on"
    if text and not isinstance(value, str):
        raise BadInput(f"{flag} {shown(value)}: expected text: {spelled.help}")
    if spelled.kind in KINDS:
        expect(value, spelled.kind, flag)
    if spelled.choices and value not in spelled.choices:
        raise BadInput(f"{flag} {shown(value)}: expected one of {', '.join(spelled.choices)}")
    return spelled.kind(value) if spelled.kind in KINDS else value


def plain(value: Any) -> Any:
    """A value as JSON has it: names of files as text, arrays as lists, models as their documents."""
    if hasattr(value, "to_document"):
        return value.to_document()
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if hasattr(value, "for_robot"):  # a user's own limit has no text form
        return f"{type(value).__module__}.{type(value).__qualname__}"
    return of_json(value)
