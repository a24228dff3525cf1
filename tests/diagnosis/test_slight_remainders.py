"""Laws that are too small to matter for a plan."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.diagnosis.verdict import usable
from energy_opt.diagnosis.verdict.usable import Foreseen, foreseen_by


def fit(residual, free=()):
    samples, whiten = SimpleNamespace(weight=np.ones(100)), SimpleNamespace(noise=SimpleNamespace(white=1.0))
    world, nuisance = SimpleNamespace(samples=samples, whiten=whiten), SimpleNamespace(offset=0.0, drift=0.0)
    return SimpleNamespace(residual=residual, free=free, world=world, nuisance=nuisance)


@pytest.mark.parametrize(
    ("verdict", "law", "ratio", "blocked"),
    [
        ("nothing_missing", 0.4, 1.0, False),
        ("partly", 0.1, 1.0, False),
        ("partly", 1.0, 1.0, True),  # as large as the noise
        ("partly", 0.1, 1.4, True),  # more than the noise is left
        ("unexplained", 0.1, 1.4, True),
    ],
)
def test_a_law_far_below_noise_and_cause_leaves_a_model_usable(monkeypatch, verdict, law, ratio, blocked):
    wave = np.cos(np.arange(100.0))
    seen = Foreseen(5.0, 8, "a part of the power depends on torque at rest by no known law")
    noises = []
    monkeypatch.setattr(usable, "foreseen", lambda model, samples, noise, *more: noises.append(noise) or seen)
    monkeypatch.setattr(usable, "drift_of", lambda *args, **more: np.zeros(1))
    found = SimpleNamespace(
        verdict=verdict, misspecified=True, idle=(), rivals=(None,), noise=1.0, after=SimpleNamespace(ratio=ratio),
        best=fit(wave, (SimpleNamespace(signal="torque at rest"),)), accepted=fit(wave + law), root=fit(9 * wave),
    )  # fmt: skip
    out = foreseen_by(found, None, None, ("a", "b"))
    assert bool(out.reason) == blocked and noises == [None]
