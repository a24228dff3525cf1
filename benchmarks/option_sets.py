"""Random option sets of all verbs that plan, run as a user runs them, and judged by an evaluator that shares no code.

    python benchmarks/option_sets.py --count 1000 --out option_sets.jsonl [--first 0] [--jobs 1]

Every set is decided by its number alone. What is in the file is not run again, so a run that was stopped goes on. The
command's own word is no evidence: the files are judged (see option_judge.py), a shortest duration that is named is
asked for (that, 1.01 and 1.05 times it), and a set that takes more than a minute of CPU is a finding.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from option_judge import Robot, faults_of_files, judge, judge_batch, judge_cycle, judge_front

ROBOTS = ("panda", "ur5e", "ur5", "xarm7", "ur10e", "kinova", "z1")
FORMATS = ("csv", "yaml", "json", "mcap", "follow-joint-trajectory")
ROOT = Path(__file__).resolve().parents[1]
LONGEST = 60.0  # [s] of CPU
SLOWED = "cost less than the evenly slowed move, which is written instead"
KEPT = "--as moves with --mode retime keeps the straight line"
FOLLOWED = "--as moves cannot follow a given path"


def run(words: Sequence[str], folder: Path) -> tuple[int, str, str, float]:
    """Exit code, stdout, stderr and CPU time [s] of the command."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with (folder / "stdout").open("w+") as stdout, (folder / "stderr").open("w+") as stderr:
        child = subprocess.Popen(
            [sys.executable, "-m", "energy_opt", *words], stdout=stdout, stderr=stderr, cwd=folder, env=environment,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (int(3 * LONGEST), int(3 * LONGEST) + 5)),
        )  # fmt: skip
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        stdout.seek(0)
        stderr.seek(0)
        return child.returncode, stdout.read(), stderr.read(), used.ru_utime + used.ru_stime


@cache
def robot_of(name: str) -> Robot:
    """An arm as the command states it."""
    with tempfile.TemporaryDirectory() as folder:
        return Robot(json.loads(run(("robots", name, "--json"), Path(folder))[1])["robots"][0])


def free_pose(robot: Robot, rng: np.random.Generator, scene: list[dict[str, Any]], floor: float | None) -> np.ndarray:
    """A pose within half of each joint's range that touches nothing, nor does anything near it."""
    low, high = (np.clip(robot.bounds[key], -np.pi, np.pi) for key in ("lower", "upper"))
    for _ in range(500):
        q = (low + high) / 2 + rng.uniform(-0.5, 0.5, robot.n) * (high - low) / 2 * 1.2
        near = q + rng.normal(size=(6, robot.n)) * 0.03
        if robot.touching(np.vstack([q, near]), scene, floor) is None:
            return np.round(q, 6)
    raise RuntimeError(f"{robot.name}: no free pose")


def words_of(q: np.ndarray) -> str:
    return ",".join(f"{x:.6f}" for x in q)


