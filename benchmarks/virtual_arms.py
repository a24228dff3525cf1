"""Arms for virtual sets: electrical values and realistic sizes of every effect on each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt import effects as e
from energy_opt.effects import Effect
from energy_opt.virtual_arm.plant import Backlash, Cogging, Fan, Special, SpeedRipple, StandbyStep


@dataclass(frozen=True)
class ArmData:
    """What an arm's sets are drawn around.

    Attributes:
        standby: W.
        r_over_kt2: per joint, W/(N m)^2.
        friction: a usual dry friction per joint, N m.
        rotor: a usual reflected rotor inertia per joint, kg m^2.
        payload: a usual payload, kg.
        lifts: the joints (by index) that carry weight, where springs make sense.
    """

    standby: float
    r_over_kt2: tuple[float, ...]
    friction: tuple[float, ...]
    rotor: tuple[float, ...]
    payload: float
    lifts: tuple[int, ...]


ARMS: dict[str, ArmData] = {
    "panda": ArmData(
        88.04,
        (0.0034, 0.0036, 0.0042, 0.0040, 0.045, 0.050, 0.055),
        (0.55, 0.50, 0.45, 0.50, 0.30, 0.25, 0.20),
        (0.20, 0.20, 0.20, 0.20, 0.08, 0.08, 0.08),
        1.6,
        (1, 3),
    ),
    "ur5": ArmData(
        92.6,
        (0.0040, 0.0042, 0.0046, 0.040, 0.042, 0.045),
        (1.6, 1.8, 1.2, 0.50, 0.45, 0.40),
        (0.60, 0.60, 0.50, 0.08, 0.08, 0.08),
        2.1,
        (1, 2),
    ),
    "ur5e": ArmData(
        97.5,
        (0.0038, 0.0040, 0.0045, 0.042, 0.044, 0.046),
        (1.5, 1.7, 1.1, 0.50, 0.45, 0.40),
        (0.60, 0.60, 0.50, 0.08, 0.08, 0.08),
        2.0,
        (1, 2),
    ),
    "ur3e": ArmData(
        71.0,
        (0.012, 0.012, 0.030, 0.10, 0.10, 0.11),
        (0.9, 1.0, 0.6, 0.30, 0.28, 0.25),
        (0.25, 0.25, 0.15, 0.03, 0.03, 0.03),
        1.1,
        (1, 2),
    ),
    "xarm7": ArmData(
        61.5,
        (0.010, 0.011, 0.014, 0.014, 0.016, 0.050, 0.055),
        (0.9, 0.9, 0.6, 0.6, 0.5, 0.35, 0.30),
        (0.30, 0.30, 0.20, 0.20, 0.15, 0.06, 0.06),
        1.5,
        (1, 3),
    ),
    "z1": ArmData(
        34.8,
        (0.020, 0.020, 0.024, 0.040, 0.042, 0.045),
        (0.60, 0.80, 0.70, 0.40, 0.40, 0.35),
        (0.12, 0.16, 0.12, 0.05, 0.05, 0.05),
        1.1,
        (1, 2),
    ),
}

Draw = Callable[[np.random.Generator, ArmData], dict[str, Any]]


def _scaled(rng: np.random.Generator, base: tuple[float, ...], low: float, high: float) -> np.ndarray:
    """`base` times one common factor and a little of its own per joint."""
    return np.round(np.array(base) * rng.uniform(low, high) * rng.uniform(0.85, 1.15, len(base)), 4)


def _spring(rng: np.random.Generator, arm: ArmData) -> dict[str, Any]:
    stiffness, rest = np.zeros(len(arm.friction)), np.zeros(len(arm.friction))
    for j in arm.lifts:
        stiffness[j] = arm.payload * rng.uniform(4.0, 9.0)
        rest[j] = rng.uniform(-0.4, 0.4)
    return {"stiffness": stiffness, "rest": rest}


def _tilt(rng: np.random.Generator, arm: ArmData) -> dict[str, Any]:
    size, way = rng.uniform(0.05, 0.14), rng.uniform(0, 2 * np.pi)
    return {"roll": size * np.cos(way), "pitch": size * np.sin(way)}


SIZES: dict[type[Effect], Draw] = {
    e.CoulombFriction: lambda rng, arm: {"tau_c": _scaled(rng, arm.friction, 0.7, 1.6)},
    e.ViscousFriction: lambda rng, arm: {"b": _scaled(rng, arm.friction, 0.8, 1.8)},
    e.StribeckFriction: lambda rng, arm: {
        "tau_s": _scaled(rng, arm.friction, 2.0, 3.5),
        "v_s": rng.uniform(0.15, 0.35),
    },
    e.LoadFriction: lambda rng, arm: {"mu": _scaled(rng, (1.0,) * len(arm.friction), 0.05, 0.11)},
    e.Armature: lambda rng, arm: {"inertia": _scaled(rng, arm.rotor, 0.9, 1.8)},
    e.Payload: lambda rng, arm: {
        "mass": arm.payload * rng.uniform(0.5, 1.2),
        "com": [*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.03, 0.12)],
    },
    e.BaseTilt: _tilt,
    e.GravitySpring: _spring,
    e.Regeneration: lambda rng, arm: {
        "efficiency": rng.uniform(0.0, 0.5),
        "level": "joint" if rng.random() < 0.5 else "bus",
    },
    e.GearEfficiency: lambda rng, arm: {
        "eta": np.clip(_scaled(rng, (1.0,) * len(arm.friction), 0.84, 0.93), 0.75, 0.99)
    },
    e.InverterLoss: lambda rng, arm: {"c": rng.uniform(0.06, 0.16)},
    e.SupplyEfficiency: lambda rng, arm: {"eta": rng.uniform(0.84, 0.94)},
    e.MotionPower: lambda rng, arm: {"power": rng.uniform(2.5, 8.0)},
    e.WindingTemperature: lambda rng, arm: {"rate": rng.uniform(0.25, 0.5), "time_constant": rng.uniform(50.0, 120.0)},
    e.StandbyDrift: lambda rng, arm: {"power": rng.uniform(2.0, 6.0), "time_constant": rng.uniform(40.0, 120.0)},
    e.MeterDelay: lambda rng, arm: {"delay": rng.uniform(0.03, 0.12)},
    e.MeterFilter: lambda rng, arm: {"time_constant": rng.uniform(0.05, 0.2)},
    e.MeterGain: lambda rng, arm: {"gain": 1 + rng.choice([-1, 1]) * rng.uniform(0.03, 0.08)},
}


def draw_effect(kind: type[Effect], robot: str, rng: np.random.Generator) -> Effect:
    """The effect with values of a realistic size for that arm."""
    return kind(**SIZES[kind](rng, ARMS[robot]))


SPECIAL_SIZES: dict[str, Callable[[np.random.Generator, ArmData], Special]] = {
    "cogging": lambda rng, arm: Cogging(
        amplitude=_scaled(rng, arm.friction, 3.0, 6.0),
        periods=float(rng.integers(5, 12)),
        phase=float(rng.uniform(0, 6.2)),
    ),
    "speed_ripple": lambda rng, arm: SpeedRipple(
        amplitude=_scaled(rng, arm.friction, 3.0, 5.0), period=float(rng.uniform(0.25, 0.45))
    ),
    "backlash": lambda rng, arm: Backlash(
        amplitude=_scaled(rng, arm.friction, 8.0, 14.0), gap=float(rng.uniform(0.03, 0.08))
    ),
    "fan": lambda rng, arm: Fan(
        power=float(rng.uniform(3, 8)),
        period=float(rng.uniform(5, 14)),
        duty=float(rng.uniform(0.35, 0.6)),
        offset=float(rng.uniform(0, 14)),
    ),
    "standby_step": lambda rng, arm: StandbyStep(power=float(rng.uniform(3, 8)), time=float(rng.uniform(80, 160))),
}


def draw_special(name: str, robot: str, rng: np.random.Generator) -> Special:
    """The special with values of a clearly visible size for that arm."""
    return SPECIAL_SIZES[name](rng, ARMS[robot])
