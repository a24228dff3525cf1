"""The page of a cell: all arms moving, a Gantt chart of all robots, their power, and what each lever saves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from energy_opt.cell.words import floored
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.charts import Block, Chart, Line
from energy_opt.reports.page import Report


def gantt(robots: Sequence[Mapping[str, Any]], cycle: float) -> list[Block]:
    """The steps of a periodic cycle [s] as bars: a lane for every robot, and below it one for its zones.

    Args:
        robots: name and steps: name, start, duration [s], mode (None: it moves) and zone.
    """
    out = []
    for robot in robots:
        for step in robot["steps"]:
            mode, zone = step["mode"], step.get("zone")
            kinds = [(robot["name"], "moves" if mode is None else f"waits: {mode}")]
            kinds += [] if zone is None else [(f"{robot['name']}: zone", f"zone {zone}")]
            for begin, end in _within(step["start"], step["duration"], cycle):
                out += [Block(lane, str(step["name"]), begin, end - begin, kind) for lane, kind in kinds]
    return out


def _within(start: float, duration: float, cycle: float) -> list[tuple[float, float]]:
    """An interval of a periodic cycle as parts of [0, cycle]."""
    if duration <= 0:
        return []
    begin = start % cycle
    end = begin + min(duration, cycle)
    return [(begin, end)] if end <= cycle else [(begin, cycle), (0.0, end - cycle)]


SLOWED = (
    "Up to paths, levers are schedules of evenly slowed moves along their first paths: exact for these, but not kept "
    "apart from other arms. From paths on, moves are optimized and the arms are proven apart."
)


def page(
    document: Mapping[str, Any],
    power: tuple[np.ndarray, np.ndarray] | None = None,
    scene: Mapping[str, Any] | None = None,
) -> Report:
    """The report of a job.json of several robots.

    Args:
        power: of all robots over the cycle: time (N,) [s] and power (N,) [W].
        scene: all arms in one scene, as `cell_player` gives it.
    """
    report = Report(f"A cell of {len(document['robots'])} robots: a cycle of {document['cycle_time']:.5g} s")
    report.headline(headline(document)).warning(*document["warnings"]).player(scene)
    drawn = [] if power is None else [Line("power", *power)]
    report.section("The cycle of all robots").charts(
        Chart("Steps", "time [s]", "", timed=True, blocks=gantt(document["robots"], document["cycle_time"])),
        Chart("Power of all robots", "time [s]", "power [W]", drawn, timed=True),
    )
    if power is not None:
        where = float(power[0][int(np.argmax(power[1]))])
        report.text(f"The power of all robots is {power[1].max():.4g} W at most, at {where:.4g} s.")
    levers = document["levers"]
    falls = [(_value_text(x), x["energy_total"]) for x in levers]
    report.section("What each lever saves").charts(Chart("Energy of the cycle", "", "energy [J]", waterfall=falls))
    first = levers[0]["energy_total"]

    def row(name: str, lever: Mapping[str, Any], mean: float | None = None) -> list[Any]:
        energy, year = lever["energy_total"], lever.get("per_year", {})
        return [name, energy, first - energy, 100 * (1 - energy / first), year.get("kwh"), year.get("money"), mean]

    means = _means(document)
    records = [row(_value_text(x), x, means.get(x["name"])) for x in levers]
    records += [row(f"{_value_text(x)} alone", x) for x in document["levers_alone"]]
    if document["bound"] is not None:
        records.append(["lower bound of these curves", document["bound"], *[None] * 5])
    header = ["with", "energy of the cycle [J]", "saved [J]", "saved [%]", "saved [kWh a year]", "saved [money a year]"]
    header.append("mean of the models [J]")
    report.table(header, records, digits=6)
    if any(lever["moves"] == "evenly_slowed" for lever in levers):
        report.text(SLOWED)
    for robot in document["robots"]:
        steps = [{**s, "mode": s["mode"] or "moves"} for s in robot["steps"]]
        columns = {"step": "name", "begins [s]": "start", "takes [s]": "duration", "mode": "mode", "zone": "zone"}
        report.section(str(robot["name"])).records(steps, {**columns, "energy [J]": "energy_total"}, digits=6)
    columns = {"file": "file", "robot": "robot", "begins [s]": "starts_at", "within all limits": "valid"}
    report.section("Files for controllers").records(document["written"], columns)
    return report.command(document.get("request"))


def headline(document: Mapping[str, Any]) -> str:
    """One sentence: energy, bound, and saving against the first lever."""
    lever = document["levers"][0]
    total, first = document["energy_total"], lever["energy_total"]
    against = "the cycle as it is" if lever["name"] == "as_is" else f"with the lever {lever['name']} alone"
    gap = document["optimality"]["gap_percent"]
    text = f"{total:.6g} J a cycle"
    if gap is not None:
        text += f", at most {gap:.2g} % above the least of these curves"
    return f"{text}; {100 * (1 - total / first):.3g} % less than {against}." if total < first else f"{text}."


def _value_text(lever: Mapping[str, Any]) -> str:
    return str(lever["name"]).replace("_", " ")


def table(found: Mapping[str, Any], cycles: float | None) -> str:
    """Table of the schedule and the saving by each lever, for a terminal.

    Args:
        found: the content of job.json. cycles: how many a year, if asked for.
    """
    lines = [f"{'robot':<14} {'step':<28} {'begins [s]':>10} {'takes [s]':>10} {'mode':<16} {'energy [J]':>12}"]
    for robot in found["robots"]:
        lines += [
            f"{robot['name'][:14]:<14} {s['name'][:28]:<28} {s['start']:>10.3f} {s['duration']:>10.3f} "
            f"{(s['mode'] or 'moves')[:16]:<16} {s['energy_total']:>12.1f}"
            for s in robot["steps"]
        ]
    bound = "" if found["bound"] is None else f"; no schedule of these curves takes less than {found['bound']:.1f} J"
    lines.append(f"the cycle of {found['cycle_time']:g} s takes {found['energy_total']:.1f} J{bound}")
    lines.append(_apart(found))
    lines += _supplied(found)
    lines += _levers(found)
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], cycles or 0.0))
    return "\n".join(line for line in lines if line)


def _apart(found: Mapping[str, Any]) -> str:
    """Line on the proven distance of the arms; empty for a single arm."""
    clearance = found["clearance"]
    if clearance is None:
        return ""
    late = f"each up to {1e3 * clearance['jitter']:g} ms early or late"
    if clearance["verdict"] == "proven":
        measured = (row for row in clearance["robots"] if row["min_distance"] is not None)
        near = min(measured, key=lambda row: row["min_distance"], default=None)
        pair = "" if near is None else "–".join(map(" ".join, zip(near["robots"], near["pair"], strict=True)))
        return f"the arms are proven to keep at least {floored(1e3 * clearance['lower_bound'])} mm apart, {late}" + (
            f"; nearest measured {1e3 * near['min_distance']:.3g} mm ({pair}, at {near['time']:.4g} s)" if near else ""
        )
    return f"the arms, {late}: {clearance['verdict']}"


def _supplied(found: Mapping[str, Any]) -> list[str]:
    """Lines on the arms' energy from supplies of their own and from the supply of the file."""
    supply = found["supply"]
    if supply is None or found["levers"][-1]["name"] != "supply":
        return []
    most = "" if supply["max_power"] is None else f" of {supply['max_power']:.5g} W"
    return [
        f"supplies of their own: {supply['energy_own']:.1f} J, {supply['lost_own']:.1f} J of braking lost, "
        f"peak {supply['peak_own']:.1f} W",
        f"the supply of the file: {supply['energy']:.1f} J, {supply['lost']:.1f} J of braking lost, "
        f"peak {supply['peak']:.1f} W{most}",
    ]


