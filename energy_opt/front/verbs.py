"""The verbs (request and function of each), and `run`, which repeats a request from a file."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from energy_opt import __version__
from energy_opt.errors import BadInput, suggest
from energy_opt.files import read_json
from energy_opt.folders import ANSWERS
from energy_opt.front.desk import Desk, verb
from energy_opt.requests import moves, verbs
from energy_opt.requests.option import Request
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


def asked_in(given: Any) -> Request:
    """The request of a document, of a result that holds one, or of the file of either.

    Raises:
        BadInput: there is none, it is not one of a known verb, or a newer version of this program wrote it.
    """
    where, document = "the request", given
    if not isinstance(given, Mapping):
        path = Path(str(given))
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
    try:
        return VERBS[name].from_document(document)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def run(request: RunRequest, desk: Desk) -> Any:
    """Repeat a request from a file.

    Raises:
        BadInput: no such request; and what its verb raises.
    """
    asked = asked_in(request.request)
    if hasattr(asked, "out") and desk.out is not None:
        asked = replace(asked, out=desk.out)  # type: ignore[call-arg]
    return function_of(asked.verb)(asked, desk)


repeat = verb(RunRequest, run, "repeat")
