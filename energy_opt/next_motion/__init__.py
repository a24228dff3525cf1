"""The motion to record next, where rival models meet the optimizer: within limits, and they differ most on it."""

from energy_opt.next_motion.rivals import Rival, rivals_of
from energy_opt.next_motion.search import NextMotion, propose

__all__ = ["NextMotion", "Rival", "propose", "rivals_of"]
