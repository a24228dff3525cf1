"""The residual of a hypothesis: the signals that it correlates with; levels of power and slow noise at rest.

If no known effect explains the rest, the signals that it follows show the user where to look. A signal counts as far as
a free function of it predicts the residual in parts of runs to which the function was not fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.diagnosis.data.predict import Prediction, predict
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.data.standing import standing_noise
from energy_opt.diagnosis.evidence.errors import reading_of
from energy_opt.diagnosis.evidence.odds import STEADY
from energy_opt.diagnosis.fit.candidates import functions
from energy_opt.diagnosis.fit.posterior import Fit, Free
from energy_opt.effects import LinkInertia
from energy_opt.power import PowerModel

LEVELS = 0.03  # share of the arm's level by which the levels of runs may differ, as meters drift
WEAKEST = 0.05  # least share of the residual that a named signal explains
ALONE = 0.1  # largest share of the spread of the runs' levels that one step leaves
MOSTLY = 0.5  # least share of a step that readings at rest show
MOST = 8


@dataclass(frozen=True)
class Attribution:
    """A signal that a part of the residual follows.

    Attributes:
        signal: its name. joint: name, or None. strength: share of the residual. watts: rms of this part [W].
        at, change: of a level of power that changes once: when [s], and by how much [W].
    """

    signal: str
    joint: str | None
    strength: float
    watts: float
    at: float | None = None
    change: float | None = None

    def document(self) -> dict[str, Any]:
        """As in diagnosis.json, without the strength."""
        step = {} if self.change is None else {"at": self.at, "change": self.change}
        return {"signal": self.signal, "joint": self.joint, "watts": self.watts, **step}


def goes_with(
    f: Fit, free: Sequence[Free], joints: Sequence[str], model: PowerModel, samples: Samples
) -> list[Attribution]:
    """Signals that the residual of a fit follows: those of accepted functions first, then that with the most watts.

    A level that changes once comes first if it has the most watts. The strength of a signal is the share that a
    function of it predicts in parts of runs that it was not fitted to; or, for functions in `free`, which the search
    has accepted, the share that it removes where it is fitted.

    Args:
        f: the fit. free: accepted free functions. joints: names.
        model: the one that is written. What the links of the fit explain is left where it lacks them.
        samples: of the whole set.
    """
    own, rest = f.world.samples, f.residual
    if model.get(LinkInertia.name) is None:
        rest = rest + f.prediction.reading - predict(f.model, own).reading
    rest = rest * own.weight
    open_part = max(float(rest @ rest) - len(rest) * f.world.whiten.noise.white**2, 1e-9)
    chosen = {g.signal for g in free}

    def part(g: Free, columns: np.ndarray, joint: int | None, accepted: bool) -> Attribution:
        gained = _removed(f, rest, columns, g.size, accepted)
        watts = float(np.sqrt(gained / (own.weight @ own.weight)))
        return Attribution(g.signal, None if joint is None else joints[joint], min(gained / open_part, 1.0), watts)

    records = []
    for g in functions(f):
        for joint, columns in _by_joint(g, own.n):
            whole = joint is None or columns.shape[1] == g.columns.shape[1]
            records.append(part(g, columns, joint, g.signal in chosen and whole))
    records = [row for row in records if row.strength > WEAKEST]
    known = {row.signal for row in records}
    # the whole function, where no joint's part of it alone counts
    records += [part(g, g.columns, None, True) for g in free if g.signal not in known]
    if wandering(f):
        apart = Attribution("time (run to run)", None, 1.0, float(np.std(f.levels)))
        records.append(step_of(model, samples) or apart)
    best = {(row.signal, row.joint): row for row in sorted(records, key=lambda row: row.strength)}
    most = max((row.watts for row in records), default=0.0)

    def place(row: Attribution) -> tuple[bool, float]:
        leads = row.signal in chosen or (row.change is not None and row.watts == most)
        return not leads, -row.watts

    return sorted(best.values(), key=place)[:MOST]


def step_of(model: PowerModel, samples: Samples) -> Attribution | None:
    """A step of the level of power, where it alone is why the runs' levels differ; a drift leaves a quarter of that.

    A power that depends on the motion changes where static recordings follow motions. So readings at rest must show
    most of the step, or those in motion where the arm never rests before it, or never after.
    """
    order = np.argsort(samples.at, kind="stable")
    off, at = samples.power - predict(model, samples).reading, samples.at[order]
    k, before, after = _largest_step(off[order], np.arange(1, len(off)))
    earlier = samples.at < at[k]
    level = np.where(earlier, before, after)
    spread, left = (np.var([np.mean(x[p]) for p in samples.parts]) for x in (off, off - level))
    alike = next((x for x in (~samples.moving, samples.moving) if 0 < np.sum(x & earlier) < np.sum(x)), None)
    if left > ALONE * spread or alike is None:
        return None
    if (np.mean(off[alike & ~earlier]) - np.mean(off[alike & earlier])) / (after - before) < MOSTLY:
        return None
    watts = float(np.sqrt(np.mean(level**2)))
    strength = min(float(watts**2 / np.mean(off**2)), 1.0)
    when = float(at[k - 1] + at[k]) / 2
    return Attribution("time (one step)", None, strength, watts, when, after - before)


def _largest_step(power: np.ndarray, inner: np.ndarray) -> tuple[int, float, float]:
    """Where the mean of power (N,) changes most, of the places `inner`, and its means before and after."""
    before, count = np.cumsum(power)[inner - 1], inner.astype(float)
    left, right = before / count, (power.sum() - before) / (len(power) - count)
    k = int(np.argmax(count * (len(power) - count) * (left - right) ** 2))
    return int(inner[k]), float(left[k]), float(right[k])


def wandering(f: Fit) -> bool:
    """True if the levels of the runs differ by more than the drift of a meter."""
    apart = float(np.ptp(f.levels))
    return apart > LEVELS * (f.world.scale.level + STEADY) and apart > 6 * float(np.median(f.level_deviations))


def _by_joint(g: Free, n: int) -> list[tuple[int | None, np.ndarray]]:
    """Columns of a function split by joint, or (None, all columns) if the signal does not belong to single joints."""
    if g.signal.startswith("time") or g.columns.shape[1] % n or g.signal in ("power", "temperature"):
        return [(None, g.columns)]
    count = g.columns.shape[1] // n
    return [(j, g.columns[:, j * count : (j + 1) * count]) for j in range(n)]


def _removed(f: Fit, rest: np.ndarray, columns: np.ndarray, size: float, accepted: bool) -> float:
    """Squares [W^2] that a free function removes in quarters of every run that it was not fitted to.

    Of a function that the search has `accepted`: those that it removes where it is fitted.
    """
    samples = f.world.samples
    columns = columns * samples.weight[:, None]
    half = np.concatenate([(np.arange(p.stop - p.start) * 4 // max(p.stop - p.start, 1)) % 2 for p in samples.parts])
    before = (f.world.whiten.noise.white / size) ** 2 * np.eye(columns.shape[1])
    everywhere, gained = np.ones(len(half), dtype=bool), 0.0
    for fitted, judged in [(everywhere, everywhere)] if accepted else [(half == 0, half != 0), (half != 0, half == 0)]:
        own = columns[fitted]
        weights = np.linalg.solve(own.T @ own + before, own.T @ rest[fitted])
        gained += float(np.sum(rest[judged] ** 2) - np.sum((rest[judged] - columns[judged] @ weights) ** 2))
    return max(gained, 0.0)


LAGS = (-0.2, 0.0, 0.2, 0.5)  # [s] lags of the meter that are tried
SHIFTS = 199
CHANCE = 0.2  # largest p-value at which the power counts as following the motion
ROUGH_CHANCE = 0.01  # the same if neighbouring readings hardly correlate, as in noise
ALIKE = 0.5  # least correlation of neighbouring samples of an arm's power
FEW = 3.0  # least readings per column; with fewer, the columns fit anything
PREFIX = 1000.0  # factor between watts and kilowatts, or milliwatts and watts
SHOWN = 0.5  # share of the meter's noise below which variations of mechanical power are not visible


def other_unit(samples: Samples, now: Prediction) -> tuple[str, float] | None:
    """The unit that the power seems to be in, and its ratio to the model's; None where watts are plausible.

    Args:
        samples: of the set. now: the declared model at the samples.
    """
    ratio = float(np.median(samples.power) / max(float(np.median(now.reading)), 1e-9))
    for unit, factor in (("kW", 1 / PREFIX), ("mW", PREFIX)):
        if ratio > 0 and abs(np.log(ratio / factor)) < np.log(PREFIX) / 4:
            return unit, ratio
    return None


def follows(samples: Samples, now: Prediction) -> bool:
    """False if the power follows the motion no better than by chance.

    The power must correlate with the mechanical power, torques or reading of a model, or with the speed, which friction
    follows.

    Args:
        samples: of the set. now: the declared model at the samples.
    """
    mechanical = np.einsum("nj,nj->n", now.tau, samples.v)
    speed = np.abs(samples.v)
    heat, lost, dragged = np.sum(now.tau**2, axis=1), speed.sum(axis=1), np.sum(speed**2, axis=1)
    columns = _centred(samples.shown(np.column_stack([mechanical, heat, now.power, lost, dragged])), samples)
    if np.std(columns[:, 0]) < SHOWN * samples.noise:
        return True
    lags = [lag for lag in LAGS if lag == 0 or abs(lag) > samples.step / 2]
    lagged = np.column_stack([_shifted(columns, samples, lag) for lag in lags])
    if len(lagged) - len(samples.parts) < FEW * lagged.shape[1]:
        return True
    u, s, _ = np.linalg.svd(lagged / np.maximum(np.linalg.norm(lagged, axis=0), 1e-12), full_matrices=False)
    u = u[:, s > 1e-6 * s[0]]
    power = _centred(samples.power[:, None], samples)[:, 0]
    seen = float(np.sum((u.T @ power) ** 2))
    rng, by_chance = np.random.default_rng(0), 0
    for _ in range(SHIFTS):
        turned = np.concatenate([np.roll(power[s], rng.integers(1, max(s.stop - s.start, 2))) for s in samples.parts])
        by_chance += float(np.sum((u.T @ turned) ** 2)) >= seen
    together = sum(float(power[s][1:] @ power[s][:-1]) for s in samples.parts)
    rough = together < ALIKE * float(power @ power)
    return (1 + by_chance) / (SHIFTS + 1) <= (ROUGH_CHANCE if rough else CHANCE)


def _centred(x: np.ndarray, samples: Samples) -> np.ndarray:
    """Columns (N, c) less their mean in each run."""
    return np.concatenate([x[s] - x[s].mean(axis=0) for s in samples.parts])


def _shifted(x: np.ndarray, samples: Samples, lag: float) -> np.ndarray:
    """Columns (N, c) delayed by `lag` seconds, the ends of each run held."""
    out = np.empty_like(x)
    for s in samples.parts:
        t = samples.at[s]
        for k in range(x.shape[1]):
            out[s, k] = np.interp(t - lag, t, x[s, k])
    return out


LEAST = 1.0  # [s] shortest duration of a level
# levels differ by more than this [W], this share of the power, and this multiple of the noise
APART, SHARE, NOISES = 3.0, 0.05, 6.0


@dataclass(frozen=True)
class Mode:
    """A level of power at rest: mean [W] without the power of holding the pose, duration [s], number of standstills."""

    power: float
    seconds: float
    standstills: int


def modes_of(model: PowerModel, samples: Samples) -> list[Mode]:
    """Levels of power in a set's standstills, highest first.

    The model's power of each pose is subtracted first, so that holding a weight is no level of its own. A standstill is
    split where the mean changes most, recursively, while both parts are long enough and differ.
    """
    standby = model.get("standby")
    level = float(standby.values["power"][0]) if standby is not None else 0.0
    apart = max(APART, SHARE * level, NOISES * samples.floor)
    found: list[tuple[float, float, int]] = []  # level [W], duration [s], index of the standstill
    count = 0
    for span, (time, power), own in zip(samples.slices, samples.single, reading_of(model, samples), strict=True):
        live = (samples.v[span] != 0).any(axis=1).astype(float)
        still = np.concatenate([[False], np.interp(time, samples.t[span], live) == 0, [False]])
        edges = np.flatnonzero(np.diff(still.astype(int)))
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            rest = level + power[a:b] - own[a:b]
            found += [(x, seconds, count) for x, seconds in _plateaus(time[a:b], rest, apart)]
            count += 1
    out: list[list[tuple[float, float, int]]] = []
    for plateau in sorted(found, reverse=True):
        if not out or out[-1][-1][0] - plateau[0] >= apart:
            out.append([])
        out[-1].append(plateau)
    columns = [tuple(zip(*group, strict=True)) for group in out]
    return [Mode(float(np.average(x, weights=s)), float(sum(s)), len({*k})) for x, s, k in columns]


def _plateaus(time: np.ndarray, power: np.ndarray, apart: float) -> list[tuple[float, float]]:
    """Mean [W] and duration [s] of the levels of one standstill."""
    lasts = float(time[-1] - time[0]) if len(time) else 0.0
    if lasts < LEAST:
        return []
    inner = np.flatnonzero((time - time[0] >= LEAST) & (time[-1] - time >= LEAST))
    if inner.size:
        cut, left, right = _largest_step(power, inner)
        if abs(left - right) > apart:
            return _plateaus(time[:cut], power[:cut], apart) + _plateaus(time[cut:], power[cut:], apart)
    return [(float(np.median(power)), lasts)]


def mode_words(modes: list[Mode]) -> list[str]:
    """A remark if there are several levels."""
    if len(modes) < 2:
        return []
    each = ", ".join(f"{m.power:.4g} W ({m.seconds:.3g} s in {m.standstills} standstills)" for m in modes)
    return [f"Power at rest has {len(modes)} levels (for example motors on, brakes on, drives off): {each}."]


WAVY = 1.5  # times the noise of the readings that are fitted from which slow noise is mentioned


def wave_words(samples: Samples) -> list[str]:
    """A remark on slow noise if all plausible noises of the readings at rest have it.

    In motion, the error of a model looks like slow noise.
    """
    plausible = [noise for _, noise in standing_noise(samples)[0]]
    if min(noise.wave / noise.white for noise in plausible) < WAVY:
        return []
    return [
        f"Beside the noise of a single reading ({samples.floor:.2g} W), the power at rest wanders by "
        f"{plausible[0].wave:.2g} W in about {plausible[0].memory:.2g} s. A load that switches, such as a fan, looks "
        "like this; it counts as noise."
    ]
