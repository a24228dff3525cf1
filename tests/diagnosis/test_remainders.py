"""What is left of a residual, and the words for what links explain."""

from __future__ import annotations

from energy_opt.diagnosis.report.words import headline, next_step


def test_the_headline_gives_effects_no_share_that_links_explain():
    error = {"train": None, "holdout": {"power_rmse": 2.0, "energy_percent": 1.0}}
    document = {
        "effects": [{"name": "regeneration"}], "error": {"before": error, "after": error}, "verdict": "explained",
        "explained_share": 1.0, "links_share": 0.4, "fitted": [], "alternatives": [], "remainder": [], "usable": True,
    }  # fmt: skip
    assert "explains 60.0 %" in headline(document) and "links another 40.0 %" in headline(document)
    assert "check payload and links" in next_step(document)
