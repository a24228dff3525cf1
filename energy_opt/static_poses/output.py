"""Output of `identify`: identify.json, the models of both methods, a plot and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import write_json
from energy_opt.folders import written_whole
from energy_opt.power import PowerModel
from energy_opt.reports.identify import page
from energy_opt.reports.plots import COLOURS, labelled, legend_beside, new_figure, save

ANSWER = "identify.json"


def write(
    out: Path, document: Mapping[str, Any], models: Mapping[str, PowerModel | None], load: Sequence[float],
    power: Sequence[float],
) -> None:  # fmt: skip
    """Write identify.json (`document`), the models by their names, plot.png and report.html into a folder.

    Args:
        load, power: of the poses, |gravity torque|^2 [(N m)^2] and mean power [W].
    """
    with written_whole(out, ANSWER) as aside:
        for name, model in models.items():
            if model is not None:
                model.save(aside / f"{name}.toml")
        write_json(aside / ANSWER, document)
        _plot(document, load, power, aside / "plot.png")
        page(document, load, power, document["robot"]).write(aside / "report.html")


def _plot(document: Mapping[str, Any], load: Sequence[float], power: Sequence[float], path: Path) -> None:
    """Static power over squared gravity torque, with both methods' lines."""
    figure, axes = new_figure(1, 1, width=9.5, height=4.2)
    robot, standby, line = document["robot"], document["method1"]["standby"], document["method2"]
    at = labelled(axes[0, 0], "|gravity torque|^2 [(N m)^2]", "static power [W]", f"{robot}: static poses")
    at.plot(load, power, "o", color=COLOURS[0], label="poses")
    ends = np.array([0.0, max(load) * 1.05])
    at.plot(ends, np.full(2, standby), "--", color=COLOURS[5], label=f"Method 1: {standby:.2f} W")
    if line is not None:
        r, p0 = line["r_over_kt2"], line["standby"]
        label = f"Method 2: {p0:.2f} W + {r:.4g} W/(N m)^2, R^2 = {line['r_squared']:.3f}"
        at.plot(ends, p0 + r * ends, color=COLOURS[1], label=label)
    legend_beside(at)
    save(figure, path)
