"""The summary of a batch: failures, savings, other objectives, times, certificates, machine; as a document and as a
table.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.records import IDENTITY, Row
from energy_opt.motion.result import ROUNDING
from energy_opt.power.per_year import PerYear, per_year_words

PACKAGES = ("energy-opt", "casadi", "pin", "toppra", "numpy", "scipy")
WORST = 5  # most records in a list of the worst
DEFECT = 1e-6  # share of a bound: a larger excess is a violation


def distribution(values: Iterable[float | None]) -> dict[str, float | int | None]:
    """Count, mean and quantiles of the values that are not None."""
    data = np.array([value for value in values if value is not None], dtype=float)
    names = ("worst", "p10", "median", "p90", "best")
    if data.size == 0:
        return {"count": 0, "mean": None, **dict.fromkeys(names)}
    quantiles = np.quantile(data, [0, 0.1, 0.5, 0.9, 1])
    return {"count": data.size, "mean": float(data.mean()), **dict(zip(names, quantiles.tolist(), strict=True))}


def grouped(records: Iterable[Row], names: Sequence[str]) -> dict[tuple[Any, ...], list[Row]]:
    """Records by the values of some columns, in the order of first appearance."""
    out: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in records:
        out[tuple(row[name] for name in names)].append(row)
    return dict(out)


def summarize(
    records: Sequence[Row], expected: int, run: dict[str, Any], worth: PerYear | None = None
) -> dict[str, Any]:
    """The summary of a batch.

    Args:
        records: in the order of the suite.
        expected: number of moves in the suite; fewer records mean an interrupted batch.
        run: facts about this run (jobs, wall seconds, moves per second).
        worth: runs of all moves of the batch per year, each once.
    """
    solved = [row for row in records if row["status"] == "solved"]
    known = [row for row in solved if row["saving_total_percent"] is not None]
    saved = sum(row["energy_scaled"] - row["energy_total"] for row in known) if known else None
    return {
        "suite": records[0]["suite"] if records else None,
        "complete": len(records) == expected,
        "moves": expected,
        "status": dict(Counter(row["status"] for row in records)),
        "failures": [
            {name: row[name] for name in (*IDENTITY, "status", "error")} for row in records if row["status"] != "solved"
        ],
        "savings": _savings(solved),
        "proxies": _proxies(solved),
        "times": _times(records),
        "certificates": _certificates(records),
        **({} if worth is None else {"per_year": {**worth.of(saved), "cycles_per_year": worth.cycles_per_year}}),
        "run": run,
        "machine": machine(),
    }


def _savings(solved: Sequence[Row]) -> list[dict[str, Any]]:
    """Distributions of savings [%] and losses [J] by robot, mode, objective, model, payload and timing."""
    names = ("robot", "mode", "objective", "model", "payload", "timing")
    return [
        {
            **dict(zip(names, key, strict=True)),
            "loss_percent": distribution(row["saving_loss_percent"] for row in group),
            "total_percent": distribution(row["saving_total_percent"] for row in group),
            "loss_joules": sum(row["energy_loss"] for row in group),
        }
        for key, group in grouped(solved, names).items()
    ]


def _proxies(solved: Sequence[Row]) -> list[dict[str, Any]]:
    """The additional loss of each other objective over energy itself, on the same move at the same duration."""
    same = [name for name in IDENTITY if name != "objective"]
    best = {tuple(row[name] for name in same): row for row in solved if row["objective"] == "energy"}
    names = ("robot", "mode", "model", "timing", "objective")
    out = []
    for key, group in grouped((row for row in solved if row["objective"] != "energy"), names).items():
        pairs = [(row, other) for row in group if (other := best.get(tuple(row[name] for name in same)))]
        pairs = [(row, other) for row, other in pairs if abs(row["duration"] / other["duration"] - 1) < 1e-6]
        more = [
            100 * (row["energy_loss"] / other["energy_loss"] - 1)
            for row, other in pairs
            if other["energy_loss"] > ROUNDING * abs(other["energy_total"])
        ]
        joules = [row["energy_total"] - other["energy_total"] for row, other in pairs]
        quantiles = distribution(more)
        out.append(
            {
                **dict(zip(names, key, strict=True)),
                "pairs": len(pairs),
                "more_loss_percent": {
                    "mean": quantiles["mean"],
                    "median": quantiles["median"],
                    "most": quantiles["best"],
                },
                "more_joules_mean": float(np.mean(joules)) if joules else None,
            }
        )
    return out


def _times(records: Sequence[Row]) -> list[dict[str, Any]]:
    """Solve and build times [s] by robot and mode."""
    out = []
    for (robot, mode), group in grouped(records, ("robot", "mode")).items():
        solve = [row["solve_seconds"] for row in group if row["solve_seconds"] is not None]
        build = [row["build_seconds"] for row in group if row["build_seconds"] is not None]
        if not solve:
            continue
        quantiles = distribution(solve)
        out.append(
            {
                "robot": robot,
                "mode": mode,
                "count": len(solve),
                "build_seconds_longest": max(build),
                "solve_seconds_median": quantiles["median"],
                "solve_seconds_p90": quantiles["p90"],
                "solve_seconds_longest": quantiles["best"],
                "solve_seconds_geometric_mean": float(np.exp(np.mean(np.log(np.maximum(solve, 1e-6))))),
            }
        )
    return out


def _certificates(records: Sequence[Row]) -> dict[str, Any]:
    """The number of judged results, the number that violate a limit, and the worst of them."""
    judged = [row for row in records if row["max_violation"] is not None]
    worst = sorted(judged, key=lambda row: -row["max_violation"])[:WORST]
    return {
        "judged": len(judged),
        "violated": sum(row["max_violation"] > DEFECT for row in judged),
        "worst": [{name: row[name] for name in (*IDENTITY, "status", "max_violation")} for row in worst],
    }


def machine() -> dict[str, Any]:
    """The machine and the versions that affect speed and digits."""
    versions: dict[str, str | None] = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = None
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": versions,
    }


def _cpu() -> str:
    """The name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            names = (line.partition(":")[2].strip() for line in stream if line.startswith("model name"))
            return next(names, platform.processor())
    except OSError:
        return platform.processor()


