"""The motion to record next: within limits, and such that rival models differ most on it."""

from energy_opt.next_motion.rivals import Rival, rivals_of
from energy_opt.next_motion.search import NextMotion, propose

__all__ = ["NextMotion", "Rival", "propose", "rivals_of"]
