"""Jobs that several tests change: the example, the example retimed, and a job around a post."""

from __future__ import annotations

from pathlib import Path

from energy_opt.cli.main import example

EXAMPLE = example("job")
RETIMED = EXAMPLE.replace('mode = "reshape" ', 'mode = "retime"  ')
AROUND = """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 3.2
mode = "retime"
[poses]
left = [0.9, 0.35, 0.2, -1.9, 0.0, 2.2, 0.9]
right = [-0.9, 0.35, -0.2, -1.9, 0.0, 2.2, 0.9]
[[step]]
name = "over"
to = "right"
payload = 2.0
scene = "scene.yaml"
[[step]]
name = "back"
to = "left"
payload = 0.0
"""
POST = "{name: post, type: box, size: [0.1, 0.1, 0.5], position: [0.5, 0.1, 0.25]}"


def written(folder: Path, text: str) -> Path:
    path = folder / "job.toml"
    path.write_text(text)
    return path
