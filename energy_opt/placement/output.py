"""The output of `place`: place.json, map.png, report.html, and the job solved at the answer in job/."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import plain, write_json
from energy_opt.jobs.output import write as write_job
from energy_opt.placement.placement import Placement
from energy_opt.reports.page import Report


def write(placement: Placement, request: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Write place.json, map.png, report.html and the job's folder.

    Args:
        placement: the answer. request: its document. out: the folder.

    Returns:
        The content of place.json.
    """
    from energy_opt.reports.plots import plot_placements, png

    found = {**placement.document(), "request": plain(request)}
    (Path(out) / "job").mkdir()
    write_job(placement.result, request, Path(out) / "job")
    looked = placement.looked_at
    places = np.array([at.place[:2] for at in looked]).reshape(-1, 2)
    solved = [at for at in placement.path if np.isfinite(at.energy) and at.kind in ("seed", "step")]
    solved = [
        at for at in solved if at.kind == "step" or at.energy == min(s.energy for s in solved if s.kind == "seed")
    ]
    energies = np.array([at.energy for at in looked])
    path = [at.place[:2] for at in solved if at.place != placement.place]
    given = placement.given[0], placement.given[1]
    figure = plot_placements(places[:, 0], places[:, 1], energies, [*path, placement.place[:2]], given)  # type: ignore[list-item]
    picture = png(figure)
    (Path(out) / "map.png").write_bytes(picture)
    what = placement.fixture or "base"
    report = Report(f"{found['robot']}: the cheapest place of the {what}").headline(headline(found))
    for warning in found["warnings"]:
        report.warning(warning)
    report.picture(picture, f"Estimates of the cycle's energy over x and y of the {what}, and the path of the search")
    records = [[at.kind, *at.place, at.document("")["energy_total"]] for at in placement.path]
    report.section("Placements at which the job was solved").table(
        ["", "x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]", "energy [J]"], records
    )
    report.section("The job at the answer").text("Its own report is job/report.html.").command(request)
    report.write(Path(out) / "report.html")
    write_json(Path(out) / "place.json", found)
    return found


def headline(found: Mapping[str, Any]) -> str:
    """A summary in one sentence."""
    what = found.get("fixture")
    x, y, z, _, _, yaw = found["base" if what is None else "pose"]
    at = f"{what or 'Base'} at x {x:.4g} m, y {y:.4g} m, z {z:.4g} m, yaw {yaw:.4g} rad"
    models = [model["name"] for model in (found["request"].get("robust") or {}).get("models", ())]
    mean = f" in the mean of {' and '.join(models)}" if models else ""
    words = f"{at}: {found['energy_total']:.4g} J a cycle{mean}"
    if found["saving"] is None:
        return words + "; the job is not possible at the given place."
    given, percent = found["given"]["energy_total"], found["saving"]["percent"]
    return words + f", {percent:.3g} % less than the {given:.4g} J at the given place."
