"""The verb `effects`: the effects known, with parameters, units and laws; those of one's own among them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from energy_opt.effects import effect_class, known_effects
from energy_opt.effects.registry import described_effect
from energy_opt.found import Found
from energy_opt.front.desk import Desk, verb
from energy_opt.requests.verbs import EffectsRequest


@dataclass(frozen=True)
class Effects(Found):
    """Effects as they describe themselves."""

    found: tuple[dict[str, Any], ...]

    def document(self) -> dict[str, Any]:
        """Name, law, parameters with units and bounds, options and traits of each."""
        return {"effects": list(self.found)}

    def text(self, out: Path) -> str:
        """A paragraph for each, for a terminal."""
        return "\n\n".join(map(_text, self.found))


def run(request: EffectsRequest, desk: Desk) -> Effects:
    """The effects known, with parameters, units and laws."""
    kinds = [effect_class(name) for name in request.names] or list(known_effects().values())
    return Effects(tuple(described_effect(kind) for kind in kinds))


effects = verb(EffectsRequest, run)


def _text(row: dict[str, Any]) -> str:
    lines = [row["name"], f"  {row['law']}"]
    for p in row["parameters"]:
        lines.append(f"  {p['name']:<16} {p['words']}; {p['lower']:g} to {p['upper']:g}")
    lines += [f"  {key:<16} {' or '.join(words)}" for key, words in row["options"].items()]
    return "\n".join([*lines, f"  {', '.join(row['traits'])}"])