def _levers(found: Mapping[str, Any]) -> list[str]:
    """The cycle with one lever after the other; levers that were computed for evenly slowed moves are marked."""
    levers = found["levers"]
    first, year, means = levers[0]["energy_total"], "per_year" in levers[0], _means(found)
    lines = [f"{'with':<10} {'energy [J]':>12} {'saved [J]':>12} {'saved [%]':>10}"]
    lines[0] += f" {'mean [J]':>12}" if means else ""
    lines[0] += f" {'[kWh a year]':>13} {'[money]':>10}" if year else ""
    for lever in levers:
        mark = "*" if lever["moves"] == "evenly_slowed" else ""
        saved = first - lever["energy_total"]
        line = f"{lever['name'].replace('_', ' ') + mark:<10} {lever['energy_total']:>12.1f} {saved:>12.1f}"
        line += f" {100 * saved / first:>10.2f}"
        line += f" {means[lever['name']]:>12.1f}" if means else ""
        if year:
            kwh, money = lever["per_year"]["kwh"], lever["per_year"]["money"]
            line += f" {kwh:>13.2f} {'-' if money is None else format(money, '.2f'):>10}"
        lines.append(line)
    if any(lever["moves"] == "evenly_slowed" for lever in levers):
        lines.append("* computed for evenly slowed moves along initial paths, which may touch other arms")
    if means:
        lines.append("planned for the mean of the models; all other energies are under the first of them")
    return lines


def _means(found: Mapping[str, Any]) -> dict[str, float]:
    """Energy [J] by lever for the mean of several models; empty with one."""
    return {lever["name"]: lever["energy_total"] for lever in found.get("robust", {}).get("levers", ())}
