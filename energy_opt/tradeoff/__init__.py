"""Energy against duration for one move, and over a fixed cycle."""

from energy_opt.tradeoff.cycle import Cycle, Waiting
from energy_opt.tradeoff.front import Front, Point, trace

__all__ = ["Cycle", "Front", "Point", "Waiting", "trace"]
