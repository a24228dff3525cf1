"""What was asked for, as it stands in a result; and that a folder with another request's answer is left alone."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from energy_opt import __version__
from energy_opt.errors import BadInput
from energy_opt.files import plain, read_json, read_toml
from energy_opt.folders import take_folder
from energy_opt.motion import Move, Settings
from energy_opt.power import PowerModel
from energy_opt.results import no_folder_in_the_way, no_other_verb
from energy_opt.robot import Robot

SAME_ANSWER = ("version", "command")  # what may differ between two requests for the same thing


def request_of_move(
    robot: Robot,
    model: PowerModel,
    move: Move,
    settings: Settings,
    *,
    path: object = None,
    limits: object = None,
    scene: object = None,
    command: list[str] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """start, goal, path, payload, model, limits, scene, seed, settings, version, command and `more` of one move.

    Of the settings stand there those that are not the usual ones and could change the answer.

    Args:
        path, limits, scene: names of the files that were given; None where none was.
        command: the words of the command line, where there was one.
    """
    payload = model.get("payload")
    return {
        "robot": robot.name,
        "locked": robot.locked,
        "start": move.start,
        "goal": move.goal,
        "via": list(move.via),
        "mode": move.mode,
        "duration": move.duration,
        "max_duration": move.max_duration,
        "path": _path(path, move),
        "payload": None if payload is None else {k: v.tolist() for k, v in payload.values.items()},
        "model": model.to_document(),
        "limits": None if limits is None else str(limits),
        "scene": None if scene is None else str(scene),
        "seed": settings.seed,
        "settings": _unusual(settings),
        **more,
        **stamp(command),
    }


def _unusual(settings: Settings) -> dict[str, Any]:
    usual = Settings()
    names = (f.name for f in fields(Settings) if f.name not in ("seed", "compile", "allow_large"))
    return {name: value for name in names if (value := getattr(settings, name)) != getattr(usual, name)}


def request_of_set(
    folder: Path,
    robot: Robot,
    seed: int,
    *,
    model: PowerModel | None = None,
    payload: object = None,
    limits: object = None,
    command: list[str] | None = None,
) -> dict[str, Any]:
    """The same for a verb that reads a measured set: set, robot, payload, model, limits, seed, version, command.

    Raises:
        BadInput: the seed is below 0.
    """
    if seed < 0:
        raise BadInput(f"--seed {seed}: expected 0 or more")
    return {
        "set": str(folder),
        "robot": robot.name,
        "locked": robot.locked,
        "payload": payload,
        "model": None if model is None else model.to_document(),
        "limits": None if limits is None else str(limits),
        "seed": seed,
        **stamp(command),
    }


def request_of_job(
    file: Path, robot: Robot, model: PowerModel, settings: Settings, *, command: list[str] | None = None, **more: Any
) -> dict[str, Any]:
    """The same for a job: its whole text (but for comments), robot, model, seed, settings, `more`, version, command."""
    return {
        "job": read_toml(file),
        "robot": robot.name,
        "locked": robot.locked,
        "model": model.to_document(),
        "seed": settings.seed,
        "settings": _unusual(settings),
        **more,
        **stamp(command),
    }


def stamp(command: list[str] | None) -> dict[str, Any]:
    """Version and command line; the latter None for a call from Python."""
    return {"version": __version__, "command": None if command is None else shlex.join(["energy-opt", *command])}


def _path(given: object, move: Move) -> object:
    """The file's name, or what is known of a path that was handed in."""
    if move.path is None:
        return None
    if isinstance(given, (str, Path)):
        return str(given)
    return move.path(move.path.knots[:: max(1, len(move.path.knots) // 50)])


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
