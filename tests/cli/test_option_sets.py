"""A few of the random option sets of benchmarks/option_sets.py, run and judged as there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pyarrow as table
import pytest
from pyarrow import parquet

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_random_option_sets_are_answered_rightly(tmp_path: Path) -> None:
    words = ["benchmarks/option_sets.py", "--count", "4", "--out", str(tmp_path / "rows.jsonl")]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_evaluator_shares_nothing_with_the_package() -> None:
    for name in ("benchmarks/option_judge.py", "benchmarks/option_arm.py", "tests/independent.py"):
        text = (ROOT / name).read_text()
        assert "import energy_opt" not in text and "from energy_opt" not in text


def test_the_evaluator_convicts_cycles_and_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cycle that stands still where it should go, ends too late and costs another energy; a row that costs more."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import option_judge
    import option_sets

    robot = option_sets.robot_of("z1")
    home = [0.0, 1.0, -1.0, 0.0, 0.0, 0.0]
    columns = {f"{joint}.{kind}": value * (kind == "position") for kind in ("position", "velocity", "acceleration")
               for joint, value in zip(robot.joints, home, strict=True)}  # fmt: skip
    lines = [",".join(["time", *columns])] + [",".join(map(str, [t, *columns.values()])) for t in (0.0, 0.5, 1.0)]
    (tmp_path / "cycle.csv").write_text("\n".join(lines) + "\n")
    model = {"effect": [{"name": "standby", "power": 50.0}]}
    found = {"request": {"model": model}, "energy_total": 60.0, "steps": [{"duration": 1.0, "energy_total": 60.0}]}
    (tmp_path / "job.json").write_text(json.dumps(found))
    asked = {"start": home, "cycle_time": 1.2, "wait": 0.4, "passes": [[0.3, *home[1:]]]}
    said = option_judge.judge_cycle(robot, asked, tmp_path)
    assert sorted(fault.split(":")[0] for fault in said) == ["cycle time", "energy", "files", "pass", "steps' times"]
    row = {"status": "solved", "mode": "retime", "max_violation": 1e-3, "saving_loss_percent": -2.0}
    row |= {"saving_total_percent": -1.0, "energy_standby": 5.0, "energy_loss": 1.0, "energy_total": 6.0}
    parquet.write_table(table.Table.from_pylist([row]), tmp_path / "results.parquet")
    assert len(option_judge.judge_batch(tmp_path)) == 2
