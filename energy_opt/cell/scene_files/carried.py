"""A scene as one text that travels to workers: all that its files held, meshes included."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.scene import AllowedPairs, Scene, SceneObject, Shape
from energy_opt.files import plain


def to_text(scene: Scene) -> str:
    """The scene as JSON; the same scene gives the same text."""
    objects = [
        {
            "name": thing.name,
            "pose": thing.pose,
            "attached_to": thing.attached_to,
            "frame": thing.frame,
            "touch_links": thing.touch_links,
            "shapes": [
                {"kind": s.kind, "size": s.size, "pose": s.pose, "vertices": s.vertices, "triangles": s.triangles}
                for s in thing.shapes
            ],
        }
        for thing in scene.objects
    ]
    entries = [[a, b, may] for (a, b), may in sorted(scene.allowed.entries.items())]
    document: dict[str, Any] = {
        "objects": objects,
        "entries": entries,
        "defaults": dict(sorted(scene.allowed.defaults.items())),
    }
    if scene.poses:
        document["poses"] = dict(scene.poses)
    return json.dumps(
        plain({**document, "source": Path(scene.source).name, "floor": scene.floor, "warnings": scene.warnings})
    )


def from_text(text: str) -> Scene:
    """The scene that `to_text` wrote."""
    document = json.loads(text)
    entries = {(a, b): may for a, b, may in document["entries"]}
    return Scene(
        tuple(_object(thing) for thing in document["objects"]),
        AllowedPairs(entries, document["defaults"]),
        document["source"],
        document["floor"],
        tuple(document["warnings"]),
        document.get("poses", {}),
    )


def _object(thing: dict[str, Any]) -> SceneObject:
    """An object of a scene from its document."""
    shapes = tuple(
        Shape(
            s["kind"],
            tuple(s["size"]),
            np.array(s["pose"]),
            np.array(s["vertices"], dtype=float).reshape(-1, 3),
            np.array(s["triangles"], dtype=np.int64).reshape(-1, 3),
        )
        for s in thing["shapes"]
    )
    attached, frame, touch = thing["attached_to"], thing["frame"], tuple(thing["touch_links"])
    return SceneObject(thing["name"], shapes, np.array(thing["pose"]), attached, frame, touch)