def table(summary: Mapping[str, Any], out: Path) -> str:
    """The summary as a short table."""
    status = ", ".join(f"{count} {name}" for name, count in sorted(summary["status"].items()))
    lines = [f"{summary['suite']}: {sum(summary['status'].values())} of {summary['moves']} moves: {status or 'none'}"]
    for row in summary["failures"][:10]:
        lines.append(f"  {row['robot']} {row['move']} {row['mode']} {row['timing']}: {row['status']}: {row['error']}")
    if len(summary["failures"]) > 10:
        lines.append(f"  ... and {len(summary['failures']) - 10} more, in report.html")
    if summary["savings"]:
        lines.append("loss saved against the same path at the same duration [%]:")
        lines.append(f"  {'':44s} {'moves':>6} {'mean':>7} {'worst':>7} {'median':>7} {'best':>7}")
    for row in summary["savings"]:
        label = " ".join(str(row[n]) for n in ("robot", "mode", "objective", "model", "payload", "timing") if row[n])
        found = row["loss_percent"]
        numbers = " ".join(
            f"{found[name]:7.2f}" if found[name] is not None else f"{'-':>7}"
            for name in ("mean", "worst", "median", "best")
        )
        lines.append(f"  {label:44s} {found['count']:6d} {numbers}")
    if "per_year" in summary:
        lines.append(per_year_words(summary["per_year"], summary["per_year"]["cycles_per_year"]))
    lines.append(f"{summary['run']['moves_per_second']:.3g} moves/s; results in {out}")
    return "\n".join(lines)
