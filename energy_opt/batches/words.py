"""The summary of a batch as a short table for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from energy_opt.power.worth import per_year_words


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
