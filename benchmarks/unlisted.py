"""The examination of `diagnose` on arms that are not the library's, also where laws rule that it does not know.

    python benchmarks/unlisted.py --out examined.json [--seed 0] [--jobs 1] [--share 1.0] [--only unlisted,clean]
        [--small] [--more] [--sharp]

Kinds of sets (their number at --share 1):
    unlisted  a law of `unlisted_laws.py` alone, links off by up to 5 %, white noise or noise with memory (60)
    mixed     such a law beside a cause that the library knows (30)
    listed    a cause that the library knows, links off by 3 to 5 %, noise with memory (60)
    exact     the same with exact links and white noise (50)
    clean     nothing but links off by up to 10 %; every noise, every fourth set with five repeats of each motion (300)

Each set is diagnosed from Python, as the command line does it but for the motion to record next and what the diagnosis
is worth; it is judged from the files that this leaves. A crash counts as a false claim,
a miss and a contradiction; `ambiguous` with the truth among its alternatives is no false claim. What --out holds
already is kept: the examination goes on where it was stopped. Seeds 0 to 9 are for development; a final look takes a
seed of 90 or more, that nothing was tuned on. --more takes the laws of `unlisted_more.py` instead;
with --sharp the motions are trapezoids of speed, whose acceleration jumps.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import finish, table
from misfit_world import ARMS, CAUSES, LAWS, MORE, NOISES, World, write_world
from scipy.stats import beta
from unlisted_judge import beyond_motion, contradictions, difference_error, energy_error, held_out
from unlisted_laws import KINDS
from unlisted_more import EVERY, MORE_KINDS

from energy_opt.diagnosis import diagnose
from energy_opt.files import write_json
from energy_opt.measured import read_set
from energy_opt.power import load_model

STATED = 0.95  # probability of the bounds
COUNTS = {"unlisted": 60, "mixed": 30, "listed": 60, "exact": 50, "clean": 300}
SMALL = {"unlisted": 3, "mixed": 1, "listed": 2, "exact": 2, "clean": 2}
WELL_KNOWN = ("coulomb_friction", "viscous_friction", "armature", "motion_power", "supply_efficiency")
SAME = {"supply_efficiency": {"meter_gain"}, "meter_filter": {"meter_window"}}  # one cannot be told from the other
TOLERANCE = 0.2  # of differences of energy, within which a model is usable
ENERGY = 0.03  # of held-out energies, the default of `diagnose --tolerance`, within which a model is usable
LEFT = 1.3  # times the best possible error: more is not explained


def worlds(category: str, count: int, seed: int, laws: Iterable[str] = KINDS) -> Iterator[World]:
    """The sets of a kind; arms, noises and laws take turns, each with a period of its own."""
    arms, kinds, causes = list(ARMS), list(laws), CAUSES + MORE + LAWS
    number = 100_000 * (seed + 1) + 10_000 * list(COUNTS).index(category)
    for k in range(count):
        arm, noise = arms[(k + k // len(kinds)) % len(arms)], ("white", "ar1")[k // 2 % 2]
        if category == "unlisted":
            yield World(arm, number + k, (0.0, 0.05), noise, unlisted=kinds[k % len(kinds)])
        elif category == "mixed":
            known = WELL_KNOWN[k % len(WELL_KNOWN)]
            yield World(arm, number + k, (0.0, 0.05), noise, known, unlisted=kinds[7 * k % len(kinds)])
        elif category == "listed":
            yield World(arms[(k + k // len(causes)) % 4], number + k, (0.03, 0.05), "ar1", causes[k % len(causes)])
        elif category == "exact":
            yield World(arms[(k + k // len(causes)) % 4], number + k, (0.0, 0.0), "white", causes[k % len(causes)])
        else:
            repeats, spread = (5, 5) if k % 4 == 3 else (1, 9), ((0.0, 0.0), (0.03, 0.10))[k // 3 % 2]
            yield World(
                arms[k // 16 % 4], number + k, spread, NOISES[k // 4 % 4], repeats=repeats[0], motions=repeats[1]
            )


def run(job: tuple[str, World]) -> dict[str, Any]:
    """Make one set, diagnose it and judge the files."""
    category, world = job
    row: dict[str, Any] = {"category": category, **asdict(world)}
    with tempfile.TemporaryDirectory() as place:
        truth, out = write_world(world, Path(place) / "set"), Path(place) / "out"
        begun = time.process_time()
        try:
            diagnose(read_set(truth.folder), load_model(truth.folder / "declared.toml")).save(out)
            d = json.loads((out / "diagnosis.json").read_text())
            wrong = contradictions(out, truth)
            model = load_model(out / "model.toml")
        except Exception as error:
            crash = {"verdict": "crash", "named": ["crash"], "false": ["crash"], "contradictions": ["crash"]}
            return {**row, **crash, "found": False, "right": False, "error": repr(error)}
        row["seconds"] = time.process_time() - begun
        named = [e["name"] for e in d["effects"]]
        cause = {world.cause, *SAME.get(world.cause, ())} if world.cause else set()
        allowed = cause | (EVERY[world.unlisted].kin if world.unlisted else set())
        allowed |= {"link_inertia"} if any(world.spread) else set()
        open_ = d["verdict"] == "ambiguous" and any(set(a) <= allowed for a in d["alternatives"])
        false = [] if open_ else [name for name in named if name not in allowed]
        found = bool(cause & set(named)) or any(cause & set(a) for a in d["alternatives"])
        part = "holdout" if d["split"]["holdout"] else "train"
        reached, best = held_out(truth, model, d["split"][part])
        energies = energy_error(truth, model, d["split"][part])
        if beyond_motion(e.name for e in model.effects):
            after = d["error"]["after"][part]
            reached, energies = after["power_rmse"], after["energy_percent"] / 100
        off = difference_error(truth, model, world.seed)
        row.update(
            verdict=d["verdict"],
            named=named,
            alternatives=d["alternatives"],
            false=false,
            found=found,
            right=found and not false,
            strong=truth.added >= max(2 * truth.misfit, best),
            inside=_inside(world.cause, d["effects"], truth.values),
            after_over_best=reached / best,
            difference_error=off,
            usable=bool(d["usable"]),
            energy_error=energies,
            usable_by_difference=bool(d["usable"]) == (off <= TOLERANCE),
            usable_right=bool(d["usable"]) == (off <= TOLERANCE and energies <= ENERGY),
            contradictions=wrong,
            headline=d["headline"],
        )
    return row


def _inside(cause: str, effects: list[dict[str, Any]], values: dict[str, list[float]]) -> list[bool]:
    """For every number of the true cause, where it is named: is it within the stated 95 % interval?"""
    out = []
    for row in effects:
        for name, true in values.items():
            if row["name"] == cause and row["ci95"].get(name) is not None:
                ends = np.atleast_2d(np.asarray(row["ci95"][name], dtype=float))
                out += [bool(a <= x <= b) for x, (a, b) in zip(true, ends, strict=False)]
    return out


def upper(hits: int, count: int) -> float:
    """Upper bound of a rate of which `hits` of `count` were seen (Clopper and Pearson)."""
    return 1.0 if hits >= count else float(beta.ppf(STATED, hits + 1, count - hits))


def lower(hits: int, count: int) -> float:
    """Lower bound of such a rate."""
    return 1 - upper(count - hits, count)


Line = tuple[str, str, str, bool]


def at_most(what: str, hits: list[bool], most: float) -> list[Line]:
    """A line of the table for a rate that must be small."""
    if not hits:
        return []
    count, bad = len(hits), sum(hits)
    reached = f"{bad} of {count} ({100 * bad / count:.1f} %), below {100 * upper(bad, count):.1f} %"
    return [(what, f"<= {100 * most:g} %", reached, bad <= most * count)]


def at_least(what: str, hits: list[bool], least: float) -> list[Line]:
    """A line of the table for a rate that must be large."""
    if not hits:
        return []
    count, good = len(hits), sum(hits)
    reached = f"{good} of {count} ({100 * good / count:.1f} %), above {100 * lower(good, count):.1f} %"
    return [(what, f">= {100 * least:g} %", reached, good >= least * count)]


def lines(rows: list[dict[str, Any]]) -> list[Line]:
    """The table: what is measured, what it must be, what it is, whether that holds."""
    by: dict[str, list[dict[str, Any]]] = {kind: [r for r in rows if r["category"] == kind] for kind in COUNTS}
    wild = by["unlisted"] + by["mixed"]
    explained = [r for r in wild if r["verdict"] == "explained"]
    inside = [x for r in rows for x in r.get("inside", [])]
    out = at_most("unlisted laws: sets with a false cause", [bool(r["false"]) for r in wild], 0.02)
    out += at_most(
        f"unlisted laws: of `explained`, error above {LEFT} x the best",
        [r["after_over_best"] > LEFT for r in explained],
        0.05,
    )
    for kind, what, least in (
        ("listed", "listed causes, links off, coloured noise: found and nothing false", 0.97),
        ("exact", "listed causes, clean measurements: the same", 0.98),
    ):
        out += at_least(what, [r["right"] for r in by[kind] if r.get("strong", True)], least)
    out += at_most("clean arms: sets with a false cause", [bool(r["false"]) for r in by["clean"]], 0.01)
    if inside:
        share = float(np.mean(inside))
        reached = f"{100 * share:.1f} % of {len(inside)}"
        out.append(("true numbers inside their stated 95 % interval", "93-97 %", reached, 0.93 <= share <= 0.97))
    out += at_most("documents that contradict themselves", [bool(r["contradictions"]) for r in rows], 0.0)
    for key, what in (
        ("usable_by_difference", "differences of energy elsewhere"),
        ("usable_right", "these differences and energies held out"),
    ):
        out += at_least(f"`usable` right about {what}", [r[key] for r in rows if key in r], 0.9)
    return out


def main() -> int:
    """Run the benchmark; exit code 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("examined.json"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--share", type=float, default=1.0, help="of the number of sets")
    parser.add_argument("--only", default=",".join(COUNTS), help="kinds of sets, with commas between")
    parser.add_argument("--small", action="store_true", help="a few sets of each kind; no target is judged")
    parser.add_argument("--more", action="store_true", help="other unlisted laws")
    parser.add_argument("--sharp", action="store_true", help="motions whose acceleration jumps")
    args = parser.parse_args()
    laws = MORE_KINDS if args.more else KINDS
    counts = SMALL if args.small else {kind: max(1, round(args.share * COUNTS[kind])) for kind in COUNTS}
    asked = [(kind, world) for kind in args.only.split(",") for world in worlds(kind, counts[kind], args.seed, laws)]
    asked = [(kind, replace(world, sharp=args.sharp)) for kind, world in asked]
    wanted = {world.seed for _, world in asked}
    kept = json.loads(args.out.read_text())["rows"] if args.out.is_file() else []
    rows = [row for row in kept if row["seed"] in wanted]
    done = {row["seed"] for row in rows}
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(run, [job for job in asked if job[1].seed not in done]):
            rows.append(row)
            what = " ".join(filter(None, (row["category"], row["arm"], row["noise"], row["unlisted"], row["cause"])))
            left = f"{row['after_over_best']:.2f} x best" if "after_over_best" in row else row["error"]
            flags = [f"FALSE {row['false']}"] * bool(row["false"]) + row["contradictions"]
            flags += [f"usable {row.get('usable')}, off by {row.get('difference_error', np.nan):.2f}"] * (
                not row.get("usable_right", True)
            )
            took = f"{row.get('seconds', 0):.1f} s"
            print(what, "->", row["verdict"], "+".join(row["named"]) or "-", left, *flags, took, sep="  ", flush=True)
            write_json(args.out, {"rows": rows})
    told = lines(rows)
    print("\n" + table(("", "must", "is"), [line[:3] for line in told]))
    seconds = [row["seconds"] for row in rows if "seconds" in row]
    print(f"processor time of a diagnosis, median: {np.median(seconds) if seconds else float('nan'):.1f} s")
    checks = {f"{what}: {now}": held for what, _, now, held in told}
    return finish({}, {"no crash": all("error" not in r for r in rows)} if args.small else checks, None)


if __name__ == "__main__":
    sys.exit(main())
