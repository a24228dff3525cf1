"""What is shipped: one version everywhere, data files inside the package, and nothing of a machine in the files."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

import energy_opt
from energy_opt.robot.catalog import CATALOG, DATA, urdf_of

ROOT = Path(__file__).resolve().parents[2]


def test_one_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == energy_opt.__version__
    assert f"## [{energy_opt.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_citation_names_the_source_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["references"][0]["identifiers"][0]["value"] == "arXiv:2411.03194"


def test_data_files_lie_in_the_package() -> None:
    assert {e.file for e in CATALOG.values() if e.own} == {f"urdf/{p.name}" for p in (DATA / "urdf").glob("*.urdf")}
    assert {p.stem for p in (DATA / "limits").glob("*.yaml")} <= set(CATALOG)
    for entry in CATALOG.values():
        assert urdf_of(entry).is_file()
    assert "Redistribution and use" in (DATA / "urdf/NOTICE").read_text()


@pytest.mark.skipif(shutil.which("git") is None or not (ROOT / ".git").exists(), reason="not a git work tree")
def test_no_path_of_a_machine_in_tracked_files() -> None:
    found = subprocess.run(
        ["git", "grep", "-nIE", r"(^|[^A-Za-z0-9._/-])/(home|root|tmp|work|farm|Users)/[a-z]"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert found.stdout == ""
