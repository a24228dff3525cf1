"""Files that work, to begin from: `--example KIND` prints that of its reader."""

from __future__ import annotations

import importlib

# Kind -> the module whose EXAMPLE is printed.
EXAMPLES = {
    "model": "energy_opt.power.example",
    "log": "energy_opt.measured.example",
    "job": "energy_opt.jobs.example",
    "suite": "energy_opt.batches.example",
    "limits": "energy_opt.robot.example",
    "scene": "energy_opt.cell.scene_files.example",
}


def example(kind: str) -> str:
    """The text of the example file of a kind."""
    return str(importlib.import_module(EXAMPLES[kind]).EXAMPLE)
