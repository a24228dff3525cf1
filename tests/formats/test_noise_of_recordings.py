"""Energies of recordings with noise and few digits, against exact ones: the same motion, by Pinocchio alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from energy_opt.evaluations.source import load
from energy_opt.formats.recording import motion_of
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.judge.energy import Scorer
from energy_opt.power.model import model_from_document
from energy_opt.robot import Robot, load_robot

COPPER = np.array([0.05, 0.05, 0.05, 0.3, 0.3, 0.3])  # [W / (N m)^2]
DRY = np.array([4.0, 4.0, 3.0, 0.8, 0.8, 0.8])  # [N m]
START = np.array([0.1, -1.2, 1.4, -1.2, -1.5, 0.05])
TURNED = np.array([0.9, -0.5, 0.6, -0.4, 0.3, -0.8])
REST, MOVE = 0.7, 1.5  # [s]
WHOLE = 3 * REST + 2 * MOVE


@pytest.fixture(scope="module")
def ur() -> Robot:
    return load_robot("ur5e")


def there_and_back(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities, accelerations (N, 6) of a move there and back, at rest before, between and after."""
    back = time > 1.5 * REST + MOVE
    u = np.clip(np.where(back, WHOLE - REST - time, time - REST) / MOVE, 0, 1)[:, None]
    way = np.where(back, -1, 1)[:, None]
    s, v, a = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)
    return START + TURNED * s, TURNED * way * v / MOVE, TURNED * a / MOVE**2


def one_by_one(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The joints move one after another, each for a sixth of the time; those that wait are at rest."""
    turn = WHOLE / 6
    u = np.clip((time[:, None] - turn * np.arange(6)) / turn, 0, 1)
    s, v, a = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)
    return START + TURNED * s, TURNED * v / turn, TURNED * a / turn**2


MOTIONS = {"all": there_and_back, "one by one": one_by_one}


@pytest.fixture(scope="module")
def exact(ur: Robot) -> dict[str, float]:
    """Energies [J]: heat of the motors and mechanical work; dry friction bears a part of the load at rest."""
    body = pinocchio.buildModelFromUrdf(str(ur.urdf))
    data, time, out = body.createData(), (np.arange(4000) + 0.5) / 4000 * WHOLE, {}
    for name, motion in MOTIONS.items():
        watts = 0.0
        for q, v, a in zip(*motion(time), strict=True):
            load = pinocchio.rnea(body, data, q, v, a)
            held = np.sign(load) * np.maximum(np.abs(load) - DRY, 0)
            torque = np.where(v == 0, held, load + DRY * np.sign(v))
            watts += float(COPPER @ torque**2 + torque @ v)
        out[name] = watts * WHOLE / len(time)
    return out


def readings(q: np.ndarray, kind: str, size: float) -> np.ndarray:
    """Positions as an instrument reads them: `size` digits, bits of an encoder, or rad of noise."""
    noise = np.random.default_rng(4)
    if kind == "digits":
        return np.round(q, int(size))
    if kind == "noise":
        return q + noise.normal(0, size, q.shape)
    step = 2 * np.pi / 2**size
    return step * np.round(q / step + noise.normal(0, 0.4 * (kind == "toggling"), q.shape))


@pytest.mark.parametrize("planned", [False, True])
@pytest.mark.parametrize(
    ("motion", "rate", "kind", "size"),
    [
        ("all", 30, "digits", 2),
        ("all", 50, "digits", 2),
        ("all", 50, "noise", 1e-3),
        ("all", 250, "toggling", 13),
        ("all", 1000, "digits", 3),
        ("all", 1000, "bits", 12),
        ("one by one", 50, "noise", 1e-3),
        ("one by one", 100, "toggling", 13),
        ("one by one", 250, "digits", 4),
    ],
)
def test_noise_takes_no_energy(
    motion: str, rate: int, kind: str, size: float, planned: bool, ur: Robot, exact: dict[str, float], tmp_path: Path
) -> None:
    """Between 9 % and ten thousand times too much: smoothed up to 0.02 s between samples only, and rests not seen."""
    time = np.arange(0, WHOLE, 1 / rate)
    q = readings(MOTIONS[motion](time)[0], kind, size)
    file = tmp_path / f"run.{'json' if planned else 'csv'}"
    if planned:
        points = [{"positions": x, "time_from_start": t} for x, t in zip(q.tolist(), time.tolist(), strict=True)]
        file.write_text(json.dumps({"joint_names": list(ur.joints), "points": points}))
    else:
        np.savetxt(file, np.c_[time, q], delimiter=",", header=",".join(["time", *ur.joints]), comments="")
    effects = [
        {"name": "copper_loss", "r_over_kt2": COPPER.tolist()},
        {"name": "coulomb_friction", "tau_c": DRY.tolist()},
    ]
    model = model_from_document({"format": "energy-opt/model/1", "robot": "ur5e", "effect": effects}, "model")
    found = load(file, ur.joints)
    assert any("noisy" in note for note in found.notes)
    assert Scorer(ur, model).energy(found.trajectory).total == pytest.approx(exact[motion], rel=0.06)


@pytest.mark.parametrize("rate", [22, 50, 1000])
@pytest.mark.parametrize("motion", list(MOTIONS))
def test_exact_positions_are_not_smoothed(motion: str, rate: int, ur: Robot) -> None:
    time = np.arange(0, WHOLE, 1 / rate)
    t, notes = motion_of(Samples("run.csv", ur.joints, MOTIONS[motion](time)[0], time))
    assert not any("noisy" in note for note in notes)
    np.testing.assert_allclose(t.position, MOTIONS[motion](time)[0], atol=2e-4)


def test_slow_motion_between_two_readings_is_no_rest(ur: Robot) -> None:
    """At two digits, a reading of a joint at 0.03 rad/s lasts a third of a second."""
    time = np.arange(0, 12, 0.02)
    q = START + 0.03 * time[:, None] * np.ones(6)
    t, notes = motion_of(Samples("run.csv", ur.joints, np.round(q, 2), time))
    assert not any("at rest" in note for note in notes)
    middle = (t.time > 2) & (t.time < 10)
    np.testing.assert_allclose(t.velocity[middle], 0.03, atol=0.02)