def option_set(number: int, folder: Path) -> tuple[Robot, dict[str, Any], list[str]]:
    """The option set of a number: robot, what is asked, and the command's words; its files go into `folder`."""
    rng = np.random.default_rng([17, number])

    def chance(share: float) -> bool:
        return bool(rng.random() < share)

    robot = robot_of(str(rng.choice(ROBOTS)))
    verb = str(rng.choice(["optimize", "tradeoff", "job", "bench"], p=[0.76, 0.08, 0.08, 0.08]))
    floor = float(np.round(rng.uniform(-0.6, -0.05), 3)) if chance(0.3) else None
    scene: list[dict[str, Any]] = []
    if chance(0.25):
        for k in range(int(rng.integers(1, 4))):
            angle, far = rng.uniform(0, 2 * np.pi), rng.uniform(0.45, 0.9)
            at = [round(float(x), 3) for x in (far * np.cos(angle), far * np.sin(angle), rng.uniform(0.1, 0.9))]
            shape = {"type": "box", "size": [0.1, 0.15, 0.2]} if chance(0.5) else {"type": "sphere", "radius": 0.08}
            scene.append({"name": f"thing{k}", **shape, "position": at})
        (folder / "scene.yaml").write_text(yaml.safe_dump({"objects": scene}))
    start = free_pose(robot, rng, scene, floor)
    goal = free_pose(robot, rng, scene, floor)
    goal = np.round(start + (goal - start) * rng.uniform(0.3, 1.0), 6)
    if robot.touching(goal[None], scene, floor) is not None or chance(0.1):
        goal = np.round(start + rng.uniform(-0.15, 0.15, robot.n), 6)
    asked: dict[str, Any] = {
        "verb": verb,
        "start": start.tolist(),
        "goal": goal.tolist(),
        "floor": floor,
        "scene": scene,
    }
    words = ["--robot", robot.name]
    if floor is not None:
        words += ["--floor", str(floor)]
    if scene:
        words += ["--scene", "scene.yaml"]
    if chance(0.35):
        payload = [round(float(rng.uniform(0.1, 1.5)), 3), *(round(float(x), 3) for x in rng.uniform(-0.05, 0.1, 3))]
        asked["payload"] = payload
        words += ["--payload", ",".join(map(str, payload))]
    if chance(0.5):
        words += ["--model", str(rng.choice(["source-method-2", "careful", "source-method-1"], p=[0.7, 0.2, 0.1]))]
    if chance(0.08):
        asked["own"] = False
        words += ["--self-collision", "off"]
    if chance(0.15):
        words += ["--seed", str(int(rng.integers(1, 99)))]
    if verb == "job":
        return robot, asked, ["job", str(_job(robot, asked, rng, folder)), *words[2:]]
    if verb == "bench":
        return robot, asked, ["bench", str(_suite(robot, asked, rng, folder))]
    mode = str(rng.choice(["reshape", "retime"], p=[0.6, 0.4]))
    path = verb == "optimize" and chance(0.15)
    if path:
        header = ",".join(f"{joint}.position" for joint in robot.joints)
        (folder / "path.csv").write_text("\n".join([header, words_of(start), words_of(goal)]) + "\n")
        words += ["--path", "path.csv"]
        if mode == "reshape" and chance(0.6):
            asked["tube"] = "0.1rad" if chance(0.5) else "0.05m"
            words += ["--tube", asked["tube"]]
    else:
        words += ["--start", words_of(start), "--goal", words_of(goal)]
    words += ["--mode", mode]
    if verb == "tradeoff":
        count = int(rng.integers(2, 4))
        asked["durations"] = np.linspace(2, 5, count).tolist()
        return robot, asked, ["tradeoff", *words, "--durations", f"2:5:{count}"]
    if mode == "reshape" and not path and chance(0.12):
        via = np.round((start + goal) / 2 + rng.uniform(-0.08, 0.08, robot.n), 6)
        if robot.touching(via[None], scene, floor) is None:
            asked["via"] = [via.tolist()]
            words += ["--via", words_of(via)]
    kind = str(rng.choice(["free", "exact", "most"], p=[0.45, 0.35, 0.2]))
    if kind != "free":
        asked["duration" if kind == "exact" else "max_duration"] = time = round(float(rng.uniform(0.6, 5.0)), 3)
        words += ["--duration" if kind == "exact" else "--max-duration", str(time)]
    if chance(0.12):
        asked["max_power"] = round(float(rng.uniform(120, 500)), 1)
        words += ["--max-power", str(asked["max_power"])]
    if chance(0.12):
        asked["tool_speed"] = round(float(rng.uniform(0.2, 1.5)), 3)
        words += ["--tool-speed", str(asked["tool_speed"])]
    if chance(0.08):
        asked["tool_acceleration"] = round(float(rng.uniform(1.0, 8.0)), 3)
        words += ["--tool-acceleration", str(asked["tool_acceleration"])]
    if mode == "reshape" and not path and chance(0.1):
        asked["keep"] = [str(rng.choice(["upright:30", "orientation:40", "line:60"]))]
        words += ["--keep", asked["keep"][0]]
    for name in rng.choice(FORMATS, size=int(rng.integers(0, 3)), replace=False):
        words += ["--write", str(name)]
    if robot.name == "panda" and chance(0.25):
        words += ["--write", "franka"]
    if robot.name.startswith("ur") and chance(0.25):
        words += ["--write", "urscript"]
    if "--write" in words and chance(0.2):
        words += ["--rate", str(rng.choice([125, 250, 500]))]
    if chance(0.06) and not {"via", "keep", "tube"} & set(asked):
        words += ["--as", "moves", *(["--vias", "1"] if chance(0.5) else [])]
        asked["moves"] = True
    if chance(0.05):
        objective = str(rng.choice(["time", "torque", "path_length"]))
        if objective == "time" or (mode == "reshape" and kind == "exact"):  # the others are refused elsewhere
            words += ["--objective", objective]
    if chance(0.08):
        words += ["--end-acceleration", "free"] if mode == "reshape" else ["--verify-samples", "5000"]
    return robot, asked, ["optimize", *words]


