"""A cycle along its time: what the arm does, what it carries, and the power it draws, one above the other."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from energy_opt.reports.charts import thinned

WIDE, LEFT, RIGHT = 1000.0, 70.0, 10.0  # of the drawing, its scale for the eye alone
LANE, GAP, POWER = 26.0, 8.0, 150.0  # heights of a lane, between lanes, and of the power
FILLS = {"move": "#2f74c0", "wait": "#b8bfc8", "standby": "#e5d7a8", "payload": "#2e9a60"}
LETTER = 7.0  # width of one
NARROW = 800  # points of the power's line


def timeline(
    steps: Sequence[Mapping[str, Any]], length: float, power: tuple[np.ndarray, np.ndarray] | None = None
) -> str:
    """An SVG drawing.

    Args:
        steps: name, kind ("move", "wait" or "standby"), start, duration [s] and payload [kg].
        length: of the cycle [s].
        power: time (N,) [s] and power (N,) [W], drawn below.
    """
    scale = (WIDE - LEFT - RIGHT) / max(length, 1e-9)

    def at(time: float) -> float:
        return LEFT + scale * float(time)

    kinds = ["move", "wait", *(["standby"] if any(s["kind"] == "standby" for s in steps) else [])]
    parts, y = [], 0.0
    for kind in kinds:
        parts.append(text(LEFT - 6, y + LANE / 2, kind + "s" * (kind != "standby"), "end"))
        for step in steps:
            if step["kind"] == kind:
                width = scale * step["duration"]
                parts.append(block(at(step["start"]), y, width, str(step["name"]), FILLS[kind], kind == "move"))
        y += LANE + GAP
    loads = _joined(steps)
    if any(mass for _, _, mass in loads):
        parts.append(text(LEFT - 6, y + LANE / 2, "payload", "end"))
        for begin, end, mass in loads:
            if mass:
                parts.append(block(at(begin), y, scale * (end - begin), f"{mass:.3g} kg", FILLS["payload"]))
        y += LANE + GAP
    lines, marks, y = with_time(parts, power, length, at, y)
    return drawing([*lines, *parts, *marks], y + 20, "timeline")


def with_time(
    parts: list[str], power: tuple[np.ndarray, np.ndarray] | None, length: float, at: Callable[[float], float], y: float
) -> tuple[list[str], list[str], float]:
    """Add the line of power to a drawing's parts, and make its time axis.

    Args:
        power: time (N,) [s] and power (N,) [W]; None: not known. length: of the axis [s].
        at: the place of a time. y: the height of what is drawn so far.

    Returns: vertical lines, their labels, and the height of all.
    """
    if power is not None and len(power[0]) > 1:
        parts += power_line(*power, at, y)
        y += POWER + GAP
    marks = [text(at(tick), y + 10, f"{tick:.3g} s") for tick in ticks(length)]
    place = f'y1="0" y2="{y:.0f}" stroke="var(--rule)"'
    return [f'<line x1="{at(tick):.1f}" x2="{at(tick):.1f}" {place}/>' for tick in ticks(length)], marks, y


def drawing(parts: Sequence[str], height: float, label: str) -> str:
    """An SVG drawing `WIDE` wide and `height` high; `label` says what it shows."""
    return (
        f'<svg viewBox="0 0 {WIDE:.0f} {height:.0f}" width="100%" role="img" aria-label="{label}" '
        f'font-size="12" fill="var(--ink)">{"".join(parts)}</svg>'
    )


def _joined(steps: Sequence[Mapping[str, Any]]) -> list[tuple[float, float, float]]:
    """Begin, end [s] and mass [kg] of each payload, as long as it stays."""
    out: list[tuple[float, float, float]] = []
    for step in steps:
        end, mass = step["start"] + step["duration"], float(step["payload"] or 0.0)
        if out and out[-1][2] == mass:
            out[-1] = (out[-1][0], end, mass)
        else:
            out.append((step["start"], end, mass))
    return out


def power_line(time: np.ndarray, power: np.ndarray, at: Callable[[float], float], y: float) -> list[str]:
    """A line of power (N,) [W] over time (N,) [s], `POWER` high from y on; `at` gives the place of a time."""
    low, high = min(0.0, float(power.min())), max(float(power.max()), 1e-9)

    def up(watts: float) -> float:
        return y + POWER * (1 - (watts - low) / (high - low))

    keep = thinned(len(time), NARROW)
    points = " ".join(f"{at(t):.1f},{up(p):.1f}" for t, p in zip(time[keep], power[keep], strict=True))
    lines = [f'<polyline points="{points}" fill="none" stroke="#d1691c" stroke-width="1.5"/>']
    for watts in (0.0, high):
        lines.append(text(LEFT - 6, up(watts) + (5 if watts else -5), f"{watts:.3g} W", "end"))
    return lines


def block(x: float, y: float, width: float, name: str, fill: str, dark: bool = True) -> str:
    """A bar with its name, as much of it as there is room for; white letters on a dark one."""
    letters = int(width / LETTER)
    shown = name if len(name) <= letters else name[: max(letters - 1, 0)] + "…" if letters > 2 else ""
    label = text(x + width / 2, y + LANE / 2, shown, ink="#fff" if dark else "#000")
    title = f"<title>{html.escape(name)}</title>"
    return (
        f'<g>{title}<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 1.0):.1f}" height="{LANE:.0f}" rx="3" '
        f'fill="{fill}" stroke="var(--paper)"/>{label}</g>'
    )


def text(x: float, y: float, text: str, anchor: str = "middle", ink: str = "var(--dim)") -> str:
    """A line of text, escaped; nothing for an empty one."""
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" dominant-baseline="middle" fill="{ink}"'
    return f"<text {place}>{html.escape(text)}</text>" if text else ""


def ticks(length: float) -> list[float]:
    """Round times, some six of them, [s]."""
    rough = max(length, 1e-9) / 6
    step = 10.0 ** np.floor(np.log10(rough))
    step *= next(factor for factor in (1, 2, 5, 10) if factor * step >= rough * (1 - 1e-9))
    return [float(k * step) for k in range(int(length / step + 1e-9) + 1)]
