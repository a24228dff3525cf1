"""A folder with the answer to another request is left alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from energy_opt.errors import BadInput
from energy_opt.files import plain, read_json
from energy_opt.folders import take_folder
from energy_opt.results import no_folder_in_the_way, no_other_verb

SAME_ANSWER = ("verb", "version", "command", "folder")  # what may differ between two requests for the same thing


def guard(file: Path, request: Mapping[str, Any], force: bool) -> None:
    """Refuse to overwrite the answer to another request, unless forced; that there was none is no answer to keep.

    Raises:
        BadInput: `file` holds such an answer; says what differs. Or another verb's results lie beside it, or its folder
            cannot be written, or another run is writing there.
    """
    take_folder(file.parent)
    no_folder_in_the_way(file.parent, file.name)
    if force:
        return
    no_other_verb(file.parent, file.name)
    if not file.is_file():
        return
    try:
        document = read_json(file)
    except BadInput:
        return
    held = document.get("request")
    if not isinstance(held, dict) or document.get("status") == "infeasible":
        return
    wanted = plain(request)
    keys = sorted((set(held) | set(wanted)) - set(SAME_ANSWER))
    differ = [key for key in keys if held.get(key) != wanted.get(key) and (held.get(key) or wanted.get(key))]
    if differ:
        raise BadInput(
            f"{file.parent} holds the result of another request ({', '.join(differ)}); "
            "choose another --out, or overwrite it with --force"
        )
