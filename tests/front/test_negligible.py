"""Differences of energy that are rounding errors are not stated as savings or costs."""

from __future__ import annotations

import pytest

from energy_opt.front.models import said


@pytest.mark.parametrize(
    ("joules", "expected"),
    [
        (4e-14, "takes 60.729 J, as much as the evenly slowed one"),
        (-4e-14, "takes 60.729 J, as much as the evenly slowed one"),
        (2.0, "takes 60.729 J, 2 J less than the evenly slowed one"),
        (-2.0, "takes 60.729 J, 2 J more than the evenly slowed one; plan with a model that was calibrated"),
        (None, "takes 60.729 J"),
    ],
)
def test_rounding_errors_are_no_savings(joules: float | None, expected: str) -> None:
    records = [{"name": "one"}, {"name": "other", "total": 60.729, "saving_joules": joules}]
    (text,) = said(records, "the cycle")
    assert text == f"planned under one alone, without friction; under other the cycle {expected}"
