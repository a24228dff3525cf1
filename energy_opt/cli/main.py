"""`energy-opt`: finds the verb, and turns faults into one line and an exit code.

Also here: valid example files to start from; `--example KIND` prints one.
"""

from __future__ import annotations

import argparse
import gc
import logging
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from energy_opt import __version__
from energy_opt.cli.faults import Unforeseen, as_error, flushed, one_line, opened, stdout_for_json, view, was_pressed
from energy_opt.cli.options import Help, Parser, add_options, request_of
from energy_opt.cli.terminal import Terminal
from energy_opt.errors import BadInput, EnergyOptError, speaking_of_options, suggest
from energy_opt.files import read_text
from energy_opt.folders import leave_folders
from energy_opt.front.verbs import VERBS, asked_in, function_of
from energy_opt.requests.option import flag_of, options_of
from energy_opt.requests.verbs import RunRequest

SHELLS = ("bash", "zsh", "tcsh")
ALONE = {"--example": "KIND", "--print-completion": "SHELL"}  # options without a verb, and their values
VECTORS = ("--start", "--goal", "--via", "--base", "--start-pose", "--goal-pose", "--via-pose", "--base-box")


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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    words = joined_vectors(sys.argv[1:] if arguments is None else arguments)
    gc.set_threshold(20_000, 50, 100)  # usual collections take 10 % of a short run
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it reports homes that it cannot write to
    os.environ["MPLBACKEND"] = "agg"  # no window is opened, and the user's choice may be one that is not installed
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
                return _interrupted(words)  # a library that was being imported raised an error of its own
            error = as_error(fault)
            if "-v" in words and isinstance(error, Unforeseen):
                traceback.print_exception(fault)
            return _failed(error.document(), words, error.exit_code)
        finally:
            leave_folders()


def _interrupted(words: Sequence[str]) -> int:
    return _failed({"status": "interrupted", "message": "interrupted"}, words, 130)


def _failed(document: dict[str, Any], words: Sequence[str], code: int) -> int:
    """Print a fault: a line on stderr, and with --json the document on stdout."""
    if "--json" in words:
        from energy_opt.files import to_json

        with suppress(OSError):
            sys.stdout.write(to_json(document))
            flushed()
    with suppress(OSError):
        for line in one_line(document["message"]).splitlines():
            print(f"energy-opt: {line}", file=sys.stderr)
    return code


def _option_hint(option: str, own: Sequence[str]) -> str:
    """Hint: the verbs that have an option which this one lacks, else the option of `own` with similar spelling."""
    others = [
        name
        for name, verb in VERBS.items()
        if option in {flag_of(field, spelled) for field, (_, spelled) in options_of(verb).items()}
    ]
    if others:
        return f"; {option} is an option of {', '.join(others)}"
    return suggest(option.lstrip("-"), [flag.lstrip("-") for flag in own]).replace("mean '", "mean '--")


def _run(words: list[str]) -> int:
    """Parse the words, find the verb and run it; returns the exit code.

    Raises:
        BadInput: an unknown verb or option; the message proposes the nearest known one.
    """
    for before, word in zip(["", *words], words, strict=False):  # words that no option means and no library handles
        option, _, value = word.partition("=")
        if "\0" in word:
            said = word if word.startswith("--") or not before.startswith("--") else f"{before} {word}"
            raise BadInput(f"{said}: contains the character NUL")
        if any("\ud800" <= c <= "\udfff" for c in word):  # Python's marks for bytes that are no text
            raise BadInput(f"{word}: not text in this locale's encoding; rename the file, or set LC_ALL=C.UTF-8")
        if word == "--out=" or (before == "--out" and not word.strip()):
            raise BadInput("--out: empty; expected a folder, such as . for this one")
        if value == "--" and option.startswith("--"):
            raise BadInput(f"{option}: no value; '--' ends the options")
    parser, verbs = parsers(words)
    verb = next((word for word in words if not word.startswith("-")), None)
    if words[:1] and words[0].partition("=")[0] in ALONE:
        return _print_file(parser.parse_args(words))
    if verb is not None and verb not in VERBS:
        raise BadInput(f"no verb {verb!r}{suggest(verb, VERBS)}; verbs are {', '.join(VERBS)}")
    args, unknown = parser.parse_known_args(words)
    if args.verb is None:
        if words:
            raise BadInput(f"no verb; verbs are {', '.join(VERBS)}")
        parser.print_help(sys.stderr)
        return 2
    if unknown:
        alone = unknown[0].partition("=")[0]
        if alone in ALONE:
            raise BadInput(f"{alone} is used without a verb: energy-opt {alone} {ALONE[alone]}")
        own = [name for action in verbs[args.verb]._actions for name in action.option_strings]
        raise BadInput(f"unknown: {' '.join(unknown)}{_option_hint(alone, own)} (see energy-opt {args.verb} --help)")
    if args.effects:
        from energy_opt.effects import load_file

        with stdout_for_json(args.json):
            for file in args.effects:
                load_file(file)
    return _run_verb(args, tuple(words)) or flushed()


