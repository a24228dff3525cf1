"""Programs of a cell's arms at a rate: planned with room for it, or a word on why another one was taken."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

import energy_opt as eo
from energy_opt.formats import cycle_file
from energy_opt.formats.controller_files import with_room

STEPS = [{"to": [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]}, {"to": [0.0, 1.0, -1.0, 0.0, 0.0, 0.0]}]
OPTIONS = {"model": "source-method-2", "starts": 1, "self_collision": "off"}


def cell(mode: str) -> dict[str, Any]:
    """A cell of one arm."""
    steps = [{**step, "mode": mode} for step in STEPS]
    return {"format": "energy-opt/job/2", "cycle_time": 4.0, "robot": [{"name": "a", "robot": "z1", "step": steps}]}


def test_a_limit_that_several_files_break_is_tightened_once() -> None:
    """With four files, 28 % more jerk became less than half of its bound, and nothing was planned again."""
    over = SimpleNamespace(found=[SimpleNamespace(limit="jerk", excess=0.28)], violation=0.28, clear=True)
    kept = SimpleNamespace(found=[], violation=0.0, clear=True)
    answer, shares = with_room("first", lambda found: [over if found == "first" else kept] * 4, lambda _: "second")
    assert answer == "second" and shares["jerk"] == pytest.approx(1 / (1 + 1.2 * 0.28), rel=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:planned with a margin")
def test_a_cell_is_planned_again_with_room_for_the_rate_that_is_asked_for() -> None:
    """A table at 250 Hz was written in place of one at 25 Hz."""
    found = eo.job(cell("reshape"), write=["csv"], rate=25.0, **OPTIONS)
    assert [(row.file, row.valid) for row in found.files] == [("cycle_a.csv", True), ("cycle_a_25hz.csv", True)]
    assert any(said.startswith("planned with a margin for the written samples") for said in found["warnings"])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:cycle_a")
def test_a_rate_that_is_not_kept_is_a_warning_and_its_table_is_listed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The judged samples were listed twice, and no message told that there is no table at the rate."""
    monkeypatch.setattr(cycle_file, "resampled", lambda t, rate: t.slowed(t.duration / 20))  # breaks limits
    found = eo.job(cell("retime"), write=["csv"], rate=50.0, stopped=lambda: True, **OPTIONS)
    assert [(row["file"], row["rate"]) for row in found["written"]] == [("cycle_a.csv", None)]
    assert any(said.startswith("cycle_a.csv: ") and "at 50 Hz the " in said for said in found["warnings"])
