"""Scenes from files: MoveIt's PlanningScene as YAML or JSON, MoveIt's .scene text, and short YAML."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from energy_opt.cell.scene import Scene
from energy_opt.cell.scene_files import message, short
from energy_opt.cell.scene_files.parts import Reading
from energy_opt.cell.scene_files.short import read_text_scene
from energy_opt.errors import BadInput
from energy_opt.files import path_of, read_json, read_text, read_yaml_documents

SUFFIXES = (".scene", ".yaml", ".yml", ".json")


class FileScene(Scene):
    """A scene from a file, taken wherever the file's name is: requests name the file."""

    def __fspath__(self) -> str:
        """The file.

        Raises:
            BadInput: the scene or the file was changed since, or the scene has a floor, which is an option of its own.
        """
        if self.floor is not None:
            raise BadInput("--scene: has a floor; expected a scene without floor, and --floor")
        if read_scene(self.source, allow_outside=True, allow_large=True).to_text() != self.to_text():
            raise BadInput(f"--scene: differs from its file {self.source}; expected what load_scene(FILE) returned")
        return self.source


def read_scene(
    path: str | PathLike[str], *, floor: float | None = None, allow_outside: bool = False, allow_large: bool = False
) -> FileScene:
    """Read a scene from a file: MoveIt's PlanningScene (YAML, JSON), `.scene` text, or the short YAML form.

    Args:
        path: the file. floor: everything below this height of the scene's frame is solid [m]; None for no floor.
        allow_outside: mesh files may lie outside of the scene's folder.
        allow_large: no bound on sizes and counts.

    Raises:
        BadInput: names the file, the object and what is wrong with it, and how many more faults there are.
    """
    reading = _read(path_of(path, "scene"), allow_outside, allow_large)
    if reading.faults:
        more = len(reading.faults) - 1
        tail = f" (and {more} more faults: energy-opt check {path})" if more else ""
        raise BadInput(reading.faults[0] + tail)
    objects, warnings = tuple(reading.objects.values()), tuple(reading.warnings)
    return FileScene(objects, reading.allowed, fspath(path), floor, warnings, reading.poses, reading.root)


def check_scene(path: Path, *, allow_outside: bool = False, allow_large: bool = False) -> list[str]:
    """Every fault of a scene file, one line each; empty if it is usable.

    Args:
        path: the file. allow_outside, allow_large: as those of `read_scene`.
    """
    try:
        return _read(Path(path), allow_outside, allow_large).faults
    except BadInput as error:
        return [str(error)]


def is_scene(document: Any) -> bool:
    """Whether a YAML or JSON document is a scene: a PlanningScene message or the short form."""
    return _scene_in(document) is not None


def _scene_in(document: Any) -> Mapping[str, Any] | None:
    """The scene that a document is, or holds; None without one."""
    if isinstance(document, Mapping) and isinstance(document.get("scene"), Mapping):
        document = document["scene"]  # the answer of MoveIt's service get_planning_scene
    found = isinstance(document, Mapping) and any(key in document for key in ("objects", *message.KEYS))
    return document if found else None


def _read(path: Path, allow_outside: bool, allow_large: bool) -> Reading:
    """Read a scene file by its ending: text, JSON or YAML; a PlanningScene or the short form.

    Raises:
        BadInput: another ending, more than one document, or neither form.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadInput(f"{path}: not a scene by its name; expected {', '.join(SUFFIXES)}")
    reading = Reading(path, allow_outside, allow_large)
    if suffix == ".scene":
        read_text_scene(reading, read_text(path))
        return reading
    # several documents in YAML: a message that a tool printed ends with a line ---
    documents = [read_json(path)] if suffix == ".json" else read_yaml_documents(path)
    if len(documents) > 1:
        raise BadInput(f"{path}: {len(documents)} documents; expected one scene")
    document = _scene_in(documents[0]) if documents else None
    if document is None:
        raise BadInput(f"{path}: expected a PlanningScene (with world) or a short scene (with objects)")
    if "objects" in document:
        short.read_short(reading, document)
    else:
        message.read_message(reading, document)
    return reading
