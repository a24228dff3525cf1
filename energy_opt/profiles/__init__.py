"""Standard moves, for controllers that accept only joint moves with a speed and an acceleration."""

from energy_opt.profiles.answer import robust_moves, standard_moves
from energy_opt.profiles.chain import Chain
from energy_opt.profiles.plan import MovesPlanner, StandardMoves, as_result

__all__ = [
    "Chain", "MovesPlanner", "StandardMoves", "as_result", "robust_moves", "standard_moves",
]  # fmt: skip
