"""The verbs (request and function of each), and `run`, which repeats a request from a file."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from energy_opt import __version__
from energy_opt.errors import BadInput, suggest
from energy_opt.files import found_beside, path_of, read_json
from energy_opt.folders import ANSWERS
from energy_opt.front.desk import Desk, verb
from energy_opt.requests import moves, verbs
from energy_opt.requests.option import Request, options_of
from energy_opt.requests.verbs import RunRequest

VERBS: dict[str, type[Request]] = {
    request.verb: request
    for request in (
        moves.OptimizeRequest, moves.TradeoffRequest, verbs.BenchRequest, moves.JobRequest, moves.PlaceRequest,
        verbs.EvaluateRequest, verbs.IdentifyRequest, verbs.DiagnoseRequest, verbs.ImportRequest, verbs.PassportRequest,
        verbs.SimulateRequest, verbs.CheckRequest, verbs.RobotsRequest, verbs.EffectsRequest, verbs.RunRequest,
    )
}  # fmt: skip
# modules of `front` whose names are not those of their verbs, and functions that are not called `run`
PLACES = {"import": ("importing", "run"), "effects": ("robots", "run_effects"), "run": ("verbs", "run")}


def function_of(verb: str) -> Callable[..., Any]:
    """The function of a verb; its arguments are a request and a desk."""
    module, name = PLACES.get(verb, (verb, "run"))
    function: Callable[..., Any] = getattr(importlib.import_module(f"energy_opt.front.{module}"), name)
    return function


def asked_in(given: Any, say: Callable[[str], None] = lambda _: None) -> Request:
    """The request of a document, of a result that holds one, of the file of either or its folder; or of a `Request`.

    Files of a request that is itself a file are found as `_found` says; `say` takes notes of these.

    Raises:
        BadInput: there is none, it is not one of a known verb, or a newer version of this program wrote it.
    """
    given = getattr(given, "request", given)  # of a result
    if isinstance(given, Request):  # a resolved one states the ends of its path, too
        return replace(given, **given.read(dict(vars(given))))
    where, document = "the request", given
    if not isinstance(given, Mapping):
        path = path_of(given, "the request")
        path = next((path / name for name in ANSWERS if (path / name).is_file()), path)
        if path.is_dir():
            raise BadInput(f"{path}: a folder without a result; expected one with {', '.join(ANSWERS)}")
        if path.suffix == ".toml":
            raise BadInput(f'{path}: TOML; expected JSON: a request with "verb", or a result of this program')
        where, document = str(path), read_json(path)
    if isinstance(document, Mapping) and isinstance(document.get("request"), Mapping):
        known = ANSWERS.get(Path(where).name)  # for older results, whose requests do not name their verb
        document = {"verb": known, **document["request"]}
    if not isinstance(document, Mapping) or not document.get("verb"):
        raise BadInput(f'{where}: no request; expected a JSON object with "verb", or a result of this program')
    name = str(document["verb"])
    if name not in VERBS or name == "run":
        others = [each for each in VERBS if each != "run"]
        raise BadInput(f"{where}: no verb {name!r} to run{suggest(name, others)}; verbs are {', '.join(others)}")
    version = __version__ if document.get("version") is None else document["version"]
    numbered = isinstance(version, str) and re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9}){0,3}", version)
    if not numbered or [int(n) for n in version.split(".")] > [int(n) for n in __version__.split(".")]:
        raise BadInput(
            f"{where}: version = {version!r:.40}; expected {__version__} or an earlier version of energy-opt"
        )
    if not isinstance(given, Mapping):
        document = _found(document, VERBS[name], Path(where), say)
    try:
        return VERBS[name].from_document(document)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def _found(
    document: Mapping[str, Any], request: type[Request], file: Path, say: Callable[[str], None]
) -> dict[str, Any]:
    """A request's document with its relative files that are not in the current folder found beside `file` or above.

    A result lies below the folder in which its command was given, and a request written by hand beside its files.
    """
    folders = file.resolve().parents

    def one(value: Any, named: bool) -> Any:
        """A file's new name; `named`: the value is no other word than that of a file or folder."""
        if not isinstance(value, str) or not value or os.path.exists(value):
            return value
        if not named and not Path(value).suffix:  # a model or a pose by its name
            return value
        path = found_beside(value, file, os.path.exists if named else os.path.isfile) or value
        if path != value:
            say(f"{value} is not in the current folder; {path} is read")
        return path

    apart = ("out", "folder")  # found otherwise
    kinds = {name: spelled.kind for name, (_, spelled) in options_of(request).items() if name not in apart}
    out = dict(document)
    for name in [name for name in document if name in kinds]:
        value, named = document[name], kinds[name] is Path
        out[name] = [one(each, named) for each in value] if isinstance(value, list) else one(value, named)
    job, folder = document.get("job"), document.get("folder")
    if isinstance(job, Mapping) and (folder is None or (isinstance(folder, str) and not os.path.isdir(folder))):
        names = {word for word in _words_of(job) if not os.path.isabs(word)}  # those of its files, too
        at = (each for each in (Path.cwd(), *folders) if any(os.path.isfile(each / name) for name in names))
        found = next(at, None)
        out["folder"] = str(file if found in (None, folders[0]) else found)
        if folder is not None and found is not None:
            say(f"{folder} does not exist; the files of the job are read from {found}")
    return out


def _words_of(job: Any) -> Iterator[str]:
    """All texts of a job's document, without names."""
    if isinstance(job, str):
        yield job
    elif isinstance(job, (list, Mapping)):
        for entry in job if isinstance(job, list) else (job[key] for key in job if key != "name"):
            yield from _words_of(entry)


def run(request: RunRequest, desk: Desk) -> Any:
    """Repeat a request from a file; returns what its verb returns.

    Raises:
        BadInput: no such request; and what its verb raises.
    """
    asked = asked_in(request.request, desk.say)
    if hasattr(asked, "out") and desk.out is not None:
        asked = replace(asked, out=desk.out)  # type: ignore[call-arg]
    return function_of(asked.verb)(asked, desk)


repeat = verb(RunRequest, run, "repeat")
