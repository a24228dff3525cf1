"""The verbs: what each is for, its request, and the function that does it."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from energy_opt.requests import moves, verbs
from energy_opt.requests.option import Request


@dataclass(frozen=True)
class Verb:
    """A verb.

    Attributes:
        summary: what it is for, in one line.
        request: what it can be asked.
        place: the module with the function `run` that does it.
        out: the folder of its results where none is given; empty where it has none, or where its request says.
        report: whether that holds a report.html.
        answer: the file there that holds its answer; empty where that is no file.
        printed: whether its text is what was asked for: it is printed with --quiet too.
    """

    summary: str
    request: type[Request]
    place: str
    out: str = ""
    report: bool = False
    answer: str = ""
    printed: bool = False

    @property
    def run(self) -> Callable[..., Any]:
        """The function that does it, of a request and a desk."""
        function: Callable[..., Any] = importlib.import_module(f"energy_opt.front.{self.place}").run
        return function


VERBS = {
    "optimize": Verb(
        "one move to minimum energy",
        moves.OptimizeRequest, "optimize", "energy_opt_out", True, "result.json",
    ),
    "tradeoff": Verb(
        "energy against duration for one move",
        moves.TradeoffRequest, "tradeoff", "energy_opt_tradeoff", True, "tradeoff.json",
    ),
    "bench": Verb(
        "a batch of moves, in parallel, resumable, with a report",
        verbs.BenchRequest, "bench", report=True, printed=True,
    ),
    "job": Verb(
        "a cycle of moves and waits, its time spent where it saves most",
        moves.JobRequest, "job", "energy_opt_job", True, "job.json",
    ),
    "place": Verb(
        "the base pose that makes a job cheapest", moves.PlaceRequest, "place", "energy_opt_place", True, "place.json"
    ),
    "evaluate": Verb(
        "motions as they are: energy under models, limits, clearance; in other formats",
        verbs.EvaluateRequest, "evaluate", "energy_opt_evaluation",
    ),
    "identify": Verb(
        "the source paper's two methods from static poses",
        verbs.IdentifyRequest, "identify", "identify", True, "identify.json",
    ),
    "diagnose": Verb(
        "which effect a power model lacks, from measured data",
        verbs.DiagnoseRequest, "diagnose", "diagnosis", True, "diagnosis.json",
    ),
    "import": Verb(
        "logs as labs have them to a measured set; guesses columns and units", verbs.ImportRequest, "importing"
    ),
    "passport": Verb(
        "an arm's electrical passport from its models; several side by side",
        verbs.PassportRequest, "passport", "passport", True,
    ),
    "simulate": Verb(
        "play trajectories on a virtual arm and write a measured set", verbs.SimulateRequest, "simulate"
    ),
    "check": Verb("is this log, trajectory, model or suite usable", verbs.CheckRequest, "check"),
    "robots": Verb("the robots known by name, with joints and limits", verbs.RobotsRequest, "robots", printed=True),
    "effects": Verb(
        "the effects known, with parameters, units and laws", verbs.EffectsRequest, "effects", printed=True
    ),
    "run": Verb("repeat the request of a result, or one written by hand", verbs.RunRequest, "run", report=True),
}  # fmt: skip
