"""The desk of a verb: its output folder, its messages and progress, and requests to stop.

A call from Python uses a silent desk that writes nothing. The command line uses a desk that prints to the terminal.
"""

from __future__ import annotations

import functools
import inspect
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import Field, dataclass, field
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast, get_args, get_type_hints
from warnings import warn

from energy_opt import __version__
from energy_opt.errors import BadInput, Infeasible, suggest
from energy_opt.files import write_json
from energy_opt.folders import guard, written_whole
from energy_opt.numerics.interrupts import interrupted_at_end
from energy_opt.requests.option import Option, Request, flag_of, options_of
from energy_opt.results import Found

# The values that Python takes, where they differ from those of the command line. n: number of joints.
FORMS = {
    "robot": "also a `Robot`",
    **dict.fromkeys(("model", "plant"), "also a `PowerModel`"),
    "models": "also a `PowerModel` or a `Robot`",
    "AnyMotion": "also each `Trajectory` or result of `optimize` or `job`",
    "lock": "a mapping from joint names to positions",
    "payload": "a mass, (mass, x, y, z), or an `effects.Payload`",
    "start": "a sequence (n,) in the robot's order, a mapping from joint names, or a pose (`pose_from`)",
    "goal": "as `start`; alternatives as `AnyOf([...])`",
    "scene": "also the unchanged `Scene` of `load_scene(FILE)`",
    "path": "an array (K, n), a table with joint names, a `Trajectory` or result, a function q(s) on [0, 1], or a file",
    "via": "each as `start`",
    **dict.fromkeys(("start_pose", "goal_pose", "via_pose"), "as `pose_from` takes it"),
    "conditions": "objects of `energy_opt.conditions`, your own limits, or names of files that define them",
    "durations": "a sequence, or text FIRST:LAST:COUNT",
    "job": "a file, or its content as a mapping",
    "request": "also a result, its request, or a mapping",
}

P = ParamSpec("P")
Asked = TypeVar("Asked", bound=Request)

Given = TypeVar("Given", bound=Found)


@dataclass(frozen=True, repr=False, kw_only=True, eq=False)
class Answered(Found):
    """The result of a verb with its request.

    Attributes:
        request: as asked, with its words and files resolved; `run` repeats it.
        stamp: version, and the command line where there was one.
    """

    request: Any
    stamp: Mapping[str, Any] = field(default_factory=dict)

    @property
    def asked(self) -> dict[str, Any]:
        """The request's document, stamped."""
        return {**self.request.document(), **self.stamp}


class Show:
    """Progress that is not shown."""

    def __call__(self, text: str, share: float | None = None) -> None:
        """The verb begins to do `text`; `share` of all its work is done."""

    def stage(self, text: str, low: float, high: float) -> None:
        """The verb begins to do `text`, which takes all its work from the share `low` to `high`."""


@dataclass(frozen=True)
class Desk:
    """A silent desk.

    Attributes:
        out: the folder that the verb writes into; None: the answer is only returned.
        force: overwrite the results of another request in the folder.
        command: the words of the command line; None for a call from Python.
        ends: returns True to end the work with the best result so far.
        quiet: print no messages and no progress. verbose: print each step of the work.
    """

    out: Path | None = None
    force: bool = False
    command: tuple[str, ...] | None = None
    ends: Callable[[], bool] = bool  # `bool()` is False
    quiet: bool = True
    verbose: bool = False

    def say(self, text: str) -> None:
        """Print a message for the user."""

    def complain(self, text: str) -> None:
        """Print a fault that does not end the work."""

    @contextmanager
    def showing(self) -> Iterator[Show]:
        """A block with progress; a request to stop ends the program, because there is no result yet."""
        yield Show()

    @contextmanager
    def working(self) -> Iterator[tuple[Callable[[], bool], Show]]:
        """A block in which the user may request a stop; yields a test for this request, and the progress."""
        yield self.ends, Show()

    @property
    def stamp(self) -> dict[str, Any]:
        """The version and the command line, for a request's document."""
        command = None if self.command is None else shlex.join(["energy-opt", *self.command])
        return {"version": __version__, "command": command}

    def take(self, answer: str, request: Request, **more: Any) -> dict[str, Any]:
        """The request's document with a stamp; checks first that `answer` can be written.

        Args:
            answer: name of the answer's file. request: what was asked. more: further entries of the document.

        Raises:
            BadInput: see `guard`.
        """
        document = {**request.document(), **more, **self.stamp}
        if self.out is not None:
            guard(self.out / answer, document, self.force)
        return document

    def keep(self, found: Given) -> Given:
        """Write the result; return it with the records of its files."""
        return found if self.out is None else found.kept(self.out)

    def report(self, files: Iterable[Any] = (), assumed: str = "", warnings: Iterable[str] = ()) -> None:
        """Messages after the work.

        Args:
            files: those written for controllers. assumed: one line on assumed values. warnings: one line each.
        """
        shown = set()
        for row in files:
            self.say(f"{row.file if self.out is None else self.out / row.file}: {row}")
            shown.add(f"{row.file}: {row}")
        if assumed:
            self.say(assumed)
        for warning in warnings:
            if warning not in shown:
                self.say(f"warning: {warning}")

    @contextmanager
    def stating(self, answer: str, **about: Any) -> Iterator[None]:
        """A block whose `Infeasible` is written into the folder as the answer, see `failed`."""
        try:
            yield
        except Infeasible as error:
            self.failed(answer, error, **about)
            raise

    def failed(self, answer: str, error: Infeasible, **about: Any) -> None:
        """Write the reason why there is no answer; `about` is added to the error's document."""
        error.about = about | error.about
        if self.out is not None:
            with written_whole(self.out, answer) as aside:
                write_json(aside / answer, error.document())


