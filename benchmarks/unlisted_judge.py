"""What is wrong with a diagnosis: judged from the files it wrote and from what is true of the world.

Nothing here asks the diagnosis how it came to its words: `diagnosis.json` is read against `model.toml`, `report.html`
and the world's own numbers.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from misfit_drives import TURNS
from misfit_motions import STEP
from misfit_world import Motion, Truth

from energy_opt.effects import Kinks, effect_class
from energy_opt.power import PowerModel, drive_function, load_model
from energy_opt.power.drive_law import returned_power, rigid_torque, store_of
from energy_opt.power.motions import idle_time
from energy_opt.robot import Limits, Robot

NEAR = 0.1  # of the held-out error, by which ours may differ: derivatives are estimated from positions there, true here
PAIRS = 8
RECORDED = {"temperature", "logged", "dwell", "heated", "day"}


class Turning(Kinks):
    """Friction that turns about as it does in the worlds, which is part of no law."""

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        """tanh(x / TURNS): effects take the sign of speeds alone."""
        return ca.tanh(x / TURNS)


def foreseen(model: PowerModel, robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray, t: np.ndarray) -> np.ndarray:
    """What a model says of the power (N,) W along true motion; without what the meter makes of it.

    Friction does not hold joints at rest, neither here nor in the worlds: a controller holds them by torque.
    """
    function, _ = drive_function(model, robot.n, Turning(), past=True)
    tau, idle, values = rigid_torque(model, robot.body, q, v, a), idle_time(t, v), model.values(robot.n)

    def law(back: np.ndarray) -> list[np.ndarray]:
        out = function(q.T, v.T, a.T, tau.T, t[None], idle[None], back[None], values)
        return [np.array(x).ravel() for x in (out[1], out[3])]

    power, bus = law(np.zeros(len(t)))
    if store_of(model) is not None:
        power, _ = law(returned_power(model, np.gradient(t), bus)[0])
    return power


def held_out(truth: Truth, model: PowerModel, files: list[str]) -> tuple[float, float]:
    """RMS error of a model on some files, and of the truth itself: the best possible one; W."""
    left = [truth.measured[f] - foreseen(model, truth.robot, *truth.at_rows[f]) for f in files]
    return _rms(np.concatenate(left)), _rms(np.concatenate([truth.noise[f] for f in files]))


def energy_error(truth: Truth, model: PowerModel, files: list[str]) -> float:
    """Mean error of the energies of some files, as a share of the measured ones."""
    out = []
    for f in files:
        *_, t = motion = truth.at_rows[f]
        ours, measured = (np.trapezoid(x, t) for x in (foreseen(model, truth.robot, *motion), truth.measured[f]))
        out.append(abs(ours / measured - 1))
    return float(np.mean(out))


def beyond_motion(names: Iterable[str]) -> bool:
    """Do effects need more than a motion: what the meter makes of it, or what else was recorded?"""
    kinds = [effect_class(name) for name in names]
    return any(kind.stage == "meter" or RECORDED & set(kind.follows) for kind in kinds)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def difference_error(truth: Truth, model: PowerModel, seed: int) -> float:
    """How wrong a model is about differences of energy, as a share of the true ones (RMS over pairs).

    A pair has the same ends and the same time: once evenly through the whole time, once fast and then waiting, or
    evenly by another way. Elsewhere in the workspace than the set. Both are alternatives for the same hour: what a
    pump or a gripper takes then, whatever the arm does, is no difference between them.
    """
    rng = np.random.default_rng([seed, 11])
    robot, pairs = truth.robot, []
    low, high = np.maximum(robot.limits.lower, -2.6), np.minimum(robot.limits.upper, 2.6)
    middle, half = (low + high) / 2, 0.7 * (high - low) / 2
    for k in range(PAIRS):
        a, b = (middle + half * rng.uniform(-1, 1, robot.n) for _ in range(2))
        b = a + 0.6 * (b - a)
        time = 1.6 * float(np.max(np.abs(b - a) / (0.5 * robot.limits.velocity))) + 0.5
        around = 0.25 * half * rng.uniform(-1, 1, robot.n)

        def other(time: float, k: int = k, a: Any = a, b: Any = b, around: Any = around) -> Motion:
            return _way(a, b, time, time, around) if k % 2 else _way(a, b, time / 1.6, time, np.zeros(robot.n))

        time *= max(1.0, _over(other(time), robot.limits))
        pairs.append((_way(a, b, time, time, np.zeros(robot.n)), other(time)))
    begin = max(rows[3][-1] for rows in truth.at_rows.values())
    true, ours = [], []
    for motions in zip(*pairs, strict=True):
        true.append([power.sum() * STEP for power in truth.plant(list(motions))])
        said = [foreseen(model, robot, *m, begin + np.arange(len(m[0])) * STEP) for m in motions]
        ours.append([power.sum() * STEP for power in said])
    change = np.diff(true, axis=0)
    return _rms(np.diff(ours, axis=0) - change) / _rms(change)


def _over(motion: Motion, limits: Limits) -> float:
    """By which factor a motion must be slower to keep limits of speed and acceleration; 1 where it just does."""
    _, v, a = motion
    return float(np.max([np.abs(v) / limits.velocity, np.sqrt(np.abs(a) / limits.acceleration)]))


def _way(a: np.ndarray, b: np.ndarray, lasts: float, time: float, around: np.ndarray) -> Motion:
    """From a to b in `lasts` s with a cycloid of speed, by way of a bulge, then waiting until `time`."""
    x = np.clip(np.arange(round(time / STEP)) * STEP / lasts, 0, 1)[:, None]
    s = x - np.sin(2 * np.pi * x) / (2 * np.pi)
    bulge = np.sin(np.pi * s) ** 2
    q = a + (b - a) * s + around * bulge
    v = np.gradient(q, STEP, axis=0)
    return q, v, np.gradient(v, STEP, axis=0)


def contradictions(out: Path, truth: Truth) -> list[str]:
    """Where the files of a diagnosis contradict each other or themselves, one sentence each."""
    text = (out / "diagnosis.json").read_text()
    d = json.loads(text, parse_constant=lambda word: f"not JSON: {word}")
    model = load_model(out / "model.toml")
    held = {e.name: e for e in model.effects}
    names = [row["name"] for row in d["effects"]]
    found = [f"diagnosis.json holds {word}" for word in ("NaN", "Infinity") if re.search(rf"\b{word}\b", text)]
    for row in d["effects"]:
        found += _of_claim(row, held, truth)
    found += _of_verdict(d, names)
    error = d["error"]
    part = "holdout" if error["after"]["holdout"] else "train"
    before, after = error["before"][part]["power_rmse"], error["after"][part]["power_rmse"]
    if (names or d["verdict"] in ("explained", "partly")) and after > before:
        found.append(f"{d['verdict']} with {names}, and the error on {part} grew from {before:.3g} to {after:.3g} W")
    if set(d["split"]["train"]) & set(d["split"]["holdout"]):
        found.append("a run is both fitted and held out")
    if d["split"]["holdout"] and not beyond_motion(held) and not truth.sharp:
        ours, _ = held_out(truth, model, d["split"]["holdout"])
        if abs(ours - after) > NEAR * after + 0.05:
            found.append(f"error.after says {after:.3g} W, model.toml reaches {ours:.3g} W on the same runs")
    found += _of_words(d, before, after)
    page = (out / "report.html").read_text()
    missing = [name for name in names if name.replace("_", " ") not in page and name not in page]
    found += [f"report.html does not mention {name}" for name in missing]
    return found


def _of_claim(row: dict[str, Any], held: dict[str, Any], truth: Truth) -> list[str]:
    name, found = row["name"], []
    effect = held.get(name)
    if effect is None:
        return [f"{name} is claimed and not in model.toml"]
    for key, value in row["parameters"].items():
        if key not in effect.values:
            continue
        size = effect.values[key].size
        claimed = np.ravel(np.asarray(value, dtype=float))
        if size not in (1, claimed.size) and claimed.size != 1:
            found.append(f"{name}.{key} has {claimed.size} numbers, in model.toml {size}")
        elif not np.allclose(np.ravel(effect.values[key]), claimed, rtol=1e-3, atol=1e-6):
            found.append(f"{name}.{key} is claimed otherwise than model.toml has it")
        ends = row["ci95"].get(key)
        if ends is not None and None not in np.ravel(ends):
            low, high = np.atleast_2d(np.asarray(ends, dtype=float)).reshape(-1, 2).T
            if not ((low <= claimed + 1e-9) & (claimed <= high + 1e-9)).all():
                found.append(f"{name}.{key} is outside of its own interval")
    share = row.get("share_of_residual")
    if share is not None and not 0 < share <= 1:
        found.append(f"{name} explains a share of {share:g}")
    if row.get("p_value") is not None and not 0 <= row["p_value"] <= 1:
        found.append(f"{name} has the p-value {row['p_value']:g}")
    return found


def _of_verdict(d: dict[str, Any], names: list[str]) -> list[str]:
    verdict, found = d["verdict"], []
    if verdict in ("explained", "partly") and not names:
        found.append(f"{verdict} without an effect")
    if verdict in ("nothing_missing", "unexplained") and names:
        found.append(f"{verdict} with {names}")
    if verdict == "ambiguous" and len(d["alternatives"]) < 2:
        found.append("ambiguous without alternatives")
    if verdict == "partly" and not d["remainder"]:
        found.append("partly, and nothing is said of the remainder")
    if set(names) & set(d["nuisance"]):
        found.append("an effect is a cause and a nuisance at once")
    part = "holdout" if d["error"]["after"]["holdout"] else "train"
    for word, when in (("explained", "after"), ("nothing_missing", "before")):
        ratio = d["error"][when][part]["power_rmse"] / max(d["noise_floor"], 1e-9)
        if verdict == word and ratio > 1.2:
            found.append(f"{verdict}, with {ratio:.2f} times the noise floor on {part}")
    return found


def _of_words(d: dict[str, Any], before: float, after: float) -> list[str]:
    said, found = d["headline"], []
    if not said.strip():
        return ["no headline"]
    if ("nothing is missing" in said.lower()) != (d["verdict"] == "nothing_missing"):
        found.append(f"verdict {d['verdict']}, headline: {said}")
    pair = re.search(r"held out (-?[\d.]+) (?:→|to) (-?[\d.]+) W", said)
    if pair and not d["split"]["holdout"]:
        found.append("the headline speaks of held-out runs, and there are none")
    if pair and not np.allclose([float(x) for x in pair.groups()], [before, after], rtol=0.01, atol=0.0501):
        found.append(f"the headline says {pair.group(0)}, error says {before:.3g} and {after:.3g} W")
    shares = [float(x) for x in re.findall(r"(-?[\d.]+) % of the residual above", said)]
    found += [f"the headline explains {x:g} %" for x in shares if not 0 <= x <= 100]
    if d["verdict"] == "explained" and "no cause" in said.lower():
        found.append(f"explained, headline: {said}")
    return found
