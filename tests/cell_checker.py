"""An independent check of a cell's schedule: reads the job file and job.json, imports nothing of the package."""

from __future__ import annotations

from typing import Any

CLOSE = 1e-5  # [s]
SHARE = 1e-6  # of an energy


def faults_of_schedule(cell: dict[str, Any], result: dict[str, Any]) -> list[str]:
    """Every broken duration, mode, ring, lag, zone and energy, one line each."""
    faults: list[str] = []
    cycle = cell["cycle_time"]
    at: dict[str, dict[str, float]] = {}
    zones: dict[str, list[tuple[str, float, float]]] = {}
    total = 0.0
    for robot, answer in zip(cell["robot"], result["robots"], strict=True):
        clock = answer["steps"][0]["start"]
        run: list[Any] = [None, 0.0, 0.0]
        for step, found in zip(robot["step"], answer["steps"], strict=True):
            name = f"{robot['name']}.{found['name']}"
            at[name] = found
            if abs(found["start"] - clock) > CLOSE:
                faults.append(f"{name} starts at {found['start']}, the step before ends at {clock}")
            clock += found["duration"]
            span = step["wait"] if "wait" in step else step["duration"]
            least, most = span if isinstance(span, list) else (span, span)
            if not least - CLOSE <= found["duration"] <= most + CLOSE:
                faults.append(f"{name} takes {found['duration']}, not in {span}")
            energy = _energy(cell, robot, step, found, faults, name)
            if abs(energy - found["energy_total"]) > SHARE * max(1.0, abs(energy)):
                faults.append(f"{name} takes {found['energy_total']} J, by its law {energy} J")
            total += energy
            if step.get("zone"):
                if run[0] == step["zone"]:
                    zones[step["zone"]][-1] = (robot["name"], run[1], clock)
                else:
                    run[1] = found["start"]
                    zones.setdefault(step["zone"], []).append((robot["name"], found["start"], clock))
            run[0] = step.get("zone")
        if abs(clock - answer["steps"][0]["start"] - cycle) > CLOSE:
            faults.append(f"{robot['name']}: its steps take {clock - answer['steps'][0]['start']} s, not the cycle's")
    if abs(total - result["energy_total"]) > SHARE * total:
        faults.append(f"energy_total {result['energy_total']}, the sum is {total}")
    if result["bound"] > result["energy_total"] * (1 + SHARE):
        faults.append("the bound is above the energy")
    for lag in cell.get("lag", ()):
        behind = at[lag["to"]]["start"] - at[lag["from"]]["start"]
        if behind < lag["length"] - cycle * lag.get("height", 0) - CLOSE:
            faults.append(f"lag {lag}: {behind} s")
    for robot in cell["robot"]:
        for step in robot["step"]:
            if step.get("after") and step.get("lag"):
                before = at[step["after"]]
                least, most = step["lag"]
                behind = at[f"{robot['name']}.{step['name']}"]["start"] - before["start"] - before["duration"]
                if not (behind - least + CLOSE) % cycle <= most - least + 2 * CLOSE:
                    faults.append(f"{robot['name']}.{step['name']} begins {behind} s after {step['after']}")
    for zone, uses in zones.items():
        for k, (one, a, b) in enumerate(uses):
            for two, c, d in uses[k + 1 :]:
                overlap = (c - a) % cycle < b - a - CLOSE or (a - c) % cycle < d - c - CLOSE
                if one != two and overlap:
                    faults.append(f"zone {zone}: {one} from {a} to {b}, {two} from {c} to {d}")
    return faults


def _energy(cell: dict, robot: dict, step: dict, found: dict, faults: list[str], name: str) -> float:
    length = found["duration"]
    if "curve" in step:
        return sum(c * length**k for k, c in step["curve"])
    modes = {m["name"]: m for m in [*cell.get("mode", ()), *robot.get("mode", ())]}
    possible = step.get("modes") or [*modes, *step.get("power", {})]
    mode = found["mode"]
    if mode not in possible:
        faults.append(f"{name}: mode {mode} is not possible")
        return 0.0
    table = modes.get(mode, {})
    power = step.get("power", {}).get(mode, table.get("power"))
    (t_in, e_in), (t_out, e_out) = table.get("enter", (0, 0)), table.get("leave", (0, 0))
    if length < max(table.get("least", 0.0), t_in + t_out) - CLOSE:
        faults.append(f"{name}: {length} s in mode {mode}, which needs longer")
    return power * (length - t_in - t_out) + e_in + e_out
