"""A batch's summary holds its request, as every other result does."""

from __future__ import annotations

from pathlib import Path

import pytest

from energy_opt.cli.main import main
from energy_opt.files import read_json

SUITE = """format = "energy-opt/suite/1"
robots = ["z1"]
modes = ["retime"]
models = ["source_method_2"]
[[moves]]
start = [0, 1, -1, 0, 0, 0]
goal = [0.3, 1.2, -1.1, 0.1, 0.1, 0]
"""


def test_run_repeats_a_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`run summary.json` found no request in it."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here/suite.toml").write_text(SUITE)
    monkeypatch.chdir(tmp_path / "here")
    assert main(["bench", "suite.toml", "--seed", "3", "--payload", "0.5", "--jobs", "1", "--quiet"]) == 0
    (summary,) = tmp_path.glob("here/*/summary.json")
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(summary), "--out", "again", "--quiet"]) == 0
    first, again = read_json(summary), read_json(tmp_path / "again/summary.json")
    assert first["request"]["verb"] == "bench" and first["request"]["seed"] == 3
    assert again["savings"] == first["savings"]
