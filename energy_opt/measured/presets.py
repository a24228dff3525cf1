"""Columns of known recorders: Universal Robots' RTDE, Franka's state, and `sensor_msgs/JointState` out of bags."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from energy_opt.errors import BadInput
from energy_opt.measured.columns import Rule
from energy_opt.measured.names import joint_columns, power_column
from energy_opt.measured.table import Table

# Columns in which a recorder states the payload that the arm was given: mass [kg], centre of mass [m].
PAYLOAD = {"ur_rtde": ("payload", "payload_cog_0", "payload_cog_1", "payload_cog_2")}
AUTO = float("nan")  # a time's factor that the stamps themselves tell


def ur_rtde(joints: Sequence[str], table: Table) -> dict[str, Rule]:
    """Universal Robots' RTDE recorder: joints by number, arm power as supply voltage times current."""
    rules = {
        "time": Rule(("timestamp",)),
        "power": Rule(("actual_robot_voltage", "actual_robot_current")),
    }
    for k, joint in enumerate(joints):
        rules[f"{joint}.position"] = Rule((f"actual_q_{k}",))
        rules[f"{joint}.velocity"] = Rule((f"actual_qd_{k}",))
        rules[f"{joint}.current"] = Rule((f"actual_current_{k}",))
        rules[f"{joint}.temperature"] = Rule((f"joint_temperatures_{k}",))
    return rules


def franka_state(joints: Sequence[str], table: Table) -> dict[str, Rule]:
    """Franka's state: libfranka's log (`state.q[0]`, time in ms) or a bag's `FrankaState` (`field.q0`, `.../q[0]`).

    Position `q`, velocity `dq` and link-side torque `tau_J`, whatever is before them and however they are numbered.
    """
    rules = _stamps(table)
    for signal, stem in (("position", "q"), ("velocity", "dq"), ("effort", "tau_J")):
        pattern = re.compile(rf"(?:.*[./ ]|){stem}[\[._/ ]?(\d)\]?")
        found = {int(m.group(1)): name for name in table.header if (m := pattern.fullmatch(name))}
        for k, joint in enumerate(joints):
            rules[f"{joint}.{signal}"] = Rule((found.get(k, f"{stem}[{k}]"),), 1.0)
    return rules


def joint_state(joints: Sequence[str], table: Table) -> dict[str, Rule]:
    """`sensor_msgs/JointState` as a bag's or plotter's export writes it: by name, or by number in the order of `name`.

    `/joint_states/elbow_joint/position`, `/joint_states/position/elbow_joint`, `field.position2` with `field.name2`,
    `/joint_states/position[2]`, `position_2`. Numbers without names mean the robot's own order.
    """
    rules = _stamps(table)
    found = joint_columns(table.header, joints, given_names(table))
    for signal in ("position", "velocity", "effort"):
        for joint, name in found.get(signal, {}).items():
            rules[f"{joint}.{signal}"] = Rule((name,))
    if "position" not in found:
        raise BadInput(
            f"{table.path}: row 1: no positions of {', '.join(joints)} among {', '.join(table.header[:12])}"
            + (" ..." if len(table.header) > 12 else "")
        )
    return rules


def given_names(table: Table) -> dict[int, str]:
    """Joint names by number where a message's array `name` is exported beside its positions."""
    if not table.layout.sample:
        return {}
    out = {}
    for k, header in enumerate(table.header):
        match = re.fullmatch(r"(?:.*[./ ]|)name[\[._/ ]?(\d+)\]?", header)
        if match and k < len(table.layout.sample[0]):
            out[int(match.group(1))] = table.layout.sample[0][k].strip().strip('"')
    return out


def _stamps(table: Table) -> dict[str, Rule]:
    """Time and, where there is one, power."""
    names = ("__time", "%time", "time", "Time", "timestamp", "rosbagTimestamp", "_time", "t")
    bare = {re.sub(r"^[%#]\s*", "", name): name for name in table.header}
    name = next((bare[n] for n in (re.sub(r"^[%#]\s*", "", m) for m in names) if n in bare), "time")
    rules = {"time": Rule((name,), AUTO)}
    power = power_column(table.header)
    if power is not None:
        rules["power"] = Rule((power,))
    return rules


PRESETS: Mapping[str, Callable[[Sequence[str], Table], dict[str, Rule]]] = {
    "ur_rtde": ur_rtde,
    "franka_state": franka_state,
    "joint_state": joint_state,
}
