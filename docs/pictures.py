"""The pictures of the documentation, made by the commands that the pages show: python docs/pictures.py [NAME...]."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import energy_opt as eo
from energy_opt.batches.records import read_parquet
from energy_opt.cli.main import main
from energy_opt.tables import read_table

START, GOAL = "0,-0.785,0,-2.356,0,1.571,0.785", "1.2,0.3,0.4,-1.2,-0.5,2.2,-0.4"
ENDS = ["--robot", "panda", "--start", START, "--goal", GOAL]
PLANT = """format = "energy-opt/model/1"
robot = "ur5e"
effect = [
    { name = "standby", power = 90.0 },
    { name = "copper_loss", r_over_kt2 = 0.004 },
    { name = "coulomb_friction", tau_c = [4.0, 4.5, 3.0, 0.8, 0.7, 0.6] },
]
"""


def run(*words: str) -> None:
    """A command, which must succeed."""
    if main([*words, "--quiet", "--force"]):
        raise SystemExit(f"failed: {' '.join(words)}")


def optimize(out: Path, work: Path) -> None:
    """Joint speeds and power of a reshaped move, beside the evenly slowed one."""
    run("optimize", *ends_of("panda"), "--duration", "2", "--out", str(work / "move"))
    (out / "optimize.png").write_bytes((work / "move/plot.png").read_bytes())


def ends_of(robot: str) -> list[str]:
    """Words that name a move of a robot."""
    return (
        ENDS
        if robot == "panda"
        else ["--robot", robot, "--start", "0,-1.2,1.2,-1.5,-1.5,0", "--goal", "1.4,-1.9,0.6,-0.5,1,1"]
    )


def tradeoff(out: Path, work: Path) -> None:
    """Energy against duration."""
    run("tradeoff", *ENDS, "--mode", "retime", "--cycle", "4", "--out", str(work / "front"))
    (out / "tradeoff.png").write_bytes((work / "front/plot.png").read_bytes())


def bench(out: Path, work: Path) -> None:
    """Loss saved by retiming, robot by robot."""
    suite = work / "suite.toml"
    suite.write_text(
        'format = "energy-opt/suite/1"\nname = "arms"\nrobots = ["panda", "ur5", "ur5e", "z1", "xarm7"]\n'
        'modes = ["retime"]\nrandom = { count = 12, seed = 1, range = 0.6 }\n'
    )
    run("bench", str(suite), "--jobs", "2", "--out", str(work / "bench"))
    rows = read_parquet(work / "bench/results.parquet")
    robots = list(dict.fromkeys(row["robot"] for row in rows))
    figure, at = plt.subplots(figsize=(7, 3.2), layout="constrained")
    saved = [
        [r["saving_loss_percent"] for r in rows if r["robot"] == name and r["status"] == "solved"] for name in robots
    ]
    at.boxplot(saved, tick_labels=robots)
    at.set(ylabel="loss saved [%]", title="retimed moves against the same path slowed evenly, 1.5 x the minimum time")
    figure.savefig(out / "bench.png", dpi=110)


def measured(out: Path, work: Path) -> None:
    """A virtual arm with dry friction: what it logs, what the declared model lacks, the two methods."""
    (work / "plant.toml").write_text(PLANT)
    files = []
    for number, mode in enumerate(("retime", "reshape"), start=1):
        run("optimize", *ends_of("ur5e"), "--mode", mode, "--duration", "3", "--out", str(work / f"m{number}"))
        files.append(str(work / f"m{number}/trajectory.csv"))
    run(
        "simulate",
        *files,
        "--plant",
        str(work / "plant.toml"),
        "--repeat",
        "3",
        "--static",
        "4",
        "--out",
        str(work / "set"),
    )
    declared = eo.PowerModel("ur5e", (eo.Standby(power=90.0), eo.CopperLoss(r_over_kt2=0.004)))
    found = eo.diagnose(work / "set", declared)
    figure, axes = plt.subplots(2, 1, figsize=(7, 4.6), layout="constrained", sharex=True)
    first = next(p for p in sorted((work / "set").glob("run*.csv")) if _moves(p))
    table = read_table(first)
    for name, values in table.items():
        if name.endswith(".position"):
            axes[0].plot(table["time"], values, label=name.removesuffix(".position"))
    axes[0].set(ylabel="position [rad]", title=f"{first.name}: a motion on the virtual arm")
    axes[0].legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
    axes[1].plot(table["time"], table["power"], color="0.4", lw=0.8)
    axes[1].set(xlabel="time [s]", ylabel="power [W]")
    figure.savefig(out / "simulate.png", dpi=110)

    from energy_opt.diagnosis.data.predict import predict

    s = found.samples
    rows = s.slices[next(k for k, kind in enumerate(s.kinds) if kind == "motion")]
    figure, at = plt.subplots(figsize=(7, 3.2), layout="constrained")
    at.plot(s.t[rows], s.power[rows], ".", color="0.6", ms=3, label="measured")
    at.plot(s.t[rows], predict(declared, s).reading[rows], color="tab:orange", label="declared model")
    at.plot(s.t[rows], predict(found.model, s).reading[rows], color="tab:blue", label="with the effect that was found")
    names = ", ".join(row["name"] for row in found.document()["effects"])
    at.set(xlabel="time [s]", ylabel="power [W]", title=f"verdict: {found.document()['verdict']}; found: {names}")
    at.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.savefig(out / "diagnose.png", dpi=110)


def _moves(path: Path) -> bool:
    return any(np.ptp(values) > 0.1 for name, values in read_table(path).items() if name.endswith(".position"))


def identify(out: Path, work: Path) -> None:
    """Static power over squared gravity torque, from poses of a virtual Panda."""
    from virtual_sets import make_set

    from energy_opt.virtual_arm.simulate import Instruments

    made = make_set(
        work / "static", "panda", [], seed=5, weak="static_only", poses=8, instruments=Instruments(noise=0.8)
    )
    run("identify", str(made.folder), "--out", str(work / "identified"))
    (out / "identify.png").write_bytes((work / "identified/plot.png").read_bytes())


if __name__ == "__main__":
    target = Path(__file__).parent / "pictures"
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for make in (optimize, tradeoff, bench, measured, identify):
            if not sys.argv[1:] or make.__name__ in sys.argv[1:]:
                make(target, Path(folder))
