"""Fronts of real moves, from Python and on the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from poses import GOAL, MIDDLE, START

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.front.tradeoff import durations_of
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.path import through
from energy_opt.power import source_method_2
from energy_opt.requests.moves import TradeoffRequest
from energy_opt.tradeoffs.front import trace


def test_convex_retiming_gives_a_convex_front(panda):
    """E(T) on one path, by the program's own choice of durations; second differences never below the solver's noise."""
    move = Move(START, GOAL, mode="retime")
    planner = Planner(panda, source_method_2(), Settings(compile="never"))
    fastest = planner.minimum_time(move)
    durations = np.linspace(1.02 * fastest, 2 * fastest, 7)
    front = trace(planner, move, durations=durations)
    assert [p.status for p in front.points] == ["solved"] * 7
    energy = np.array([p.total for p in front.points])
    assert np.diff(energy, 2).min() > -2e-5 * energy.max()
    assert front.minimum.total <= energy.min() * (1 + 1e-6)
    assert front.fastest.duration == pytest.approx(fastest, rel=1e-9)


def test_reshaped_front_has_no_bumps_and_beats_the_retimed_one(panda):
    planner = Planner(panda, source_method_2(), Settings(compile="never", starts=2))
    durations = [0.5, 0.9, 1.2, 1.6]
    reshaped = trace(planner, Move(START, GOAL, mode="reshape"), durations=durations)
    retimed = trace(planner, Move(START, GOAL, mode="retime"), durations=durations)
    assert [p.status for p in reshaped.points] == ["infeasible", "solved", "solved", "solved"]
    assert reshaped.fastest.duration < retimed.fastest.duration
    for a, b in zip(reshaped.points[1:], retimed.points[1:], strict=True):
        assert planner.certify(a.trajectory).valid
        assert a.trajectory.duration == pytest.approx(a.duration, rel=1e-12)
        assert planner.score(a.trajectory).total == pytest.approx(a.total, rel=1e-12)
        assert a.energy.loss < b.energy.loss
    assert reshaped.minimum.total <= min(p.total for p in reshaped.points) * (1 + 1e-6)


def test_a_front_finds_what_single_moves_find(panda):
    """One search for both: at 2 s the front once stood half above, and other durations beside it changed a point."""
    planner = Planner(panda, source_method_2(), Settings(compile="never", controls=20, starts=4))
    move = Move(START, GOAL, mode="reshape")
    alone = trace(planner, move, durations=[2.0])
    among = trace(planner, move, durations=[1.4, 2.0])
    single = planner.solve(Move(START, GOAL, mode="reshape", duration=2.0)).energy.loss
    assert alone.points[0].energy.loss <= single * (1 + 1e-9)
    assert among.points[1].energy.loss <= single * (1 + 1e-6)  # continued, to the solver's tolerance
    assert among.points[1].energy.loss == pytest.approx(alone.points[0].energy.loss, rel=2e-3)


@pytest.mark.parametrize(("given", "durations"), [(False, [1.5, 2.0]), (True, [1.5])])
def test_a_front_that_keeps_clear_finds_what_single_moves_find(panda, given, durations):
    """It once went on from neighbours alone where the arm's own body is in the way, and stood 1 % above at 1.5 s."""
    settings = Settings(compile="never", controls=16, starts=1)
    planner = Planner(panda, source_method_2(), settings, cell=load_cell(panda, CellRequest()))
    path = through(np.stack([START, MIDDLE, GOAL])) if given else None
    front = trace(planner, Move(START, GOAL, path=path), durations=durations)
    for point in front.points:
        single = planner.solve(Move(START, GOAL, path=path, duration=point.duration))
        assert point.status == single.status == "solved"
        assert point.total <= single.energy.total * (1 + 1e-6)
        assert planner.certify(point.trajectory).clearance.proven


def command(*words):
    return [*words, "--robot", "panda", "--start", "0,-0.785,0,-2.356,0,1.571,0.785", "--quiet", "--mode", "retime"]


def test_command_line(tmp_path, capsys):
    goal = ["--goal", "0.4,-0.5,0.2,-2,0,1.6,0.5", "--out", str(tmp_path)]
    code = main(
        command("tradeoff", *goal, "--durations", "0.3:1.5:4", "--cycle", "1.5", "--idle-power", "20", "--json")
    )
    found = json.loads(capsys.readouterr().out)
    assert code == 0
    assert found == json.loads((tmp_path / "tradeoff.json").read_text())
    assert [p["status"] for p in found["points"]] == ["infeasible", "solved", "solved", "solved"]
    assert found["assumptions"] and "Values that were not given" in (tmp_path / "report.html").read_text()
    assert found["break_even_friction"] is None or 0 < found["break_even_friction"] < 0.2
    assert {row["joint"] for row in found["travel"]} <= set(found["joints"])
    least, at_free = (found["cycle"][key]["energy_robust"] for key in ("minimum", "at_free_minimum"))
    assert least <= at_free * (1 + 1e-9)
    header, *rows = (tmp_path / "tradeoff.csv").read_text().splitlines()
    assert header == "duration,energy_total,energy_standby,energy_loss,status"
    assert [row.split(",")[-1] for row in rows] == [p["status"] for p in found["points"]]
    assert (tmp_path / "plot.png").is_file()


def test_a_list_of_durations_is_checked(panda):
    """A word had ended in an error of Python; NaN and durations below 0 had been planned."""
    with pytest.raises(BadInput, match="durations: an empty list; give at least one"):
        TradeoffRequest(panda, durations=[])
    for durations in ([1.0, "a"], [1.0, -2.0], [1.0, float("nan")], [[1.0], [1.0, 2.0]]):
        with pytest.raises(
            BadInput, match=r"durations .*: expected FIRST:LAST:COUNT, or a list of durations above 0 s"
        ):
            durations_of(TradeoffRequest(panda, durations=durations))
    assert durations_of(TradeoffRequest(panda, durations=np.arange(1, 3))) == [1.0, 2.0]


@pytest.mark.parametrize(
    ("words", "code", "named"),
    [
        (["--durations", "1:2"], 2, "FIRST:LAST:COUNT"),
        (["--durations", "2:1:5"], 2, "FIRST:LAST:COUNT"),
        (["--durations", "1:3:1"], 2, "a count of at least 2"),
        (["--duration", "free"], 2, "argument --duration: 'free': expected a number"),
        (["--durations", "0.1:0.2:2"], 3, "the shortest possible one"),
        (["--idle-power", "10"], 2, "--cycle"),
        (["--cycle", "0.2"], 3, "shorter than the fastest"),
        (["--max-duration", "0.2"], 3, "shorter than the fastest"),
        (["--objective", "torque"], 2, "leave --objective out"),
    ],
)
def test_command_line_refuses(tmp_path, capsys, words, code, named):
    goal = ["--goal", "0.4,-0.5,0.2,-2,0,1.6,0.5", "--out", str(tmp_path)]
    assert main(command("tradeoff", *goal, *words)) == code  # also with --quiet it is said why
    assert named in capsys.readouterr().err
