"""`energy-opt effects`: the effects known, with parameters, units and laws; those of one's own among them."""

from __future__ import annotations

import argparse
import sys
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these (default: all)")
    parser.add_argument("--json", action="store_true", help="as one JSON document on stdout")
    parser.add_argument("--quiet", action="store_true", help="no messages")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.effects import effect_class, known_effects
    from energy_opt.effects.describe import described_effect
    from energy_opt.files import to_json

    kinds = [effect_class(name) for name in args.names] or list(known_effects().values())
    rows = [described_effect(kind) for kind in kinds]
    if args.json:
        sys.stdout.write(to_json({"effects": rows}))
        return 0
    print("\n\n".join(_text(row) for row in rows))
    return 0


def _text(row: dict[str, Any]) -> str:
    lines = [row["name"], f"  {row['law']}"]
    for p in row["parameters"]:
        lines.append(f"  {p['name']:<16} {p['words']}; {p['lower']:g} to {p['upper']:g}")
    lines += [f"  {key:<16} {' or '.join(words)}" for key, words in row["options"].items()]
    return "\n".join([*lines, f"  {', '.join(row['traits'])}"])
