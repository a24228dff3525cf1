"""Long motions are judged in one pass, piece by piece, of which nothing is kept."""

from __future__ import annotations

import numpy as np
import pytest

from energy_opt.effects import CopperLoss, Standby
from energy_opt.motion.judge import energy
from energy_opt.motion.judge.certificate import certify, certify_and_score
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.joint import Effort, Jerk, Position, Velocity
from energy_opt.motion.limits.own import Power
from energy_opt.motion.limits.via import ViaPoints
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


@pytest.fixture(scope="module")
def motion(panda: Robot) -> Trajectory:
    """Sines, whose derivatives are known."""
    t, n = np.linspace(0, 6, 601), np.arange(1, 8)
    middle = np.array([0, 0, 0, -1.5, 0, 1.6, 0])
    phase = 0.3 * n * t[:, None]
    q, v = middle + 0.4 * np.sin(phase), 0.12 * n * np.cos(phase)
    return Trajectory(panda.joints, t, q, v, -0.036 * n**2 * np.sin(phase))


def test_pieces_find_what_the_whole_has(
    panda: Robot, model: PowerModel, motion: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    scorer, via = Scorer(panda, model), ViaPoints(motion.position[[150, 431]])
    limits = Velocity(panda.limits.velocity), via, Power(300.0)
    whole = certify(motion, scorer, limits), scorer.energy(motion), scorer.filled(motion)
    monkeypatch.setattr(energy, "BLOCK", 1700)
    assert len(energy.blocks(motion, 10)) == 4
    pieces = certify_and_score(motion, scorer, limits)
    assert certify(motion, scorer, limits) == pieces[0]
    assert pieces[0].samples == whole[0].samples == 6001
    assert [x.limit for x in pieces[0].found] == ["velocity", "via", "power"]
    for a, b in zip(pieces[0].found, whole[0].found, strict=True):
        assert a.excess == pytest.approx(b.excess, abs=1e-6) and a.time == pytest.approx(b.time, abs=1e-9)
    assert pieces[0].found[1].excess < -0.9  # both points are passed, in two of the pieces
    assert pieces[0].peak_power == pytest.approx(whole[0].peak_power, rel=1e-12)
    assert pieces[1].total == pytest.approx(whole[1].total, rel=1e-12)
    assert pieces[1].by_effect == pytest.approx(whole[1].by_effect, rel=1e-9, abs=1e-9)
    assert pieces[2].power == pytest.approx(whole[2].power, rel=1e-12)
    assert pieces[2].effort == pytest.approx(whole[2].effort, rel=1e-12, abs=1e-12)


def test_peaks_of_effort_between_the_places_are_found(panda: Robot, model: PowerModel) -> None:
    """A bound that all places of the grid keep, and a peak between them does not: it is found."""
    rng = np.random.default_rng(4)
    for _ in range(4):
        t, rows = np.array([0.0, 0.02, 0.04]), rng.normal(size=(3, 3, 7))
        q = np.array([0, 0, 0, -1.5, 0, 1.6, 0]) + 1e-3 * rows[0]
        motion = Trajectory(panda.joints, t, q, 0.5 * rows[1], 20 * rows[2])
        places, fine = (
            np.abs(panda.body.torque(*motion.sample(np.linspace(0, 0.04, count))[:3])).max(axis=0)
            for count in (21, 40_001)
        )
        found = certify(motion, Scorer(panda, model), [Effort(places * (1 + 1e-9))]).found[0]
        assert found.excess == pytest.approx((fine / places - 1).max(), rel=1e-3, abs=1e-6)
        assert found.excess > 1e-5


def test_peaks_of_power_between_the_places_are_found(panda: Robot) -> None:
    """p = tau . v + r tau . tau + overhead, by Pinocchio's torque, a thousand times finer than the grid."""
    rng, model = np.random.default_rng(4), PowerModel("panda", (Standby(power=80.0), CopperLoss(r_over_kt2=0.01)))
    for _ in range(4):
        t, rows = np.array([0.0, 0.02, 0.04]), rng.normal(size=(3, 3, 7))
        q = np.array([0, 0, 0, -1.5, 0, 1.6, 0]) + 1e-3 * rows[0]
        motion = Trajectory(panda.joints, t, q, 0.5 * rows[1], 20 * rows[2])
        most = []
        for count in (21, 20_001):
            q, v, a, _ = motion.sample(np.linspace(0, 0.04, count))
            tau = panda.body.torque(q, v, a)
            most.append(float(np.max(np.sum(tau * v + 0.01 * tau**2, axis=1) + 80.0)))
        found = certify(motion, Scorer(panda, model), [Power(most[0])])
        assert found.peak_power == pytest.approx(most[1], rel=2e-5) and most[1] > most[0] * (1 + 1e-3)
        assert found.found[0].excess == pytest.approx(most[1] / most[0] - 1, rel=1e-2)


def test_jerk_counts_on_both_sides_of_a_row(panda: Robot, model: PowerModel) -> None:
    """q = x^5 up to the middle row, where jerk is 60; from there on acceleration stays."""
    q, v, a = (np.outer(x, np.ones(7)) * 1e-3 for x in ([0, 1, 16], [0, 5, 25], [0, 20, 20]))
    motion = Trajectory(panda.joints, np.array([0.0, 1.0, 2.0]), q, v, a)
    assert motion.jerk_before_samples() == pytest.approx(1e-3 * np.outer([60, 0], np.ones(7)), abs=1e-12)
    found = certify(motion, Scorer(panda, model), [Jerk(np.full(7, 0.05))]).found[0]
    assert found.excess == pytest.approx(0.2) and found.time == 1.0


def test_more_time_does_not_ease_a_position(panda: Robot, model: PowerModel, motion: Trajectory) -> None:
    """At rest on a limit nothing is used more than the position; what makes a move last is another limit."""
    t = motion.time
    q = np.outer(t / t[-1], np.ones(7)) * 0.1
    steady = Trajectory(panda.joints, t, q, np.full_like(q, 0.1 / t[-1]), np.zeros_like(q))
    limits = Position(np.full(7, -1.0), np.full(7, 0.1)), Velocity(np.full(7, 0.02))
    found = certify(steady, Scorer(panda, model), limits)
    assert found.worst["limit"] == "position" and found.binding["limit"] == "velocity"
