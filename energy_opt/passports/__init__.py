"""An arm's electrical passport: standby, copper loss and friction with intervals and sources."""

from energy_opt.passports.changes import Change, changes, changes_since
from energy_opt.passports.sheet import Passport, passport
from energy_opt.passports.sources import Arm, Number, arm_of, friction, loss, read_arm

__all__ = [
    "Arm", "Change", "Number", "Passport", "arm_of", "changes", "changes_since", "friction", "loss", "passport",
    "read_arm",
]  # fmt: skip
