"""`energy-opt`: finds the verb, and turns what goes wrong into one line and an exit code."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from types import ModuleType
from typing import Any, NoReturn

from energy_opt import __version__
from energy_opt.cli.examples import EXAMPLES, example
from energy_opt.cli.faults import as_error, one_line
from energy_opt.cli.interrupt import was_pressed
from energy_opt.cli.streams import flushed, of_output, opened
from energy_opt.cli.usage import epilog
from energy_opt.errors import BadInput, EnergyOptError, near, speaking_of_options
from energy_opt.folders import leave_folders

VERBS = {
    "optimize": "one move to minimum energy",
    "tradeoff": "energy against duration for one move",
    "bench": "a batch of moves, in parallel, resumable, with a report",
    "job": "a cycle of moves and waits, its time spent where it saves most",
    "place": "the base pose that makes a job cheapest",
    "evaluate": "motions as they are: energy under models, limits, clearance; in other formats",
    "identify": "the source paper's two methods from static poses",
    "diagnose": "which effect a power model lacks, from measured data",
    "import": "logs as labs have them to a measured set; guesses columns and units",
    "passport": "an arm's electrical passport from its models; several side by side",
    "simulate": "play trajectories on a virtual arm and write a measured set",
    "check": "is this log, trajectory, model or suite usable",
    "robots": "the robots known by name, with joints and limits",
    "effects": "the effects known, with parameters, units and laws",
}
MODULES = {"import": "ingest"}  # verbs whose module cannot have their name
SHELLS = ("bash", "zsh", "tcsh")
ALONE = {"--example": "KIND", "--print-completion": "SHELL"}  # without a verb
VECTORS = ("--start", "--goal", "--via", "--base", "--start-pose", "--goal-pose", "--via-pose", "--base-box")


class _Help(argparse.HelpFormatter):
    """Lines of the epilog stay as they are where they are commands; the others are wrapped."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines = text.splitlines()
        return "\n".join(
            line if line[:2] == "  " else super(_Help, self)._fill_text(line, width, indent) for line in lines
        )


class _Parser(argparse.ArgumentParser):
    """Errors become one line with exit code 2."""

    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message} (see {self.prog} --help)")


def joined_vectors(arguments: Sequence[str]) -> list[str]:
    """`--start -1,0` as `--start=-1,0`: argparse would take a negative vector for an option.

    >>> joined_vectors(["optimize", "--start", "-1,0", "--goal", "1,0"])
    ['optimize', '--start=-1,0', '--goal', '1,0']
    """
    out: list[str] = []
    for word in arguments:
        if out and out[-1] in VECTORS and word[:1] == "-" and word[1:2] in ".0123456789":
            out[-1] = f"{out[-1]}={word}"
        else:
            out.append(word)
    return out


