"""Plans that leave room for the samples that a controller gets, which use the limits a little more than the plan does.

The rate is known before the plan is written. Where the samples break a limit, the move is planned again with a bound
that is smaller by what was broken. A move of a given duration keeps its duration so. What is written is slowed only
where no such plan is found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from energy_opt.errors import Infeasible
from energy_opt.formats import Format
from energy_opt.formats.judging import Judging
from energy_opt.formats.output import STEPS, sample
from energy_opt.motion.judge.certificate import ALLOWED, Certificate
from energy_opt.motion.trajectory import Trajectory

ROUNDS = 6  # plans with smaller bounds
STEP = 1.2  # times what is broken, by which a bound becomes smaller: peaks move with the plan
SHOWN = 0.9995  # of a bound: shares above it are all of it in words
NEAR = 1e-2  # of a bound: what samples may break at most of a plan that is then slowed
LEAST = 0.5  # of a bound: where samples need less than that, the rate is too low for the motion

Shares = dict[str, float]  # of the limits' bounds, by the limits' names
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Files:
    """What is going to be written: formats, and samples per second (None: the judged samples)."""

    formats: Sequence[Format] = ()
    rate: float | None = None

    def certificates(self, trajectory: Trajectory, judge: Judging) -> list[Certificate]:
        """Of what every format gets, before anything is slowed; none where all files hold the judged samples."""
        known: dict[tuple[float, bool], Certificate] = {}
        for form in self.formats:
            got, pace = sample(trajectory, judge, form, self.rate)
            stepped = pace == STEPS.get(form.name)
            if pace is not None and (pace, stepped) not in known:
                known[pace, stepped] = judge.at_steps(got, pace) if stepped else judge(got)
        return list(known.values())


def with_room(
    answer: Answer, certificates: Callable[[Answer], list[Certificate]], again: Callable[[Shares], Answer]
) -> tuple[Answer, Shares]:
    """The answer, or one that is planned again so that the samples of its motion stay within all limits.

    Args:
        certificates: of the samples of an answer.
        again: plans with these shares of the limits' bounds; raises Infeasible where that is not possible.

    Returns:
        The answer whose samples break limits least, and the shares that it was planned with: none for the given one.
    """
    shares: Shares = {}
    found = certificates(answer)
    given, best, least = answer, (answer, dict(shares)), _broken(found)
    for _ in range(ROUNDS):
        if not ALLOWED < least < float("inf") or not all(certificate.clear for certificate in found):
            break
        for place in (place for certificate in found for place in certificate.found):
            if place.excess is not None and place.excess > 0.1 * ALLOWED:
                shares[place.limit] = shares.get(place.limit, 1.0) / (1 + STEP * place.excess + 2 * ALLOWED)
        if min(shares.values()) < LEAST:
            break
        try:
            answer = again(dict(shares))
        except Infeasible:
            break
        found = certificates(answer)
        if _broken(found) < least:
            best, least = (answer, dict(shares)), _broken(found)
    return best if least < NEAR else (given, {})


def said(shares: Mapping[str, float], joules: float) -> str:
    """What room was left and what it costs, in words; empty where none was."""
    if not shares:
        return ""
    less = {name: share for name, share in shares.items() if share < SHOWN} or shares
    used = ", ".join(f"{name.replace('_', ' ')} at most {100 * share:.4g} %" for name, share in less.items())
    return f"planned with room for the samples that are written ({used} of its bound): {joules:+.3g} J"


def _broken(certificates: Sequence[Certificate]) -> float:
    return max((certificate.violation for certificate in certificates), default=0.0)
