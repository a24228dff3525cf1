"""A few of the random option sets of benchmarks/option_sets.py, run and judged as there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_random_option_sets_are_answered_rightly(tmp_path: Path) -> None:
    words = ["benchmarks/option_sets.py", "--count", "6", "--out", str(tmp_path / "rows.jsonl")]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_evaluator_shares_nothing_with_the_package() -> None:
    for name in ("benchmarks/option_judge.py", "tests/independent.py"):
        text = (ROOT / name).read_text()
        assert "import energy_opt" not in text and "from energy_opt" not in text
