"""Comparison of two runs of a suite: moves that got better or worse beyond noise."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.records import IDENTITY, Row, read_parquet
from energy_opt.batches.summary import DEFECT, grouped
from energy_opt.errors import BadInput
from energy_opt.files import read_text

ENERGY_NOISE = 1e-3  # share of the loss: smaller differences between two solves of one move count as noise
ENERGY_FLOOR = 1e-3  # [J] the same for moves with almost no loss
TIME_NOISE = 0.10  # share by which a median time may differ between runs on one machine
SIGNIFICANCE = 0.01  # level of the sign test that a change of times must pass as well
RANKS = {"solved": 0, "not_converged": 1, "infeasible": 2, "failed": 3}


def compare(old: Path, new: Path) -> dict[str, Any]:
    """Compare two results (folders of `bench --out`, or their results.parquet).

    Energies are compared move by move, beyond the solver's tolerance; a change of status or a new violation of a limit
    always counts; times are compared as the median ratio over moves, with a sign test, and only if both runs name the
    same machine.

    Raises:
        BadInput: a path has no results, or the two have no move in common.
    """
    files = [path / "results.parquet" if path.is_dir() else path for path in (old, new)]
    before, after = ({tuple(row[name] for name in IDENTITY): row for row in read_parquet(file)} for file in files)
    keys = [key for key in before if key in after]
    if not keys:
        raise BadInput(f"{old} and {new} have no move in common: nothing to compare")
    pairs = [(before[key], after[key]) for key in keys]
    changes = [change for a, b in pairs if (change := _change(a, b))]
    machines = [_machine(path) for path in (old, new)]
    same_machine = machines[0] is not None and machines[0] == machines[1]
    return {
        "old": str(old),
        "new": str(new),
        "common": len(pairs),
        "only_old": len(before) - len(pairs),
        "only_new": len(after) - len(pairs),
        "better": [c for c in changes if c["verdict"] == "better"],
        "worse": [c for c in changes if c["verdict"] == "worse"],
        "energy": _energy(pairs),
        "times": _times(pairs) if same_machine else [],
        "same_machine": same_machine,
    }


def _machine(path: Path) -> tuple[Any, ...] | None:
    """Processor, cores and system of a run; None without a summary."""
    file = (path if path.is_dir() else path.parent) / "summary.json"
    if not file.is_file():
        return None
    try:
        found = json.loads(read_text(file))["machine"]
        return found["cpu"], found["cores"], found["system"]
    except (ValueError, KeyError, TypeError):
        raise BadInput(f"{file}: not a summary of this program") from None


def _change(a: Row, b: Row) -> dict[str, Any] | None:
    """The change of one move beyond noise, or None."""
    named = {name: b[name] for name in IDENTITY}
    old, new = a["status"], b["status"]
    if old != new:
        verdict = "better" if RANKS.get(new, 3) < RANKS.get(old, 3) else "worse"
        return {**named, "verdict": verdict, "what": "status", "old": old, "new": new, "why": b["error"]}
    for row, other, verdict in ((b, a, "worse"), (a, b, "better")):
        if (row["max_violation"] or 0.0) > DEFECT >= (other["max_violation"] or 0.0):
            old, new = a["max_violation"], b["max_violation"]
            return {**named, "verdict": verdict, "what": "max_violation", "old": old, "new": new}
    if a["energy_loss"] is None or b["energy_loss"] is None:
        return None
    same_duration = abs(a["duration"] - b["duration"]) <= 1e-3 * a["duration"]
    if not same_duration and b["timing"] != "free":
        return None  # the minimum time itself changed, so the energies are not comparable
    what = "energy_loss" if same_duration else "energy_total"
    old, new = a[what], b[what]
    if abs(new - old) <= max(ENERGY_FLOOR, ENERGY_NOISE * abs(a["energy_loss"])):
        return None
    return {**named, "verdict": "better" if new < old else "worse", "what": what, "old": old, "new": new}


def _energy(pairs: Sequence[tuple[Row, Row]]) -> dict[str, Any]:
    """Sums of energies over the moves that both runs solved."""
    both = [(a, b) for a, b in pairs if a["status"] == b["status"] == "solved"]
    sums = {
        f"{part}_{when}": sum(pair[k][f"energy_{part}"] for pair in both)
        for part in ("total", "loss")
        for k, when in enumerate(("old", "new"))
    }
    return {"moves": len(both), **sums}


def _times(pairs: Sequence[tuple[Row, Row]]) -> list[dict[str, Any]]:
    """Median ratio new/old of the solve times of each robot and mode, and whether it is beyond noise."""
    from scipy.stats import binomtest

    out = []
    old_of = {tuple(b[name] for name in IDENTITY): a for a, b in pairs}
    for (robot, mode), records in grouped([b for _, b in pairs], ("robot", "mode")).items():
        ratios = [
            b["solve_seconds"] / a["solve_seconds"]
            for b in records
            if (a := old_of[tuple(b[name] for name in IDENTITY)])["solve_seconds"] and b["solve_seconds"]
        ]
        if not ratios:
            continue
        median, slower = float(np.median(ratios)), sum(ratio > 1 for ratio in ratios)
        p_value = float(binomtest(slower, len(ratios)).pvalue)  # if slower and faster were equally likely
        beyond = abs(math.log(median)) > math.log(1 + TIME_NOISE) and p_value < SIGNIFICANCE
        verdict = "same" if not beyond else "worse" if median > 1 else "better"
        row = {"robot": robot, "mode": mode, "moves": len(ratios), "ratio": median}
        out.append({**row, "p_value": p_value, "verdict": verdict})
    return out


def comparison_text(found: dict[str, Any]) -> str:
    """The comparison as lines for a terminal."""
    lines = [f"{found['common']} moves in both; only in old {found['only_old']}, only in new {found['only_new']}"]
    for verdict in ("worse", "better"):
        lines.append(f"{verdict}: {len(found[verdict])}")
        for change in found[verdict]:
            where = " ".join(str(change[name]) for name in IDENTITY[1:] if change[name])
            old, new = (f"{x:.6g}" if isinstance(x, float) else str(x) for x in (change["old"], change["new"]))
            why = f" ({change['why']})" if change.get("why") else ""
            lines.append(f"  {where}: {change['what']} {old} -> {new}{why}")
    energy = found["energy"]
    if energy["moves"]:
        lines.append(
            f"energy over {energy['moves']} moves: total {energy['total_old']:.6g} -> {energy['total_new']:.6g} J, "
            f"loss {energy['loss_old']:.6g} -> {energy['loss_new']:.6g} J"
        )
    if not found["same_machine"]:
        lines.append("solve times: not compared, the runs do not name the same machine")
    for row in found["times"]:
        lines.append(
            f"solve time {row['robot']} {row['mode']}: x {row['ratio']:.3g} over {row['moves']} moves "
            f"(p = {row['p_value']:.2g}): {row['verdict']}"
        )
    return "\n".join(lines)