def _run_verb(args: argparse.Namespace, words: tuple[str, ...]) -> int:
    """Read the request, run its verb, and print what it found; returns the exit code."""
    verb = VERBS[args.verb]
    with stdout_for_json(args.json):
        request = request_of(args, verb)
        if isinstance(request, RunRequest):  # the repeated verb says where its results are written
            verb = type(asked_in(request.request))
    given = getattr(args, "out", None)
    out: Path | None = given if given is not None or not verb.results else Path(verb.results)
    force = getattr(args, "force", False)
    desk = Terminal(out, force, words, quiet=args.quiet, verbose=args.verbose)
    with stdout_for_json(args.json):
        if verb.results:  # else it computes nothing
            from energy_opt.numerics import native

            native.begin()
        found = function_of(args.verb)(request, desk)
    folder = Path(out or getattr(found, "out", None) or ".")
    if getattr(args, "view", False):
        view(folder, args.quiet)
    if args.json:
        answer = folder / verb.answer
        sys.stdout.write(read_text(answer) if answer.is_file() else found.to_json())
    elif (verb.printed or not args.quiet) and (text := found.text(folder)):
        print(text)
    return int(found.exit_code)


def _print_file(args: argparse.Namespace) -> int:
    """Print an example file or a completion script."""
    if args.example is not None:
        if args.example not in EXAMPLES:
            kinds = ", ".join(EXAMPLES)
            raise BadInput(f"--example {args.example}{suggest(args.example, EXAMPLES)}; expected one of {kinds}")
        sys.stdout.write(example(args.example))
        return flushed()
    if args.print_completion not in SHELLS:
        raise BadInput(f"--print-completion {args.print_completion}; expected one of {', '.join(SHELLS)}")
    import shtab

    sys.stdout.write(shtab.complete(parsers(list(VERBS))[0], shell=args.print_completion) + "\n")
    return flushed()


def parsers(words: Sequence[str]) -> tuple[Parser, dict[str, Parser]]:
    """The command's parser, and that of each verb; only verbs in `words` get their arguments."""
    parser = Parser(prog="energy-opt", description="Plan motions of robot arms that use less electrical energy.")
    parser.add_argument("--version", action="version", version=f"energy-opt {__version__}")
    parser.add_argument("--example", metavar="KIND", help=f"print a commented example file: {', '.join(EXAMPLES)}")
    parser.add_argument("--print-completion", metavar="SHELL", help=f"print a completion script: {', '.join(SHELLS)}")
    group = parser.add_subparsers(dest="verb", metavar="VERB")  # its parsers are of the same class
    verbs = {}
    for name, verb in VERBS.items():
        text = verb.summary
        sub = group.add_parser(
            name, help=text, description=text[0].upper() + text[1:] + ".", allow_abbrev=False, formatter_class=Help
        )
        if name in words:  # only the verb that is run
            add_options(sub, name, verb)
        verbs[name] = sub
    return parser, verbs


# Kind -> the file that is printed, in the package of its reader.
EXAMPLES = {
    "model": "power/example.toml",
    "log": "measured/example.toml",
    "job": "jobs/example.toml",
    "suite": "batches/example.toml",
    "limits": "robot/example.yaml",
    "scene": "cell/scene_files/example.yaml",
}


def example(kind: str) -> str:
    """The text of the example file of a kind."""
    return (Path(__file__).parents[1] / EXAMPLES[kind]).read_text(encoding="utf-8")
