"""The verbs (purpose, request and function of each), and `run`, which repeats a request from a file."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
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


@dataclass(frozen=True)
class Verb:
    """A verb.

    Attributes:
        summary: its purpose, in one line. request: the class of its request.
        out: the default folder of its results; empty if it has none, or if its request states it.
        report: True if that folder gets a report.html.
        answer: the file there that holds its answer; empty where that is no file.
        printed: True if its text is the answer: it is printed with --quiet, too.
    """

    summary: str
    request: type[Request]
    out: str = ""
    report: bool = False
    answer: str = ""
    printed: bool = False

    @property
    def run(self) -> Callable[..., Any]:
        """The function of the verb; its arguments are a request and a desk."""
        module, name = PLACES.get(self.request.verb, (self.request.verb, "run"))
        function: Callable[..., Any] = getattr(importlib.import_module(f"energy_opt.front.{module}"), name)
        return function


VERBS = {
    verb.request.verb: verb
    for verb in (
        Verb("plan one move with minimum energy", moves.OptimizeRequest, "energy_opt_out", True, "result.json"),
        Verb(
            "energy against duration, of one move or of a job",
            moves.TradeoffRequest, "energy_opt_tradeoff", True, "tradeoff.json",
        ),
        Verb(
            "plan many moves in parallel, with a report; an interrupted run can be resumed",
            verbs.BenchRequest, report=True, printed=True,
        ),
        Verb(
            "plan a cycle of moves and waits, of one robot or several, with minimum energy",
            moves.JobRequest, "energy_opt_job", True, "job.json",
        ),
        Verb(
            "find the base pose at which a job takes the least energy",
            moves.PlaceRequest, "energy_opt_place", True, "place.json",
        ),
        Verb(
            "energy, limits and clearance of given motions; write them in other formats",
            verbs.EvaluateRequest, "energy_opt_evaluation",
        ),
        Verb(
            "overhead and winding losses from static poses: the source paper's two methods",
            verbs.IdentifyRequest, "identify", True, "identify.json",
        ),
        Verb(
            "find from measured data which effect a power model lacks",
            verbs.DiagnoseRequest, "diagnosis", True, "diagnosis.json",
        ),
        Verb("make a measured set from a lab's logs; columns and units are guessed", verbs.ImportRequest),
        Verb(
            "the electrical passport of an arm: values, intervals, sources; compare several",
            verbs.PassportRequest, "passport", True,
        ),
        Verb("play trajectories on a virtual arm and write a measured set", verbs.SimulateRequest),
        Verb("check whether logs, trajectories, models and other files are usable", verbs.CheckRequest),
        Verb("list the known robots, with joints and limits", verbs.RobotsRequest, printed=True),
        Verb("list the known effects, with parameters, units and laws", verbs.EffectsRequest, printed=True),
        Verb("repeat the request of a result, or one written by hand", verbs.RunRequest, report=True),
    )
}  # fmt: skip
# modules of `front` whose names are not those of their verbs, and functions that are not called `run`
PLACES = {"import": ("importing", "run"), "effects": ("robots", "run_effects"), "run": ("verbs", "run")}


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
        return VERBS[name].request.from_document(document)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def run(request: RunRequest, desk: Desk) -> Any:
    """Repeat a request from a file.

    Raises:
        BadInput: no such request; and what its verb raises.
    """
    asked = asked_in(request.request)
    if hasattr(asked, "out"):
        asked = asked if desk.out is None else replace(asked, out=desk.out)  # type: ignore[call-arg]
    elif desk.command is not None and desk.out is None and VERBS[asked.verb].out:
        desk = replace(desk, out=Path(VERBS[asked.verb].out))
    return VERBS[asked.verb].run(asked, desk)


repeat = verb(RunRequest, run)
