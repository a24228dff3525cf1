"""Time and memory of each verb against the size of what it is given: they must grow at most linearly.

    python benchmarks/bounds.py                 # all, some minutes
    python benchmarks/bounds.py duration joints

Each measurement is a process of its own: processor time and peak memory as the system counts them. Beyond the sizes
here the verbs refuse and say the size that would do.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

Z1 = [f"joint{k}" for k in range(1, 7)]
MOVE = ["--robot", "z1", "--mode", "retime", "--compile", "never", "--model", "source-method-2", "--quiet", "--force"]
ENDS = ["--start", "0,1,-1,0,0,0", "--goal", "1,1.5,-1.5,0.2,0.3,0.4"]


def waypoints(folder: Path, count: int) -> Path:
    """A smooth path through so many points."""
    s = np.linspace(0, 1, count)[:, None]
    q = np.array([0, 1, -1, 0, 0, 0]) + 0.4 * np.sin(s * np.arange(1, 7) * 2)
    return table(folder / f"way{count}.csv", [f"{j}.position" for j in Z1], q)


def recording(folder: Path, rows: int) -> Path:
    """A slow motion at 1 kHz."""
    t = np.arange(rows) / 1000
    q = np.array([0, 1, -1, 0, 0, 0]) + 0.4 * np.sin(t[:, None] * np.array([0.5, 0.4, 0.3, 0.6, 0.7, 0.2]))
    return table(folder / f"log{rows}.csv", ["time", *(f"{j}.position" for j in Z1)], np.column_stack([t, q]))


def table(path: Path, header: list[str], rows: np.ndarray) -> Path:
    np.savetxt(path, rows, delimiter=",", header=",".join(header), comments="", fmt="%.9g")
    return path


def chain(folder: Path, joints: int) -> Path:
    """An arm of so many links."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for k in range(1, joints + 1):
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="0.05 0 0"/><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" '
            f'izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j{k}" type="revolute"><parent '
            f'link="l{k - 1}"/><child link="l{k}"/><origin xyz="0.1 0 0"/><axis xyz="{k % 2} {1 - k % 2} 0"/>'
            '<limit lower="-3" upper="3" velocity="2" effort="400"/></joint>'
        )
    path = folder / f"chain{joints}.urdf"
    path.write_text("\n".join([*parts, "</robot>"]))
    return path


def measured(folder: Path, rows: int, static: bool = False) -> Path:
    """A set of ten runs at 1 kHz, or of as many rows in twenty poses."""
    runs = 20 if static else 10
    place = folder / f"set{rows}"
    place.mkdir()
    t = np.arange(rows // runs) / 1000
    noise = np.random.default_rng(0)
    kind = "static" if static else "motion"
    lines = ['format = "energy-opt/log/1"\nrobot = "z1"\n']
    for k in range(runs):
        rest = np.array([0, 1 + 0.03 * k, -1 - 0.02 * k, 0, 0, 0])
        wave = np.array([0.5, 0.4, 0.3, 0.6, 0.7, 0.2]) * (1 + 0.2 * k)
        swing = np.zeros((len(t), 6)) if static else 0.6 * np.sin(t[:, None] * wave)
        speed = np.zeros((len(t), 6)) if static else 0.6 * wave * np.cos(t[:, None] * wave)
        power = 30 + 0.3 * k * static + 2 * np.abs(speed).sum(axis=1) + noise.normal(0, 0.5, len(t))
        header = ["time", *(f"{j}.position" for j in Z1), "power"]
        table(place / f"run{k}.csv", header, np.column_stack([t, rest + swing, power]))
        lines.append(f'[[run]]\nfile = "run{k}.csv"\nkind = "{kind}"\n')
    (place / "log.toml").write_text("\n".join(lines))
    return place


def plant(folder: Path) -> Path:
    path = folder / "plant.toml"
    path.write_text(
        'format = "energy-opt/model/1"\nrobot = "z1"\n[[effect]]\nname = "standby"\npower = 30.0\n'
        '[[effect]]\nname = "copper_loss"\nr_over_kt2 = 0.01\n'
    )
    return path


def _joints(folder: Path, size: int) -> list[str]:
    ends = ["--start", ",".join(["0.1"] * size), "--goal", ",".join(["0.2"] * size)]
    return ["optimize", *MOVE, *ends, "--duration", "3", "--robot", str(chain(folder, size)), "--self-collision", "off"]


SIZES: dict[str, tuple[tuple[int, ...], str, Callable[[Path, int], list[str]]]] = {
    "duration": ((10, 60, 600, 3600), "optimize, s", lambda f, n: ["optimize", *MOVE, *ENDS, "--duration", str(n)]),
    "waypoints": (
        (10, 100, 1000), "optimize, waypoints", lambda f, n: ["optimize", *MOVE, "--path", str(waypoints(f, n))],
    ),
    "joints": ((7, 14, 30), "optimize, joints", _joints),
    "tradeoff": (
        (4, 8, 16), "tradeoff, durations", lambda f, n: ["tradeoff", *MOVE, *ENDS, "--durations", f"3:6:{n}"],
    ),
    "check": (
        (1000, 10_000, 100_000), "check, rows",
        lambda f, n: ["check", "--robot", "z1", "--self-collision", "off", str(recording(f, n))],
    ),
    "diagnose": (
        (10_000, 100_000, 1_000_000), "diagnose, rows at 1 kHz",
        lambda f, n: ["diagnose", str(measured(f, n)), "--quiet"],
    ),
    "identify": (
        (10_000, 100_000, 1_000_000), "identify, rows at 1 kHz",
        lambda f, n: ["identify", str(measured(f, n, static=True)), "--quiet"],
    ),
    "simulate": (
        (10_000, 40_000, 160_000), "simulate, rows at 1 kHz",
        lambda f, n: ["simulate", str(recording(f, n)), "--plant", str(plant(f)), "--quiet", "--force"],
    ),
}  # fmt: skip


def taken(words: list[str], folder: Path) -> tuple[float, float, int]:
    """Processor time [s], peak memory [MB] and exit code of a command."""
    out = [] if words[0] == "check" else ["--out", str(folder / "out")]
    process = subprocess.Popen(
        [sys.executable, "-m", "energy_opt", *words, *out], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000, process.returncode


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("which", nargs="*", metavar="WHAT", help=", ".join(SIZES))
    which = parser.parse_args().which or list(SIZES)
    print(f"{'what':28} {'size':>8} {'time [s]':>9} {'memory [MB]':>12} {'exit':>5}", flush=True)
    for name in which:
        sizes, what, words = SIZES[name]
        for size in sizes:
            with tempfile.TemporaryDirectory() as folder:
                seconds, memory, code = taken(words(Path(folder), size), Path(folder))
            print(f"{what:28} {size:8d} {seconds:9.1f} {memory:12.0f} {code:5d}", flush=True)


if __name__ == "__main__":
    main()
