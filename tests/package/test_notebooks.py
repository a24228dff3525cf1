"""The notebooks under notebooks/ run from top to bottom, with short horizons; their kept outputs hold no error."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.ipynb"))
LARGEST = 500_000  # [byte] of a notebook with its pictures


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENERGY_OPT_SHORT", "1")
    notebook = nbformat.read(path, as_version=4)
    kept = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert kept and not [output for output in kept if output.output_type == "error"]
    assert path.stat().st_size < LARGEST
    NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
