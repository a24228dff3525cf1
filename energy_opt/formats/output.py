"""The files of a planned trajectory for others: which formats, at which rate, judged as controllers will run them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from energy_opt.errors import BadInput, near
from energy_opt.formats import FORMATS, Format, franka, urscript
from energy_opt.formats.resample import Judge, at_rate, lowest, resampled
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory


def wanted(names: Sequence[str]) -> list[Format]:
    """The formats of these names, each once.

    Raises:
        BadInput: one is not known, or only read.
    """
    known = [name for name, f in FORMATS.items() if f.write is not None]
    for name in names:
        if name not in known:
            raise BadInput(f"--write {name!r}; known are {', '.join(known)}{near(name, known)}")
    return [FORMATS[name] for name in dict.fromkeys(names)]


def write(
    trajectory: Trajectory,
    scorer: Scorer,
    judge: Judge,
    formats: Sequence[Format],
    out: Path,
    rate: float | None = None,
    prefix: str = "",
) -> list[str]:
    """Write a judged trajectory in several formats into a folder; a line about each file.

    Args:
        rate: samples per second, None for the judged rows themselves. The 1 kHz of `franka` is its own; `urscript`
            takes the lowest of the usual rates that holds all limits where none is given.
        prefix: what stands before the joints' names in the files.

    Raises:
        BadInput: the rate is too low to stay within limits, or the arm is not one that a format is for.
    """
    lines = []
    for f in formats:
        chosen, name, how = trajectory, f"trajectory{f.suffix}", "as judged"
        if f.name == "franka":
            chosen, how = franka.prepared(trajectory, scorer.robot.limits), "1 kHz, within libfranka's checks"
        elif rate is not None:
            chosen, how = at_rate(trajectory, rate, judge), f"{rate:g} Hz, quintic between points"
        elif f.name == "urscript":
            urscript.check_arm(trajectory)
            found = lowest(trajectory, judge)
            if found is not None:
                chosen, how = resampled(trajectory, found), f"{found:g} Hz, quintic between points"
        if f.name == "csv" and rate is None:
            continue  # trajectory.csv is there
        if f.name == "csv":
            name = f"trajectory_{rate:g}hz.csv"
        if chosen is not trajectory and f.name not in ("franka", "urscript"):
            chosen = scorer.filled(chosen)
        assert f.write is not None
        f.write(replace(chosen, joints=tuple(prefix + joint for joint in chosen.joints)), out / name)
        lines.append(f"{out / name}: {f.text}, {how}")
    return lines
