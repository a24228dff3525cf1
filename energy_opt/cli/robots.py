"""`energy-opt robots`: the robots known by name, with joints and limits."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("names", nargs="*", metavar="NAME_OR_URDF", help="only these (default: all known by name)")
    parser.add_argument("--json", action="store_true", help="as one JSON document on stdout")
    parser.add_argument("--quiet", action="store_true", help="no warnings")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    import numpy as np

    from energy_opt.files import to_json
    from energy_opt.power.assumptions import grouped, rests_on
    from energy_opt.robot import known_robots, load_robot

    robots = [load_robot(name) for name in (args.names or known_robots())]
    if args.json:
        kinds = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
        rows = [
            {
                "name": r.name,
                "urdf": r.urdf.name,
                "locked": r.locked,
                "followers": {
                    name: {"joint": leader, "multiplier": ratio, "offset": offset}
                    for name, (leader, ratio, offset) in r.followers.items()
                },
                "warnings": r.warnings,
                "assumptions": [asdict(row) for row in rests_on(r)],
                "joints": [
                    {"name": joint, "unit": r.units[j], **{kind: getattr(r.limits, kind)[j] for kind in kinds}}
                    for j, joint in enumerate(r.joints)
                ],
            }
            for r in robots
        ]
        sys.stdout.write(to_json({"robots": rows}))
        return 0
    for r in robots:
        print(f"{r.name}  ({r.n} joints, {r.urdf.name})")
        print(f"  {'joint':<24}{'position':>24}{'velocity':>10}{'accel.':>9}{'jerk':>9}{'effort':>9}")
        for j, joint in enumerate(r.joints):
            m = r.limits
            bounded = np.isfinite([m.lower[j], m.upper[j]]).all()
            span = f"{m.lower[j]:.4g} … {m.upper[j]:.4g} {r.units[j]}" if bounded else "continuous"
            rates = f"{m.velocity[j]:>10.4g}{m.acceleration[j]:>9.4g}{m.jerk[j]:>9.4g}"
            print(f"  {joint:<24}{span:>24}{rates}{m.effort[j]:>9.4g}")
        for name, (leader, ratio, offset) in r.followers.items():
            print(f"  {name:<24} follows: {ratio:g} times {leader}" + (f" plus {offset:g}" if offset else ""))
        for what, value, source, note in grouped(row for row in rests_on(r) if row.source in ("published", "assumed")):
            print(f"  {source}: {what} {value}" + (f" ({note})" if note else ""))
        if not args.quiet:
            for warning in r.warnings:
                print(f"  warning: {warning}", file=sys.stderr)
    return 0
