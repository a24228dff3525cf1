"""Energy against duration for one move, and over a fixed cycle."""

from energy_opt.fronts.cycle import Cycle, Waiting
from energy_opt.fronts.front import Front, Point, trace

__all__ = ["Cycle", "Front", "Point", "Waiting", "trace"]
