"""The virtual arm: measured data with known causes, from a forward simulation independent of the library's laws.

`simulate` plays motions on an arm whose drives have a plant's effects.
MuJoCo (extra `sim`) is imported when an arm is built, not before.
"""

from energy_opt.virtual_arm.plant import (
    SPECIALS,
    Backlash,
    Cogging,
    Fan,
    Plant,
    Special,
    SpeedRipple,
    StandbyStep,
    load_plant,
)
from energy_opt.virtual_arm.simulate import Instruments, Reference, Run, play, pose, reference_of, simulate

__all__ = [
    "SPECIALS", "Backlash", "Cogging", "Fan", "Instruments", "Plant", "Reference", "Run", "Special", "SpeedRipple",
    "StandbyStep", "load_plant", "play", "pose", "reference_of", "simulate",
]  # fmt: skip
