"""Errors that a caller can act on; each class knows the command line's exit code.

A message names options of the command line, such as `--max-duration`. If the call came from Python, it says
`max_duration`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import KW_ONLY, InitVar, dataclass, fields, replace
from difflib import get_close_matches
from math import ceil, floor, inf, log10
from traceback import extract_tb
from typing import Any, TypeVar

OTHERWISE = {"as": "standard", "force": "force=True"}  # how a call says what differs from the option
_QUOTED = r"`[^`]*`|(?<!\w)'[^'\n]*'(?!\w)"  # a user's words, in which `--word` is no option
_ARGUMENT = r"(?<![\w/-])--(?!force\b(?<!add --force)(?<!with --force))([a-z][a-z-]*)(?![a-z-]|\.\w)"
_WORDS = re.compile(f"{_QUOTED}|{_ARGUMENT}")
LONGEST = 300  # most characters of a fault's text: libraries list every form of a call
MOST = 20  # most faults of a file that are named; the rest is counted
Read = TypeVar("Read")

_options: ContextVar[bool] = ContextVar("messages speak of options", default=False)


@contextmanager
def speaking_of_options() -> Iterator[None]:
    """Within this context, messages name options of the command line, not arguments of functions."""
    before = _options.set(True)
    try:
        yield
    finally:
        _options.reset(before)


def in_words(message: str) -> str:
    """The message with options, or with arguments for a caller from Python; quotes and `backticks` stay as they are."""
    if _options.get():
        return message

    def said(found: re.Match[str]) -> str:
        return OTHERWISE.get(found[1], found[1].replace("-", "_")) if found[1] else found[0]

    return _WORDS.sub(said, message)


def suggest(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'panda'?` if a known name is similar to the word, else an empty text."""
    found = get_close_matches(word.lower(), list(known), 1, 0.6)
    return f"; did you mean {found[0]!r}?" if found else ""


def shown(value: object) -> str:
    """A value as a message shows it: its `repr` in one line, cut to 60 characters.

    >>> shown("panda"), shown([1, 2])
    ("'panda'", '[1, 2]')
    """
    return " ".join(repr(value).split())[:60]


FAILED = "planned at that duration, or a little longer, no valid motion was found: more time is needed"


def at_least(seconds: float) -> str:
    """A least duration [s] for a message, rounded up: what is read and typed again must not be too short.

    >>> at_least(0.88974213), at_least(1.5), at_least(10.40031)
    ('0.889743', '1.5', '10.4004')
    """
    if not 0 < seconds < inf:
        return f"{seconds:g}"
    digit = 10.0 ** (floor(log10(seconds)) - 5)
    return f"{ceil(seconds / digit - 1e-6) * digit:.6g}"


def one_line_of(fault: BaseException, file: str) -> str:
    """A fault of a user's own Python `file` in one line: kind, text, and the line of the file where it arose."""
    lines = [frame.lineno for frame in extract_tb(fault.__traceback__) if frame.filename == file]
    text = " ".join(str(fault).split())[:LONGEST]
    return f"{type(fault).__name__}: {text}" + (f" (line {lines[-1]})" if lines else "")


class EnergyOptError(Exception):
    """Root of every error that the package raises on purpose: one clear line, no traceback needed.

    `about` holds further values for the JSON document of the failure.
    """

    exit_code = 1
    status = "failed"

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.about: dict[str, Any] = {}

    def __str__(self) -> str:
        return in_words(str(self.args[0]))

    def document(self) -> dict[str, Any]:
        """The document that --json prints after a failure."""
        return {"status": self.status, "message": str(self), **self.about}


class BadInput(EnergyOptError):
    """An argument, a file or a value is not usable: what, where, and what would be right."""

    exit_code = 2
    status = "bad_input"


def refuse(faults: Iterable[str]) -> None:
    """Raise BadInput with a line for each fault, of very many with their number at the end; do nothing without any."""
    found = list(faults)
    more = [f"and {len(found) - MOST} more faults"] if len(found) > MOST else []
    if found:
        raise BadInput("\n".join([*found[:MOST], *more]))


def read_each(read: Callable[..., Read], each: Iterable[Iterable[Any]]) -> list[Read]:
    """What `read` returns for each tuple of arguments; BadInput with a line for each fault if it raises some."""
    values, faults = [], []
    for given in each:
        try:
            values.append(read(*given))
        except BadInput as error:
            faults += str(error).splitlines()
    refuse(faults)
    return values


@dataclass(eq=False, repr=False)
class Infeasible(EnergyOptError):
    """No trajectory satisfies the limits.

    Attributes:
        joint: the joint whose limit cannot be held, or None where no single joint is to blame.
        limit: the name of a limit ("velocity", "power", ...) or "duration".
        time: time within the motion at which the limit is exceeded, s; None if unknown.
        position: path position in [0, 1]; None where it has no meaning.
        excess: by how much, as a fraction of the bound, or of the duration that was asked for.
        shortest_duration: the shortest duration that would work, s, where one is known.
    """

    exit_code = 3
    status = "infeasible"

    message: InitVar[str]
    _: KW_ONLY
    joint: str | None = None
    limit: str | None = None
    time: float | None = None
    position: float | None = None
    excess: float | None = None
    shortest_duration: float | None = None

    def __post_init__(self, message: str) -> None:
        super().__init__(message)

    def with_shortest_duration(self, shortest: float | None, why: str = FAILED) -> Infeasible:
        """The same error with another shortest duration [s], also in its message; None if none works, and `why`."""
        message = str(self.args[0])
        if shortest is None:
            message += f"; {why}"
        elif self.shortest_duration is not None:
            message = message.replace(f"{at_least(self.shortest_duration)} s", f"{at_least(shortest)} s")
        return replace(self, message=message, shortest_duration=shortest)

    def document(self) -> dict[str, Any]:
        """With joint, limit, place, excess and the shortest duration that would work."""
        return super().document() | {each.name: getattr(self, each.name) for each in fields(self)}
