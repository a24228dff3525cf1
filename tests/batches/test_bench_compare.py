"""Comparison of two runs: changes beyond noise and nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest

from energy_opt.batches.compare import compare, comparison_text
from energy_opt.batches.records import COLUMNS, read_parquet, write_parquet
from energy_opt.batches.summary import distribution, machine
from energy_opt.errors import BadInput

MOVES = 30


def rows(seed=0, **changes):
    rng = np.random.default_rng(seed)
    out = []
    for k in range(MOVES):
        row = dict.fromkeys(COLUMNS)
        row |= {"suite": "s", "robot": "panda", "move": f"m{k}", "mode": "reshape", "timing": "1.5x", "payload": ""}
        row |= {"model": "source", "objective": "energy", "status": "solved", "duration": 2.0, "max_violation": -0.1}
        row |= {"energy_total": 200.0 + k, "energy_loss": 10.0 + k, "solve_seconds": 0.1 * rng.uniform(0.9, 1.1)}
        out.append(row)
    for k, change in changes.items():
        out[int(k[1:])] |= change
    return out


def saved(folder, content, **summary):
    folder.mkdir()
    write_parquet(folder / "results.parquet", content)
    (folder / "summary.json").write_text(json.dumps({"machine": machine(), **summary}))
    return folder


def test_parquet_keeps_rows(tmp_path):
    content = rows(m3={"error": "why", "energy_total": None})
    write_parquet(tmp_path / "a.parquet", content)
    assert read_parquet(tmp_path / "a.parquet") == content


def test_noise_is_no_change(tmp_path):
    noisy = rows(seed=1, m4={"energy_loss": 14.0 * (1 + 5e-4)})
    found = compare(saved(tmp_path / "a", rows()), saved(tmp_path / "b", noisy))
    assert (found["better"], found["worse"]) == ([], [])
    assert [row["verdict"] for row in found["times"]] == ["same"]


def test_changes_are_named(tmp_path):
    changed = rows(
        m2={"energy_loss": 12.5, "energy_total": 202.5},
        m3={"energy_loss": 12.0, "energy_total": 202.0},
        m5={"status": "infeasible", "error": "joint 4 too weak", "energy_loss": None},
        m6={"max_violation": 1e-3},
        m7={"duration": 2.5, "energy_loss": 1.0},
    )
    found = compare(saved(tmp_path / "a", rows()), saved(tmp_path / "b", changed))
    assert {(c["move"], c["what"]) for c in found["worse"]} == {
        ("m2", "energy_loss"),
        ("m5", "status"),
        ("m6", "max_violation"),
    }
    assert {(c["move"], c["what"]) for c in found["better"]} == {("m3", "energy_loss")}
    assert "joint 4 too weak" in comparison_text(found)


def test_slower_beyond_noise(tmp_path):
    slow = rows(seed=1)
    for row in slow:
        row["solve_seconds"] *= 1.3
    old, new = saved(tmp_path / "a", rows()), saved(tmp_path / "b", slow)
    assert [row["verdict"] for row in compare(old, new)["times"]] == ["worse"]
    assert [row["verdict"] for row in compare(new, old)["times"]] == ["better"]


def test_times_of_other_machines_are_not_compared(tmp_path):
    old, new = saved(tmp_path / "a", rows()), saved(tmp_path / "b", rows(), machine={**machine(), "cpu": "other"})
    found = compare(old, new)
    assert not found["same_machine"]
    assert found["times"] == []
    assert "not compared" in comparison_text(found)


def test_incomparable_results_are_reported(tmp_path):
    with pytest.raises(BadInput, match="cannot be read"):
        compare(tmp_path, tmp_path)
    other = [{**row, "suite": "t"} for row in rows()]
    with pytest.raises(BadInput, match="no move in common"):
        compare(saved(tmp_path / "a", rows()), saved(tmp_path / "b", other))
    (tmp_path / "x.parquet").write_text("no")
    with pytest.raises(BadInput, match="cannot be read as Parquet"):
        compare(tmp_path / "x.parquet", tmp_path / "a")


def test_distribution_of_nothing_and_something():
    assert distribution([None])["mean"] is None
    found = distribution([1.0, None, 3.0])
    assert (found["count"], found["mean"], found["worst"], found["best"]) == (2, 2.0, 1.0, 3.0)
