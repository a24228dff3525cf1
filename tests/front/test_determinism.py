"""The same question has the same answer, to the byte: whatever ran before, beside it, or is kept in caches."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import energy_opt as eo
from energy_opt import dynamics
from energy_opt.batches.batch import run_batch
from energy_opt.batches.suite import load_suite
from energy_opt.dynamics import compact
from energy_opt.errors import BadInput
from energy_opt.numerics.library import compiler
from energy_opt.robot import Link

A = np.array([0, 1, -1, 0, 0, 0.0]), np.array([1, 1.5, -1.5, 0.2, 0.3, 0.4])
B = np.array([-1, 0.5, -1, 0.3, 0, 0.0]), np.array([1, 1.2, -0.5, 0.2, -0.3, 0.4])
CLOCKED = {"build_seconds", "solve_seconds"}  # what a row holds of time spent
SAME = 1e-6  # with and without the compiler


def planner(compile: str = "never") -> eo.Planner:
    robot = eo.load_robot("z1")
    return eo.Planner(robot, eo.source_model(robot), eo.Settings(starts=2, compile=compile))


def digest(result: eo.Result) -> str:
    t = result.trajectory
    rows = np.column_stack([t.time, t.position, t.velocity, t.acceleration])
    return hashlib.sha256(rows.tobytes()).hexdigest()


@pytest.mark.parametrize("mode", ["retime", "reshape"])
def test_results_do_not_depend_on_earlier_or_parallel_runs(mode: str) -> None:
    move, other = eo.Move(*A, mode, duration=1.5), eo.Move(*B, mode, duration=1.8)
    later = planner()
    later.solve(other)
    answers = [digest(later.solve(move))]
    with ThreadPoolExecutor(2) as pool:
        beside = [pool.submit(planner().solve, asked) for asked in (move, other, move)]
        answers += [digest(beside[k].result()) for k in (0, 2)]
    assert len(set(answers)) == 1


@pytest.mark.slow
def test_results_do_not_depend_on_threads_hashes_or_caches(tmp_path: Path) -> None:
    (tmp_path / "post.yaml").write_text(
        "objects:\n- {name: post, type: box, size: [0.06, 0.06, 0.8], position: [0.3, 0.0, 0.4]}\n"
    )
    ends = ["--start", "-0.8,1.2,-1,0,0,0", "--goal", "0.8,1.2,-1,0.2,0.3,0.4", "--duration", "3"]
    words = ["optimize", "--robot", "z1", *ends, "--scene", str(tmp_path / "post.yaml"), "--starts", "2", "--quiet"]
    found = {}
    for k, more in enumerate(("1", "2", "7")):
        around = {"PYTHONHASHSEED": more, "OMP_NUM_THREADS": more, "OPENBLAS_NUM_THREADS": more, "ENERGY_OPT_CACHE": ""}
        around["ENERGY_OPT_CACHE"] = str(tmp_path / f"cache{k % 2}")  # the third run finds what the first has left
        out = tmp_path / more
        run = [sys.executable, "-m", "energy_opt", *words, "--compile", "never", "--out", str(out)]
        subprocess.run(run, check=True, env=os.environ | around, timeout=300)
        assert not json.loads((out / "result.json").read_text())["solver"]["compiled"]
        found[more] = hashlib.sha256((out / "trajectory.csv").read_bytes()).hexdigest()
    assert found["1"] == found["2"] == found["7"]


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_compiler_changes_nothing_that_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENERGY_OPT_CACHE", str(tmp_path / "cache"))
    for mode in ("retime", "reshape"):
        move = eo.Move(*A, mode, duration=1.5)
        plain, compiled, again = (planner(policy).solve(move) for policy in ("never", "always", "always"))
        assert not plain.solver.compiled and digest(compiled) == digest(again)
        assert compiled.solver.compiled == (mode == "reshape")
        assert compiled.energy.loss == pytest.approx(plain.energy.loss, rel=SAME)
        assert np.abs(compiled.trajectory.position - plain.trajectory.position).max() < SAME


def lagrange(tree: list[Link]) -> ca.Function:
    """The torque as sum of what acceleration, speed and gravity ask for: the same law by another, longer graph."""
    own = compact.torque_function(tree)
    q, v, a, gravity, mass, com = (ca.SX.sym(own.name_in(k), *own.size_in(k)) for k in range(6))
    rest, unit = ca.SX.zeros(len(tree)), ca.SX.eye(len(tree))
    inertia = [own(q, rest, unit[:, j], ca.SX.zeros(3), mass, com) * a[j] for j in range(len(tree))]
    tau = own(q, v, rest, ca.SX.zeros(3), mass, com) + sum(inertia) + own(q, rest, rest, gravity, mass, com)
    return ca.Function("tau", [q, v, a, gravity, mass, com], [tau])


@pytest.mark.parametrize("source", ["lagrange", "pinocchio"])
def test_the_source_of_the_graph_changes_nothing_that_counts(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sources round differently; Pinocchio's own is compared with ours if it is installed."""
    robot = eo.load_robot("z1")
    if source == "lagrange":
        monkeypatch.setitem(dynamics._BUILDERS, "pinocchio", lambda body: lagrange(body.tree()))
        source = "pinocchio"
    try:
        dynamics.torque_function(robot.body, source)
    except BadInput as error:
        pytest.skip(str(error))
    found = []
    for own in ("compact", source):
        settings = eo.Settings(starts=2, compile="never", dynamics=own)
        found.append(eo.Planner(robot, eo.source_model(robot), settings).solve(eo.Move(*A, "reshape", duration=1.5)))
    assert found[1].energy.loss == pytest.approx(found[0].energy.loss, rel=SAME)
    apart = np.abs(found[1].trajectory.position - found[0].trajectory.position).max()
    assert 0 < apart < SAME


@pytest.mark.slow
def test_jobs_change_no_number(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["z1"]\nmodes = ["retime", "reshape"]\n'
        'durations = ["1.5x"]\nmodels = ["source_method_2"]\nrandom = { count = 3, seed = 5 }\n'
        "settings = { starts = 2 }\n"
    )
    suite = load_suite(tmp_path / "s.toml", compile="never")
    one, two = (run_batch(suite, tmp_path / f"jobs{jobs}", jobs=jobs).records for jobs in (1, 2))
    for a, b in zip(one, two, strict=True):
        assert a["status"] == "solved"
        assert {k: v for k, v in a.items() if k not in CLOCKED} == {k: v for k, v in b.items() if k not in CLOCKED}
