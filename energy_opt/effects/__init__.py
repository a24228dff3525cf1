"""The physical effects that a power model can hold, by their names in model files."""

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.changing_friction import DailyFriction, TemperatureFriction, ThermalViscous
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
    FrictionCurve,
    GearEfficiency,
    LoadFriction,
    PowerLawFriction,
    SigmoidFriction,
    StribeckFriction,
    ViscousFriction,
)
from energy_opt.effects.mechanics import Armature, BaseTilt, GravitySpring, LinkInertia, Payload, PayloadChange
from energy_opt.effects.meter import MeterDelay, MeterEffect, MeterFilter, MeterGain, MeterWindow
from energy_opt.effects.parameter import COBOT, EXACT, ArmSize, Kinks, Parameter, Smooth
from energy_opt.effects.recorded import DcLink, IdleHold, RunOffset, SignalPower, WindingSelfHeating
from energy_opt.effects.registry import (
    ALL_EFFECTS,
    BY_NAME,
    effect_class,
    known_effects,
    load_file,
    load_source,
    loaded_sources,
    of_form,
    register,
    registered,
    unregister,
    words_of,
)
from energy_opt.effects.stages import (
    DriveEffect,
    HeatEffect,
    HeatMemoryEffect,
    PowerEffect,
    RigidEffect,
    StoreEffect,
    SupplyEffect,
    TorqueEffect,
    WindingEffect,
)

__all__ = [
    "ALL_EFFECTS", "BY_NAME", "COBOT", "EXACT", "ArmSize", "Armature", "AsymmetricFriction", "BaseTilt",
    "CopperLoss", "CoulombFriction", "DailyFriction", "DcLink", "DriveEffect", "Effect", "FrictionCurve",
    "GearEfficiency", "GravitySpring", "HeatEffect", "HeatMemoryEffect", "IdleHold", "InverterLoss", "IronLoss",
    "Kinks", "LinkInertia", "LoadFriction", "MeterDelay", "MeterEffect", "MeterFilter", "MeterGain", "MeterWindow",
    "MotionPower", "Parameter", "Payload", "PayloadChange", "PowerEffect", "PowerLawFriction", "PsuLoss",
    "Regeneration", "RigidEffect", "RunOffset", "SigmoidFriction", "SignalPower", "Signals", "Smooth", "Standby",
    "StandbyDrift", "StoreEffect", "StribeckFriction", "SupplyEffect", "SupplyEfficiency", "TemperatureFriction",
    "ThermalViscous", "TorqueEffect", "ViscousFriction", "WindingEffect", "WindingSelfHeating",
    "WindingTemperature", "effect_class", "known_effects", "load_file", "load_source", "loaded_sources", "of_form",
    "register", "registered", "unregister", "words_of",
]  # fmt: skip
