"""The physical effects that a power model can hold, by their names in model files."""

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.curve import FrictionCurve
from energy_opt.effects.electrics import (
    CopperLoss,
    InverterLoss,
    IronLoss,
    MotionPower,
    PsuLoss,
    Regeneration,
    Standby,
    StandbyDrift,
    SupplyEfficiency,
    WindingTemperature,
)
from energy_opt.effects.friction import (
    AsymmetricFriction,
    CoulombFriction,
    GearEfficiency,
    LoadFriction,
    PowerLawFriction,
    StribeckFriction,
    ThermalViscous,
    ViscousFriction,
)
from energy_opt.effects.kinks import EXACT, Exact, Kinks, Smooth
from energy_opt.effects.links import LinkInertia
from energy_opt.effects.mechanics import Armature, GravitySpring
from energy_opt.effects.meter import MeterDelay, MeterEffect, MeterFilter, MeterGain
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.past import DcLink, IdleHold, RunOffset
from energy_opt.effects.registry import (
    ALL_EFFECTS,
    BY_NAME,
    effect_class,
    known_effects,
    load_file,
    loaded_files,
    of_form,
    register,
    words_of,
)
from energy_opt.effects.rigid import BaseTilt, Payload
from energy_opt.effects.stages import (
    DriveEffect,
    HeatEffect,
    PowerEffect,
    RigidEffect,
    StoreEffect,
    SupplyEffect,
    TorqueEffect,
    WindingEffect,
)

__all__ = [
    "ALL_EFFECTS",
    "BY_NAME",
    "EXACT",
    "Armature",
    "AsymmetricFriction",
    "BaseTilt",
    "CopperLoss",
    "CoulombFriction",
    "DcLink",
    "DriveEffect",
    "Effect",
    "Exact",
    "FrictionCurve",
    "GearEfficiency",
    "GravitySpring",
    "HeatEffect",
    "IdleHold",
    "InverterLoss",
    "IronLoss",
    "Kinks",
    "LinkInertia",
    "LoadFriction",
    "MeterDelay",
    "MeterEffect",
    "MeterFilter",
    "MeterGain",
    "MotionPower",
    "Parameter",
    "Payload",
    "PowerEffect",
    "PowerLawFriction",
    "PsuLoss",
    "Regeneration",
    "RigidEffect",
    "RunOffset",
    "Signals",
    "Smooth",
    "Standby",
    "StandbyDrift",
    "StoreEffect",
    "StribeckFriction",
    "SupplyEffect",
    "SupplyEfficiency",
    "ThermalViscous",
    "TorqueEffect",
    "ViscousFriction",
    "WindingEffect",
    "WindingTemperature",
    "effect_class",
    "known_effects",
    "load_file",
    "loaded_files",
    "of_form",
    "register",
    "words_of",
]