def _job(robot: Robot, asked: dict[str, Any], rng: np.random.Generator, folder: Path) -> Path:
    """A cycle of two moves and a wait."""
    home, there = ([float(x) for x in asked[key]] for key in ("start", "goal"))
    between = [round(float((a + b) / 2), 6) for a, b in zip(home, there, strict=True)]
    stop = "" if rng.random() < 0.5 else f"[[step]]\nto = {between}\nstop = false\n"
    cycle = round(float(rng.uniform(6, 14)), 3)
    asked |= {"cycle_time": cycle, "wait": 0.4, "passes": [*([between] if stop else []), there]}
    text = f'format = "energy-opt/job/1"\nrobot = "{robot.name}"\ncycle_time = {cycle:.3f}\nhome = {home}\n'
    text += f"{stop}[[step]]\nto = {there}\n[[step]]\nwait = 0.4\n[[step]]\nto = {home}\n"
    (folder / "job.toml").write_text(text)
    return folder / "job.toml"


def _suite(robot: Robot, asked: dict[str, Any], rng: np.random.Generator, folder: Path) -> Path:
    """A batch of one move in two modes."""
    text = f'format = "energy-opt/suite/1"\nname = "x"\nrobots = ["{robot.name}"]\nmodes = ["retime", "reshape"]\n'
    text += f'durations = ["{rng.uniform(1.2, 2.5):.2f}x"]\nmodels = ["source-method-2"]\n'
    text += f'[[moves]]\nname = "a"\nstart = {asked["start"]}\ngoal = {asked["goal"]}\n'
    (folder / "suite.toml").write_text(text)
    return folder / "suite.toml"


def examined(number: int) -> dict[str, Any]:
    """One option set, run and judged."""
    folder = Path(tempfile.mkdtemp(prefix="option-set-"))
    try:
        robot, asked, words = option_set(number, folder)
        out = folder / "out"
        code, said, complaint, cpu = run([*words, "--out", str(out), "--json", "--quiet"], folder)
        row = {"number": number, "command": " ".join(words), "asked": asked, "code": code, "cpu": round(cpu, 2)}
        faults = _of_words(code, said, complaint)
        document = json.loads(said) if said.startswith("{") else {}
        row["status"] = document.get("status", {0: "solved", 3: "infeasible"}.get(code, "failed"))
        row["message"] = document.get("message", "")
        if not faults and words[0] == "optimize":
            faults += _of_move(robot, asked, words, code, document, out, folder)
        elif not faults and code == 0:
            faults += {"job": judge_cycle, "tradeoff": judge_front}.get(words[0], _of_batch)(robot, asked, out)
        elif not faults and code == 4:
            faults.append(f"not converged: {row['message'][:200]}")
        if cpu > LONGEST:
            faults.append(f"takes {cpu:.0f} s of CPU")
        return {**row, "faults": faults}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _of_batch(robot: Robot, asked: dict[str, Any], out: Path) -> list[str]:
    return judge_batch(out)


