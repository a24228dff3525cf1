"""The verb `run`: repeats a request that was written down."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from energy_opt.errors import BadInput, near
from energy_opt.files import read_json
from energy_opt.front.desk import Desk, verb
from energy_opt.front.verbs import VERBS
from energy_opt.requests.option import Request
from energy_opt.requests.verbs import RunRequest
from energy_opt.results import ANSWERS


def asked_in(given: Any) -> Request:
    """The request of a document, of a result that holds one, or of the file of either.

    Raises:
        BadInput: there is none, or it is not one of a known verb.
    """
    where, document = "the request", given
    if not isinstance(given, Mapping):
        path = Path(str(given))
        where, document = str(path), read_json(path)
    if isinstance(document, Mapping) and isinstance(document.get("request"), Mapping):
        known = ANSWERS.get(Path(where).name)  # of results before requests named their verb
        document = {"verb": known, **document["request"]}
    if not isinstance(document, Mapping) or not document.get("verb"):
        raise BadInput(f'{where}: no request; expected a JSON object with "verb", or a result of this program')
    name = str(document["verb"])
    if name not in VERBS or name == "run":
        raise BadInput(f"{where}: no verb {name!r}{near(name, VERBS)}; verbs are {', '.join(VERBS)}")
    try:
        return VERBS[name].request.from_document(document)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def run(request: RunRequest, desk: Desk) -> Any:
    """Do again what a written request asks for.

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
