"""A verb's options from its request: parsers, `--help` and `--help-all`, and the request that words describe."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import MISSING
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from energy_opt.arguments import in_words
from energy_opt.errors import BadInput
from energy_opt.files import read_toml
from energy_opt.requests.option import ON_OFF, Option, Request, flag_of, options_of

UNITS = (
    "Defaults are in parentheses. Units are SI: rad (m for prismatic joints), s, N m (N), W, J. Joints are matched by "
    "name, never by order."
)

MOVE = "--robot panda --start 0,-0.785,0,-2.356,0,1.571,0.785 --goal 1.2,0.3,0.4,-1.2,-0.5,2.2,-0.4"


def usage_of(verb: str) -> tuple[list[str], str, str]:
    """Entries of usage.toml for a verb: commands, what it reads, what it writes."""
    usage = read_toml(Path(__file__).with_name("usage.toml"))[verb]
    return [line.replace("{MOVE}", MOVE) for line in usage["commands"]], usage["reads"], usage["writes"]


def epilog(verb: str) -> str:
    """The text below a verb's options."""
    commands, read, written = usage_of(verb)
    title = "example:" if len(commands) == 1 else "example, in this order:"
    if verb in ("identify", "passport"):
        title = "examples:"
    return "\n".join([title, *(f"  {line}" for line in commands), "", f"reads: {read}", f"writes: {written}", UNITS])


class Help(argparse.HelpFormatter):
    """Shows the main options, or all; command lines in the epilog are not wrapped."""

    every = False

    def add_usage(
        self, usage: str | None, actions: Iterable[argparse.Action], groups: Any, prefix: str | None = None
    ) -> None:
        """Add the usage without options that are not shown."""
        super().add_usage(usage, [action for action in actions if self._shown(action)], (), prefix)

    def add_argument(self, action: argparse.Action) -> None:
        """Add an argument only if it is shown."""
        if self._shown(action):
            super().add_argument(action)

    def _shown(self, action: argparse.Action) -> bool:
        return self.every or getattr(action, "main", True)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines = text.splitlines()
        return "\n".join(
            line if line[:2] == "  " else super(Help, self)._fill_text(line, width, indent) for line in lines
        )


class HelpOfAll(Help):
    """Shows all options."""

    every = True


class _HelpAll(argparse.Action):
    """`--help-all`."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        parser.formatter_class = HelpOfAll
        parser.print_help()
        parser.exit()


class Parser(argparse.ArgumentParser):
    """Errors become one line with exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Raise BadInput with the parser's message."""
        raise BadInput(f"{message} (see {self.prog} --help)")


def add_options(parser: argparse.ArgumentParser, name: str, verb: type[Request]) -> None:
    """The options of a verb: those of its request, and those that every verb has.

    Args:
        parser: receives them. name: of the verb. verb: with its request.
    """
    parser.epilog = epilog(name)
    groups: dict[str, argparse._ArgumentGroup] = {}
    for field, (declared, spelled) in options_of(verb).items():
        if spelled.internal:
            continue
        owner = next(kind for kind in verb.__mro__ if field in vars(kind).get("__annotations__", {}))
        title = (owner.__doc__ or "") if owner.__name__.endswith("Group") else ""  # a verb's own options have none
        if title and title not in groups:
            groups[title] = parser.add_argument_group(title)
        _add(groups[title] if title else parser, field, spelled, declared.default)
    known = {field for field, (_, spelled) in options_of(verb).items() if not spelled.internal}
    group = groups.get("output") or parser.add_argument_group("output")
    if "out" not in known and (verb.results or name == "run"):
        usual = verb.results or "the verb's own"
        group.add_argument("--out", type=Path, metavar="DIR", help=f"folder of results ({usual})")
    if "force" not in known and (verb.results or name == "run"):
        group.add_argument("--force", action="store_true", help="overwrite the results of another request in DIR")
    if verb.report:
        group.add_argument("--view", action="store_true", help="open report.html in the browser")
    group.add_argument("--json", action="store_true", help="print the result as one JSON document on stdout")
    group.add_argument("--quiet", action="store_true", help="print no progress and no messages")
    group.add_argument(
        "--effects", action="append", default=[], metavar="FILE.py", help="Python file that defines your own effects"
    )
    group.add_argument(
        "-v",
        dest="verbose",
        action="store_true",
        help="print each step of the solver, and the traceback of an unknown fault",
    )
    parser.add_argument("--help-all", nargs=0, action=_HelpAll, help="show all options, and exit")


def _add(group: Any, field: str, spelled: Option, default: Any) -> None:
    """Add the argument of one field of a request to a parser's group."""
    shown = argparse.SUPPRESS if spelled.hidden else spelled.help.replace("%", "%%")
    known: dict[str, Any] = {"help": shown, "default": None}
    if spelled.place:
        known |= {"metavar": spelled.metavar, **({} if spelled.place == "1" else {"nargs": spelled.place})}
        known |= {"type": Path} if spelled.kind is Path else {}
        group.add_argument(field, **known)
        return
    if spelled.kind is bool:
        known |= {"action": "store_true"} if default is False else {"choices": ON_OFF}
    else:
        known |= {"metavar": tuple(spelled.metavar.split()) if isinstance(spelled.nargs, int) else spelled.metavar}
        known |= {"type": partial(_value, spelled.kind)} if spelled.kind is not str else {}
        known |= {"choices": spelled.choices} if spelled.choices else {}
        known |= {"nargs": spelled.nargs} if spelled.nargs is not None else {}
        repeats = (spelled.many or spelled.several) and spelled.nargs is None
        known |= {"action": "append"} if repeats else {}
        known |= {"required": True} if default is MISSING else {}
    action = group.add_argument(flag_of(field, spelled), *spelled.aliases, dest=field, **known)
    action.main = spelled.main


def _value(kind: type[Any], word: str) -> Any:
    """A word of the command line as a number or a path."""
    try:
        return kind(word)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r}: expected {in_words(kind)}") from None


def request_of(args: argparse.Namespace, verb: type[Request]) -> Request:
    """The request that parsed words describe.

    Raises:
        BadInput: a value that its field cannot have.
    """
    given = {}
    for field, (_, spelled) in options_of(verb).items():
        value = None if spelled.internal else getattr(args, field)
        if value is None or (value is False and spelled.kind is bool):
            continue
        if spelled.several and len(value) == 1:
            value = value[0]
        given[field] = value
    return verb(**given)