def _module(verb: str) -> ModuleType:
    return importlib.import_module(f"energy_opt.cli.{MODULES.get(verb, verb)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    words = joined_vectors(sys.argv[1:] if arguments is None else arguments)
    with speaking_of_options():
        try:
            opened(words)
            return _run(words)
        except KeyboardInterrupt:
            return _interrupted(words)
        except SystemExit:  # --help and --version have been printed
            with suppress(OSError):
                flushed()
            raise
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except Exception as fault:
            if was_pressed() and not isinstance(fault, EnergyOptError):
                return _interrupted(words)  # which a library that was being imported took for a fault of its own
            if "-v" in words:
                traceback.print_exc()
            error = of_output(fault) or as_error(fault)
            return _failed(error.document(), words, error.exit_code)
        finally:
            leave_folders()


def _interrupted(words: Sequence[str]) -> int:
    return _failed({"status": "interrupted", "message": "interrupted"}, words, 130)


def _failed(document: dict[str, Any], words: Sequence[str], code: int) -> int:
    """Say what went wrong: a line on stderr, and with --json the document on stdout."""
    if "--json" in words:
        from energy_opt.files import to_json

        with suppress(OSError):
            sys.stdout.write(to_json(document))
            flushed()
    with suppress(OSError):
        for line in one_line(document["message"]).splitlines():
            print(f"energy-opt: {line}", file=sys.stderr)
    return code


def _check_words(words: Sequence[str]) -> None:
    """Refuse what no option can mean, and libraries stumble over."""
    for before, word in zip(["", *words], words, strict=False):
        option, _, value = word.partition("=")
        if "\0" in word:
            said = word if word.startswith("--") or not before.startswith("--") else f"{before} {word}"
            raise BadInput(f"{said}: a character NUL, which no name or number has")
        if value == "--" and option.startswith("--"):
            raise BadInput(f"{option}: no value; '--' ends the options")


def _run(words: list[str]) -> int:
    _check_words(words)
    parser, verbs = parsers(words)
    verb = next((word for word in words if not word.startswith("-")), None)
    if words[:1] and words[0].partition("=")[0] in ALONE:
        return _print(parser.parse_args(words))
    if verb is not None and verb not in VERBS:
        raise BadInput(f"no verb {verb!r}{near(verb, VERBS)}; verbs are {', '.join(VERBS)}")
    args, unknown = parser.parse_known_args(words)
    if args.verb is None:
        if words:
            raise BadInput(f"no verb; verbs are {', '.join(VERBS)}")
        parser.print_help(sys.stderr)
        return 2
    if unknown:
        alone = unknown[0].partition("=")[0]
        if alone in ALONE:
            raise BadInput(f"{alone} goes without a verb: energy-opt {alone} {ALONE[alone]}")
        options = [name for action in verbs[args.verb]._actions for name in action.option_strings]
        raise BadInput(f"unknown: {' '.join(unknown)}{near(unknown[0], options)} (see energy-opt {args.verb} --help)")
    args.command = words
    if args.effects:
        from energy_opt.effects import load_file

        for file in args.effects:
            load_file(file)
    return int(_module(args.verb).run(args)) or flushed()


def _print(args: argparse.Namespace) -> int:
    if args.example is not None:
        if args.example not in EXAMPLES:
            kinds = ", ".join(EXAMPLES)
            raise BadInput(f"--example {args.example}{near(args.example, EXAMPLES)}; expected one of {kinds}")
        sys.stdout.write(example(args.example))
        return flushed()
    if args.print_completion not in SHELLS:
        raise BadInput(f"--print-completion {args.print_completion}; expected one of {', '.join(SHELLS)}")
    import shtab

    sys.stdout.write(shtab.complete(parsers(list(VERBS))[0], shell=args.print_completion) + "\n")
    return flushed()


def parsers(words: Sequence[str]) -> tuple[_Parser, dict[str, _Parser]]:
    """The command's parser, and that of each verb; only those of verbs that stand in `words` have their arguments."""
    parser = _Parser(prog="energy-opt", description="Robot arms that use less energy.")
    parser.add_argument("--version", action="version", version=f"energy-opt {__version__}")
    parser.add_argument("--example", metavar="KIND", help=f"print a commented file that works: {', '.join(EXAMPLES)}")
    parser.add_argument("--print-completion", metavar="SHELL", help=f"print a completion script: {', '.join(SHELLS)}")
    group = parser.add_subparsers(dest="verb", metavar="VERB")  # of the same class
    verbs = {}
    for verb, text in VERBS.items():
        sub = group.add_parser(
            verb, help=text, description=text[0].upper() + text[1:] + ".", allow_abbrev=False,
            epilog=epilog(verb), formatter_class=_Help,
        )  # fmt: skip
        if verb in words:  # only the verb that is run is imported
            _module(verb).add_arguments(sub)
        sub.add_argument("--effects", action="append", default=[], metavar="FILE.py", help="effects of your own")
        sub.add_argument("-v", dest="verbose", action="store_true", help="what the solver does; where it fails, where")
        verbs[verb] = sub
    return parser, verbs