def verb(request: Callable[P, Asked], run: Callable[[Asked, Desk], Given], name: str = "") -> Callable[P, Given]:
    """The verb as a Python function whose arguments are the fields of its request.

    Args:
        request: the class of the request. run: does the work of a request, with a desk.
        name: of the function, where it is not the verb's.

    Returns:
        The function; its signature and its text come from the request's fields. It raises BadInput for an unknown
        argument.
    """
    kind = cast(type[Request], request)
    options, signature = options_of(kind), inspect.signature(request)
    unnamed = [each.name for each in signature.parameters.values() if each.kind is not each.KEYWORD_ONLY]

    @functools.wraps(run)
    def called(*args: P.args, **given: P.kwargs) -> Given:
        for name in given:
            if name not in options:
                hint = "; save(FOLDER) of the result writes files" if name == "out" else suggest(name, options)
                raise BadInput(f"no argument {name!r}{hint}")
        if len(args) > len(unnamed):
            some = ", ".join(unnamed) or "none"
            raise BadInput(f"{kind.verb}: {len(args)} arguments without a name; expected only {some}: name the others")
        try:
            asked = request(*args, **given)
        except TypeError as fault:
            raise BadInput(f"{kind.verb}: {str(fault).partition('() ')[2] or fault}") from None
        with interrupted_at_end() as raised:
            ends = functools.partial(_ends, raised, asked.stopped or bool)  # planners of results are pickled with it
            found = run(asked, Desk(force=getattr(asked, "force", False), ends=ends))
        warn_of(getattr(found, "files", ()))
        return found

    called.__name__ = called.__qualname__ = name or kind.verb
    returned = inspect.signature(run).return_annotation
    called.__signature__ = signature.replace(return_annotation=returned)  # type: ignore[attr-defined]
    parts = [inspect.cleandoc(run.__doc__ or ""), _arguments(request, options), *_returned(run)]
    called.__doc__ = "\n\n".join(parts)
    return called


def _ends(raised: Sequence[BaseException], stopped: Callable[[], bool]) -> bool:
    """Whether to end the work: after Ctrl-C, even if a library lost it, or if the caller asks for it."""
    return bool(raised) or stopped()


def warn_of(files: Iterable[Any]) -> None:
    """Warn a caller from Python of files for controllers that break a limit."""
    for row in files:
        if not row.valid:
            warn(f"{row.file}: {row}", stacklevel=3)


def _returned(run: Callable[..., Any]) -> Iterator[str]:
    """What a verb returns, by the first paragraph on its class; of one that repeats another verb, nothing."""
    kind = get_type_hints(run)["return"]
    if kind is not Any:
        kinds = get_args(kind) or (kind,)
        words = [(each.__doc__ or "").partition("\n\n")[0].split() for each in kinds]
        lines = [f"    {each.__name__}: {' '.join(said)}" for each, said in zip(kinds, words, strict=True)]
        yield "\n".join(["Returns:", *lines])


def _arguments(request: Callable[..., Request], options: Mapping[str, tuple[Field[Any], Option]]) -> str:
    """The arguments of a verb's function, in the order of its signature, in the words of Python."""
    lines = ["Args:"]
    for name in sorted(inspect.signature(request).parameters, key=["stopped"].__contains__):
        declared, spelled = options[name]
        text = spelled.help.replace("repeatable", "one or several").replace("DIR", "`out`")
        text = text if "out" in options else text.replace("--out", "folder")
        for other, (_, found) in options.items():
            text = re.sub(rf"{flag_of(other, found)}\b(?!-)", f"`{other}`", text)
        form = FORMS.get("AnyMotion" if "AnyMotion" in str(declared.type) else name)
        lines.append(f"    {name}: {text}." + (f" In Python: {form}." if form else ""))
    return "\n".join(lines)
