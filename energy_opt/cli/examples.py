"""Valid example files to start from: `--example KIND` prints one."""

from __future__ import annotations

from pathlib import Path

# Kind -> the file that is printed, in the package of its reader.
EXAMPLES = {
    "model": "power/example.toml",
    "log": "measured/example.toml",
    "job": "jobs/example.toml",
    "suite": "batches/example.toml",
    "limits": "robot/example.yaml",
    "scene": "cell/scene_files/example.yaml",
}


def example(kind: str) -> str:
    """The text of the example file of a kind."""
    return (Path(__file__).parents[1] / EXAMPLES[kind]).read_text(encoding="utf-8")
