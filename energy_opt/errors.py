"""Errors that a caller can act on; each class knows the command line's exit code."""

from __future__ import annotations


class EnergyOptError(Exception):
    """Root of every error that the package raises on purpose: one clear line, no traceback needed."""

    exit_code = 1


class BadInput(EnergyOptError):
    """An argument, a file or a value is not usable: what, where, and what would be right."""

    exit_code = 2


class Infeasible(EnergyOptError):
    """No trajectory satisfies the limits.

    Attributes:
        joint: the joint whose limit cannot be held, or None where no single joint is to blame.
        limit: "position", "velocity", "acceleration", "jerk", "effort" or "duration".
        time: where along the move, s (None where no timing exists yet).
        position: path position in [0, 1] (None where it has no meaning).
        excess: by how much, as a fraction of the bound.
        shortest_duration: the shortest duration that would work, s, where one is known.
    """

    exit_code = 3

    def __init__(
        self,
        message: str,
        *,
        joint: str | None = None,
        limit: str | None = None,
        time: float | None = None,
        position: float | None = None,
        excess: float | None = None,
        shortest_duration: float | None = None,
    ) -> None:
        super().__init__(message)
        self.joint = joint
        self.limit = limit
        self.time = time
        self.position = position
        self.excess = excess
        self.shortest_duration = shortest_duration
