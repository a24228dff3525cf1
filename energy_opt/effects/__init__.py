"""The physical effects that a power model can hold, by their names in model files."""

from energy_opt.effects.base import EXACT, Effect, Exact, Kinks, Parameter, PowerEffect, Signals, Smooth, TorqueEffect
from energy_opt.effects.electrics import (
    CopperLoss,
    InverterLoss,
    MotionPower,
    Regeneration,
    Standby,
    StandbyDrift,
    SupplyEfficiency,
    WindingTemperature,
)
from energy_opt.effects.friction import (
    CoulombFriction,
    GearEfficiency,
    LoadFriction,
    StribeckFriction,
    ViscousFriction,
)
from energy_opt.effects.mechanics import Armature, GravitySpring
from energy_opt.effects.meter import MeterDelay, MeterFilter, MeterGain
from energy_opt.effects.rigid import BaseTilt, Payload

ALL_EFFECTS: tuple[type[Effect], ...] = (
    Standby,
    CopperLoss,
    CoulombFriction,
    ViscousFriction,
    StribeckFriction,
    LoadFriction,
    Armature,
    Payload,
    BaseTilt,
    GravitySpring,
    Regeneration,
    GearEfficiency,
    InverterLoss,
    SupplyEfficiency,
    MotionPower,
    WindingTemperature,
    StandbyDrift,
    MeterDelay,
    MeterFilter,
    MeterGain,
)
BY_NAME: dict[str, type[Effect]] = {effect.name: effect for effect in ALL_EFFECTS}

__all__ = [
    "ALL_EFFECTS",
    "BY_NAME",
    "EXACT",
    "Armature",
    "BaseTilt",
    "CopperLoss",
    "CoulombFriction",
    "Effect",
    "Exact",
    "GearEfficiency",
    "GravitySpring",
    "InverterLoss",
    "Kinks",
    "LoadFriction",
    "MeterDelay",
    "MeterFilter",
    "MeterGain",
    "MotionPower",
    "Parameter",
    "Payload",
    "PowerEffect",
    "Regeneration",
    "Signals",
    "Smooth",
    "Standby",
    "StandbyDrift",
    "StribeckFriction",
    "SupplyEfficiency",
    "TorqueEffect",
    "ViscousFriction",
    "WindingTemperature",
]
