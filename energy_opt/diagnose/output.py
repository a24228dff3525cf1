"""What a diagnosis leaves behind: the files of a result folder."""

from __future__ import annotations

from pathlib import Path

from energy_opt.diagnose.diagnosis import Diagnosis
from energy_opt.diagnose.unmetered import JointDiagnosis
from energy_opt.files import write_json


def write(result: Diagnosis, out: str | Path) -> None:
    """Write diagnosis.json, model.toml and report.html into `out`."""
    from energy_opt.diagnose.page import page  # plots are slow to import

    out = Path(out)
    write_json(out / "diagnosis.json", result.document)
    result.model.save(out / "model.toml")
    page(result).write(out / "report.html")


def write_joints(result: JointDiagnosis, out: str | Path) -> None:
    """The same three files of a set without a meter."""
    from energy_opt.diagnose.joints_page import page_of_joints

    out = Path(out)
    write_json(out / "diagnosis.json", result.document)
    result.model.save(out / "model.toml")
    page_of_joints(result).write(out / "report.html")
