"""A scene as one text for worker processes: all contents of its files, meshes included."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.scene import AllowedPairs, Scene, SceneObject, Shape
from energy_opt.files import plain


def to_text(scene: Scene) -> str:
    """The scene as JSON; the same scene gives the same text."""
    entries = [[a, b, may] for (a, b), may in sorted(scene.allowed.entries.items())]
    document = {
        "objects": [asdict(thing) for thing in scene.objects],
        "allowed": [entries, dict(sorted(scene.allowed.defaults.items()))],
        **{name: getattr(scene, name) for name in ("floor", "warnings", "poses")},
        "source": Path(scene.source).name,
    }
    return json.dumps(plain(document))


def from_text(text: str) -> Scene:
    """The scene that `to_text` wrote."""
    document = json.loads(text)
    entries, defaults = document.pop("allowed")
    allowed = AllowedPairs({(a, b): may for a, b, may in entries}, defaults)
    objects, warnings = tuple(map(_object, document.pop("objects"))), tuple(document.pop("warnings"))
    return Scene(objects, allowed, warnings=warnings, **document)


def _object(thing: dict[str, Any]) -> SceneObject:
    """An object of a scene from its document."""
    shapes = []
    for shape in thing["shapes"]:
        vertices = np.array(shape["vertices"], dtype=float).reshape(-1, 3)
        triangles = np.array(shape["triangles"], dtype=np.int64).reshape(-1, 3)
        shapes.append(Shape(shape["kind"], tuple(shape["size"]), np.array(shape["pose"]), vertices, triangles))
    known = {"shapes": tuple(shapes), "pose": np.array(thing["pose"]), "touch_links": tuple(thing["touch_links"])}
    return SceneObject(**{**thing, **known})
