"""What an effect's class says of itself, as a document: for the command line and the documentation."""

from __future__ import annotations

import inspect
from typing import Any

from energy_opt.effects.base import Effect, described

STAGES = {
    "rigid": "changes the rigid body",
    "torque": "adds to the motor's torque",
    "heat": "heat of a joint's drive",
    "winding": "multiplies a joint's heat",
    "drive": "between joints and bus",
    "power": "adds to the arm's power",
    "supply": "between bus and meter",
    "meter": "what the meter makes of it",
}


def described_effect(kind: type[Effect]) -> dict[str, Any]:
    """name, stage, law (the first paragraph of its text), parameters, options and traits of an effect."""
    text = inspect.getdoc(kind) or ""
    traits = [STAGES.get(kind.stage, kind.stage)]
    if kind.overhead:
        traits.append("counted as standby")
    if kind.stores:
        traits.append("stores energy")
    if kind.dissipates:
        traits.append("never gives energy")
    if kind.drifts:
        traits.append("depends on time")
    if kind.needs:
        traits.append(f"needs {' and '.join(kind.needs)}")
    if not kind.convex_in_retiming:
        traits.append("retiming is not convex with it")
    return {
        "name": kind.name,
        "class": kind.__name__,
        "stage": kind.stage,
        "law": " ".join(text.split("\n\n")[0].split()),
        "text": text,
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "words": described(p),
                "size": p.size,
                "neutral": p.neutral,
                "lower": p.lower,
                "upper": p.upper,
            }
            for p in kind.parameters
        ],
        "options": {key: list(words) for key, words in kind.options.items()},
        "traits": traits,
    }
