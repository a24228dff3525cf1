"""Numbers from which a claim is judged: errors of held-out motions, ratios to the noise, and the veto of motions."""

from __future__ import annotations

import numpy as np
import pytest

from energy_opt.diagnosis.evidence.errors import Quality, mostly_explained
from energy_opt.diagnosis.verdict.judge import contradicted


def test_the_ratio_to_the_noise_is_the_worst_of_motion_and_rest():
    def of(motion: float, rest: float) -> float:
        return Quality(motion, rest, 1.0, 0.5, max(motion, rest), 1.0, np.zeros(1), np.ones(1)).ratio

    assert of(1.5, 0.1) == 1.5 and of(0.1, 0.9) == 1.8


def test_what_is_mostly_explained_is_so_without_its_best_motion():
    def of(*squares: float) -> Quality:
        return Quality(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, np.array(squares), np.full(len(squares), 100.0))

    before = of(20.0, 30.0, 40.0, 50.0)
    assert mostly_explained(before, of(2.0, 2.0, 2.0, 2.0), unknown=False)
    assert not mostly_explained(before, of(6.0, 8.0, 10.0, 12.0), unknown=False)
    assert not mostly_explained(of(2.0, 3.0, 4.0, 500.0), of(2.0, 2.5, 3.0, 1.0), unknown=False)
    assert mostly_explained(of(1.1, 2.2, 2.3, 3.7), of(1.1, 1.3, 1.0, 1.0), unknown=False)
    assert not mostly_explained(of(1.1, 2.2, 2.3, 3.7), of(1.1, 1.3, 1.2, 1.3), unknown=True)


def test_what_is_mostly_explained_is_so_in_watts():
    """White squares hardly contain slow errors: of 24 W^2 above the noise, 3 are left, or 2."""

    def of(rmse: float, square: float) -> Quality:
        return Quality(rmse, rmse, 1.0, 1.0, rmse, 1.0, np.full(4, square), np.full(4, 100.0))

    assert not mostly_explained(of(5.0, 9.0), of(2.0, 1.0), unknown=True)
    assert mostly_explained(of(5.0, 9.0), of(1.7, 1.0), unknown=True)
    assert mostly_explained(of(5.0, 9.0), of(2.0, 1.0), unknown=False)
    assert not mostly_explained(of(5.0, 9.0), of(2.2, 1.0), unknown=False)


def test_an_error_is_lower_in_watts_and_with_each_motion_counted_once():
    def of(rmse: float, *squares: float) -> Quality:
        return Quality(rmse, rmse, 1.0, 1.0, rmse, 1.0, np.array(squares), np.array([900.0, 10.0, 10.0]))

    declared = of(2.0, 4.0, 1.0, 1.0)
    assert of(1.0, 1.0, 1.0, 1.0).lower(declared)
    assert not of(1.9, 3.6, 1.3, 1.3).lower(declared)  # one long motion gains, two others lose as much
    assert not of(2.1, 1.0, 1.0, 1.0).lower(declared)


@pytest.mark.parametrize(
    ("gains", "against"),
    [
        ((2.0, 4.0, 30.0, -14.0, 117.0, -81.0, 43.0), True),
        ((2.0, 4.0, 30.0, -6.0, 50.0), False),  # as chance has it
        ((-19.0, 240.0, 13_000.0), False),  # small beside what other motions say
    ],
)
def test_motions_veto_an_effect_that_they_are_worse_with(gains, against):
    assert contradicted(gains) is against
