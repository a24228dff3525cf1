"""Texts on certificates and savings, the same on the console and in reports."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from energy_opt.cell.words import floored

ALLOWED = 1e-6  # share of a bound: tolerance, as in the certificate
INVALID = "* breaks a limit or is not clear of bodies: no energy to compare with"


def goals_words(found: Mapping[str, Any]) -> str:
    """How a result's goal was chosen, and its saving against the nearest one; "" if the goal was given."""
    if "candidates" not in found:
        return ""
    near, energy = found["nearest"], found["energy"]["total"]
    words = f"goals: {len(found['candidates'])} looked at, {found['solves']['full']} solved in full; "
    if near["energy"] is None:
        ended = near.get("status") == "not_looked_at"
        early = "the search ended, at its deadline or interrupted, before the nearest one was solved"
        return words + (early if ended else "no motion to the nearest one was found")
    if near["saving_joules"] <= ALLOWED * abs(energy):
        return words + "the nearest one is the cheapest"
    saved, whole = near["saving_joules"], near["energy"]
    same = "in the same time" if abs(near["duration"] - found["duration"]) < 1e-6 else f"in {near['duration']:.4g} s"
    return (
        f"{words}the nearest one takes {whole:.4f} J {same}, this one {whole - saved:.4f} J: saved {saved:.4g} J, "
        f"{100 * saved / abs(whole):.3g} %{of_models(found.get('robust'))}"
    )


def first_path_words(source: str | None) -> str:
    """The first path of a move, by its source; "straight path" if that is unknown."""
    return "straight path" if source in (None, "straight") else "first path"


def of_models(robust: Mapping[str, Any] | None) -> str:
    """What an energy is of that a plan minimises: " (mean of the models)"; "" under one model.

    Args:
        robust: as results have it; None under one model.
    """
    return "" if robust is None else f" ({robust['kind']} of the models)"


def limits_words(certificate: Mapping[str, Any], unit: Callable[[str, str], str]) -> str:
    """A certificate's limits: whether all are kept, and the one that is used most.

    Args:
        unit: of a limit and a joint.
    """
    worst = certificate["worst"]
    sizes = list(certificate["max_violation"].values())
    place = f"{worst['joint']} {worst['limit']}".strip()
    if any(size is None for size in sizes):
        return f"limits not kept: {place} is not known at {worst['time']:.4g} s"
    excess = max(sizes)
    if excess > ALLOWED:
        return (
            f"limits not kept: {place} is {worst['value']:.6g} {unit(worst['limit'], worst['joint'])} at "
            f"{worst['time']:.4g} s, {worst['bound']:.6g} is allowed ({100 * excess:.2g} % over)"
        )
    if excess <= -1:
        return "all limits kept"
    if worst["limit"] == "position":
        used = f"{100 * max(0.0, -excess):.2g} % of its range left"
    else:
        used = f"{floored(100 * (1 + excess), 4)} % used"
    return f"all limits kept; tightest: {place}, {used} at {worst['time']:.4g} s"


def input_words(document: Mapping[str, Any]) -> str:
    """The result against the given trajectory, at its duration; empty if none was given."""
    named = {row["name"]: row for row in document["baselines"]}
    given, fastest = named.get("input"), named.get("toppra")
    if given is None or abs(given["duration"] / document["duration"] - 1) > 1e-6:
        return ""
    robust = document.get("robust")
    energies = robust["baselines"] if robust else {name: row["energy"]["total"] for name, row in named.items()}
    total, own = (robust or document["energy"])["total"], energies["input"]
    text = f"your timing: {given['duration']:.4g} s, {own:.5g} J"
    text += "" if given["valid"] else " (breaks a limit or touches something)"
    text += f"; this plan: {document['duration']:.4g} s, {total:.5g} J"
    if given["valid"]:
        text += f" (saves {own - total:.3g} J, {100 * (own - total) / own:.2g} %)"
    if fastest is not None:
        text += f"; fastest timing: {fastest['duration']:.4g} s, {energies['toppra']:.5g} J"
    return text + of_models(robust)


def energy_records(columns: Sequence[tuple[float, Mapping[str, Any]]], part: str, effect: str) -> list[list[object]]:
    """Lines of a table of energies: durations [s], total and parts, and effects that say more than a line before them.

    Args:
        columns: duration and energies as a result's document has them, of each motion; the first has all effects.
        part, effect: the heads of their lines, with {} for the name.
    """
    records: list[list[object]] = [["duration [s]", *(duration for duration, _ in columns)]]
    for name in ("total", "standby", "stored", "loss"):
        records.append([part.format(name), *(energy[name] for _, energy in columns)])
    for name in columns[0][1]["by_effect"]:
        values = [energy["by_effect"].get(name) for _, energy in columns]
        if not any(_same(values, row[1:]) for row in records[1:]):
            records.append([effect.format(name), *values])
    return records


def _same(values: Sequence[Any], others: Sequence[Any]) -> bool:
    """True if two records of a table of energies are equal except for rounding."""
    alike = [
        a is b or (a is not None and b is not None and math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-6))
        for a, b in zip(values, others, strict=True)
    ]
    return all(alike)


def yearly(document: Mapping[str, Any]) -> dict[str, str]:
    """The saving per year by kind; empty if it was not requested."""
    names = {"kwh": ("energy", " kWh"), "money": ("money", ""), "co2_kg": ("CO2", " kg")}
    found = document.get("per_year") or {}
    return {
        f"{name} saved in a year": f"{found[key]:.4g}{unit}"
        for key, (name, unit) in names.items()
        if found.get(key) is not None
    }


def energy_words(found: Mapping[str, Any]) -> str:
    """The energy that the minima of a tradeoff.json minimise, such as "mean energy over the models"."""
    kinds = {"mean": "mean energy over the models", "worst": "largest energy under any model"}
    return kinds[found["robust"]["kind"]] if "robust" in found else "energy"


def least_of(found: Mapping[str, Any], row: Mapping[str, Any]) -> float:
    """The value [J] of a record of a tradeoff.json that its minima minimise."""
    return float(row["energy_robust" if "robust" in found else "energy_total"])