def _of_words(code: int, said: str, complaint: str) -> list[str]:
    """What is wrong with what the command says, whatever it is about."""
    faults = [f"says: {mark}" for mark in ("Traceback", "fault of the program", "Warning:") if mark in complaint]
    if code not in (0, 2, 3, 4):
        faults.append(f"exit code {code}: {complaint[-300:]}")
    try:
        json.loads(said)
    except ValueError:
        faults.append(f"stdout is no document: {said[:80]!r}")
    return faults


def _of_move(
    robot: Robot, asked: dict[str, Any], words: list[str], code: int, document: dict[str, Any], out: Path, folder: Path
) -> list[str]:
    message = document.get("message", "")
    if code == 0 or (code == 4 and SLOWED in message):  # standard moves that save nothing are never the answer
        return judge(robot, asked, out)
    if code == 4:
        return [f"not converged: {message[:200]}"]
    if code == 2 and "--path" in words and FOLLOWED in message:
        return []
    if code == 2 and "--vias" in words and "retime" in words and KEPT in message:
        return []
    if code == 2:
        return [f"refused: {document['message'][:300]}"]
    faults = faults_of_files(out) if (out / "result.json").is_file() else []
    shortest = document.get("shortest_duration")
    if shortest is None:
        return faults
    if "--duration" in words or "--max-duration" in words:
        option = "--duration" if "--duration" in words else "--max-duration"
        at = words.index(option)
        for share in (1.0, 1.01, 1.05):
            longer = [*words[:at], "--duration", repr(shortest * share), *words[at + 2 :]]
            again = run([*longer, "--out", str(folder / f"again{share}"), "--json", "--quiet"], folder)
            if again[0] != 0:
                said = json.loads(again[1]).get("message", "")[:160] if again[1].startswith("{") else again[2][-160:]
                faults.append(f"named as shortest {shortest:g} s, at {share:g} times it exit {again[0]}: {said}")
                break
    return faults


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """How many were answered rightly, and every one that was not."""
    bad = [row for row in rows if row["faults"]]
    kinds: Counter[str] = Counter()
    for row in rows:
        kinds.update(row["status"] if isinstance(row["status"], dict) else [row["status"]])  # a batch: a count for each
    lines = [f"{len(rows)} option sets: {', '.join(f'{kind} {count}' for kind, count in sorted(kinds.items()))}"]
    lines += [f"  {row['number']}: {'; '.join(row['faults'])[:400]}" for row in bad]
    cpu = sorted(row["cpu"] for row in rows) or [0.0]
    lines.append(f"CPU per set: median {cpu[len(cpu) // 2]:.1f} s, most {cpu[-1]:.1f} s")
    lines.append(f"answered rightly: {len(rows) - len(bad)} of {len(rows)} ({100 * (1 - len(bad) / len(rows)):.2f} %)")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is left; 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("option_sets.jsonl"))
    args = parser.parse_args(arguments)
    lines = args.out.read_text().splitlines() if args.out.is_file() else []
    rows = {row["number"]: row for row in map(json.loads, lines)}
    wanted = range(args.first, args.first + args.count)
    with ThreadPoolExecutor(args.jobs) as pool, args.out.open("a") as stream:
        for row in pool.map(examined, [k for k in wanted if k not in rows]):
            rows[row["number"]] = row
            stream.write(json.dumps(row) + "\n")
            stream.flush()
    chosen = [rows[k] for k in wanted]
    print(summary(chosen))
    return int(any(row["faults"] for row in chosen))


if __name__ == "__main__":
    sys.exit(main())
