"""Sharing a cycle's time anew, by the energies of its reshaped legs.

`allocate` shares the time by the energies of first paths. Those of reshaped motions have other slopes: on ten random
cycles of two robots, shares by these take 12 % less loss (`benchmarks/job.py --random 5`).

Near a duration, the energy of a leg is E(T) = c + h T + k / (3 T^3): it moves against its losses, which fall with the
third power of T, and takes h W besides. h and k follow from the energies at two or three durations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.jobs.allocate import Front, Shares, modelled
from energy_opt.jobs.cycle import Plan, energy_of
from energy_opt.jobs.work import Worker
from energy_opt.motion.plan.candidates import NEAR_FASTEST
from energy_opt.motion.timing.spline_timing import Timing

BEFORE = 0.5  # approximate share of a job's work before this
PROBE = 1.08  # factor of the durations at which each leg is solved a second time
TRUST = 1.3  # largest change of a duration in one round, as a factor
ROUNDS = 3  # most rounds
UNHURRIED = 1.001 * NEAR_FASTEST  # times the shortest duration: below, a search takes several times as long
APART = 1.01  # least ratio of two durations from which a slope is computed
WORTH = 2e-3  # share of the losses: shares that promise less are not solved


def reshared(
    work: Worker, plan: Plan, timings: Sequence[Timing], fronts: Sequence[Front], shares: Shares,
    plan_of: Callable[[np.ndarray, float, float], Plan],
) -> Plan:  # fmt: skip
    """The plan with shares of the time by which its reshaped legs take the least energy.

    Args:
        plan: with the shares of the first paths. timings, fronts: of the first paths, by leg.
        shares: as `allocate` found them.
        plan_of: solves every leg in these durations (L,) [s], from one share of all work to another.
    """
    job, answers = work.job, plan.answers
    # as first guess, losses depend on time as those of the first path do
    overhead = np.array([a.energy.total - a.energy.loss for a in answers])  # standby and what depends on the ends
    standby = np.array([a.energy.standby / a.trajectory.duration for a in answers])
    losses = np.array([a.energy.loss for a in answers])
    ratio = np.clip(losses / np.maximum(shares.energies - overhead, 1e-12), 0.05, 1.0)
    saved, holding = ratio * shares.saved, standby + ratio * (shares.holding - standby)
    points: list[dict[float, float]] = [{} for _ in answers]
    trust = TRUST
    for done in range(ROUNDS):
        durations = np.array([answer.trajectory.duration for answer in plan.answers])
        for known, answer in zip(points, plan.answers, strict=True):
            known[answer.trajectory.duration] = answer.energy.total
        for k, leg in enumerate(plan.legs):
            if leg.mode == "reshape" and leg.moves and len(points[k]) == 1 and not work.stopped():
                longer = PROBE * durations[k] <= fronts[k].longest
                with suppress(Infeasible):
                    probe = work.solved(leg, timings[k], float(durations[k] * (PROBE if longer else 1 / PROBE)))
                    points[k] |= {probe.trajectory.duration: probe.energy.total} if probe.status == "solved" else {}
            saved[k], holding[k] = _fitted(points[k], durations[k], saved[k], holding[k])
        near = [
            replace(
                front,
                shortest=max(min(UNHURRIED * front.shortest, d), d / trust),
                longest=min(front.longest, d * trust),
            )
            for front, d in zip(fronts, durations.tolist(), strict=True)
        ]
        wanted = modelled(near, saved, holding, job.cycle_time - job.waiting, plan.rest.power)
        change = (holding - plan.rest.power) * (wanted - durations) + saved / 3 * (wanted**-3 - durations**-3)
        if work.stopped() or -change.sum() < WORTH * losses.sum():
            break
        found = plan_of(wanted, *(BEFORE + (1 - BEFORE) * k / ROUNDS for k in (done, done + 1)))
        if energy_of(job, work.scorers, found) < energy_of(job, work.scorers, plan):
            plan = found
            continue
        trust **= 0.5
        for known, answer in zip(points, found.answers, strict=True):
            known[answer.trajectory.duration] = answer.energy.total
    return plan


def _fitted(known: Mapping[float, float], duration: float, saved: float, holding: float) -> tuple[float, float]:
    """k [J s^3] and h [W] of a leg near a duration [s].

    Args:
        known: energies [J] by duration [s], that of `duration` among them.
        saved, holding: k where it does not follow from three durations, h where there is only one.
    """
    below = [d for d in sorted(known) if d < duration / APART][-2:]
    above = [d for d in sorted(known) if d > duration * APART][:2]
    at = np.array([*(below[-1:] if above else below), duration, *(above[:1] if below else above)])
    if len(at) == 1:
        return saved, holding
    slope = np.diff([known[d] for d in at.tolist()]) / np.diff(at)  # between neighbours: h + k bend
    bend = np.diff(at**-3.0) / 3 / np.diff(at)
    if len(at) > 2 and (k := float(np.diff(slope)[0] / np.diff(bend)[0])) > 0:
        saved = k
    return saved, float(np.mean(slope - saved * bend))
