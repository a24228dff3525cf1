"""One supply of several arms: peaks, shifted starts, and what is braked."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.schedule import Hull, Lag, Mode, Move, Problem, Ring, Wait, solve
from energy_opt.workcell.file import workcell_of
from energy_opt.workcell.link import in_every_cycle
from energy_opt.workcell.solve_cell import from_zero, near_zero
from energy_opt.workcell.supply import Supply


@pytest.mark.slow
def test_a_peak_that_other_times_do_not_lower_is_met_by_slower_moves_or_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ends = [[x, 0.3, 0.0, -1.9, 0.0, 2.2, 0.8] for x in (-0.6, 0.6)]
    document = {
        "format": "energy-opt/job/2",
        "cycle_time": 5.0,
        "mode": [{"name": "brakes", "power": 40.0, "least": 0.2}],  # so fast moves cost least
        "robot": [{"name": "a", "robot": "panda", "step": [{"name": f"to {k}", "to": q} for k, q in enumerate(ends)]}],
    }
    file, peaks, energies = tmp_path / "cell.toml", [], []
    for most in (1000.0, 110.0, 50.0):
        document["supply"] = {"capacity": 20.0, "max_power": most}
        file.write_bytes(tomli_w.dumps(document).encode())
        options = ["--model", "source-method-2", "--starts", "1", "--quiet", "--force"]
        code = main(["job", str(file), "--out", str(tmp_path / "out"), *options])
        if most == 50:
            assert code == 3
            assert "W at" in (said := capsys.readouterr().err) and "max_power = 50 W" in said and "a.to " in said
            continue
        assert code == 0
        found = json.loads((tmp_path / "out" / "job.json").read_text())
        from cell_circuit import PANDA, cycle_of

        peaks.append(cycle_of(document, tmp_path / "out", {"a": PANDA}).peak)  # at a meter
        energies.append(found["energy_total"])
        assert sum(step["duration"] for step in found["robots"][0]["steps"]) == pytest.approx(5.0)
    assert peaks[0] > 120 and peaks[1] <= 110
    assert energies[0] < energies[1] < 1.1 * energies[0]


class Swings:
    """Stands for an arm: a move that takes 200 W in its first half and gives them back in its second."""

    def parts(self, ring: Ring, starts: np.ndarray, durations: np.ndarray) -> list[str]:
        return [step.name for step in ring.steps]

    def powers(self, part: str, at: np.ndarray, first: bool = False) -> tuple[np.ndarray, np.ndarray]:
        power = np.where(at <= at[-1] / 2, 200.0, -200.0) if part == "move" else np.zeros(len(at))
        return power, np.full(len(at), 50.0)


def test_an_arm_is_shifted_to_where_it_takes_what_the_other_brakes() -> None:
    steps = (Move("move", 1.0, 1.0, Hull.of([(1.0, 150.0)])), Wait("wait", 0.0, 9.0, (Mode("motors", 50.0),)))
    schedule = solve(Problem(4.0, (Ring("a", steps), Ring("b", steps))))
    robots = [{"name": n, "step": [{"wait": 1.0, "power": {"motors": 50.0}}]} for n in "ab"]
    cell = workcell_of({"format": "energy-opt/job/2", "cycle_time": 4.0, "supply": {}, "robot": robots}, Path("cell"))
    supply = Supply(cell, [Swings(), Swings()])
    together = supply.drawn(schedule, True)
    assert together.energy == pytest.approx(2 * 4 * 50 + 200, rel=0.02) and together.lost == pytest.approx(
        200, rel=0.02
    )
    apart = supply.drawn(supply.in_phase(schedule, lambda _: True), True)
    assert apart.energy == pytest.approx(2 * 4 * 50 + 100, rel=0.03)  # half of one arm's braking drives the other
    assert apart.peak == pytest.approx(300.0, rel=0.02) and together.peak == pytest.approx(500.0, rel=0.02)
    assert supply.in_phase(schedule, lambda _: False) is schedule


def test_the_supply_gives_what_the_steps_take_wherever_they_begin() -> None:
    class Steady(Swings):
        def powers(self, part: str, at: np.ndarray, first: bool = False) -> tuple[np.ndarray, np.ndarray]:
            return np.full(len(at), 400.0 if part == "move" else 0.0), np.full(len(at), 50.0)

    document = {"format": "energy-opt/job/2", "cycle_time": 4.0, "supply": {}}
    robots = [{"name": "a", "step": [{"wait": 1.0, "power": {"motors": 50.0}}]}]
    supply = Supply(workcell_of({**document, "robot": robots}, Path("cell")), [Steady()])
    for length in (0.0013, 0.73337, 1.0, 3.99871):
        move = Move("move", length, length, Hull.of([(length, 450 * length)]))
        schedule = solve(Problem(4.0, (Ring("a", (move, Wait("wait", 0.0, 9.0, (Mode("motors", 50.0),)))),)))
        for begin in (0.0, 1.23456, 3.9):
            drawn = supply.drawn(replace(schedule, starts=(schedule.starts[0] + begin,)), True)
            assert drawn.energy == pytest.approx(400 * length + 50 * 4, abs=1e-6)


@pytest.mark.parametrize(
    ("capacity", "own", "shared"),
    [(0.0, (150, 150), (100, 150)), (30.0, (120, 120), (85, 135)), (500.0, (50, 50), (50, 50))],
)
def test_steps_take_what_the_supply_gives(
    capacity: float, own: tuple[float, float], shared: tuple[float, float]
) -> None:
    """Both return 100 J; b, 0.25 s later, takes half of what a returns. What is lost counts where it is returned."""
    steps = (Move("move", 1.0, 1.0, Hull.of([(1.0, 150.0)])), Wait("wait", 0.0, 9.0, (Mode("motors", 50.0),)))
    schedule = solve(Problem(4.0, (Ring("a", steps), Ring("b", steps))))
    schedule = replace(schedule, starts=(schedule.starts[0], schedule.starts[0] + 0.25))
    robots = [{"name": n, "step": [{"wait": 1.0, "power": {"motors": 50.0}}]} for n in "ab"]
    document = {"format": "energy-opt/job/2", "cycle_time": 4.0, "supply": {"capacity": capacity}, "robot": robots}
    supply = Supply(workcell_of(document, Path("cell")), [Swings(), Swings()])
    for together, expected in ((False, own), (True, shared)):
        found = supply.by_step(schedule, together)
        assert found.energy == pytest.approx(supply.drawn(schedule, together).energy)
        assert [e[0] for e in found.energies] == pytest.approx(list(expected), abs=2)
        assert [e[1] for e in found.energies] == pytest.approx([150.0, 150.0])


@pytest.mark.parametrize("mean", [-0.2, 0.0, 0.1])
def test_a_link_repeats_its_cycle(mean: float) -> None:
    taken = np.random.default_rng(1).normal(mean, 2.0, 200)
    stored, cycles = 0.0, 60
    for _ in range(cycles):
        drawn, lost = [], []
        for joules in taken.tolist():
            charged = stored - joules
            drawn.append(max(-charged, 0.0))
            lost.append(max(charged - 9.0, 0.0))
            stored = min(max(charged, 0.0), 9.0)
    found = in_every_cycle(taken, 9.0)
    assert np.allclose(found, [drawn, lost], atol=1e-9)


def test_what_was_shifted_begins_with_the_first_robot() -> None:
    steps = (Move("move", 1.0, 1.0, Hull.of([(1.0, 150.0)])), Wait("wait", 0.0, 9.0, (Mode("motors", 50.0),)))
    rings = tuple(Ring(name, steps) for name in "abc")
    schedule = solve(Problem(4.0, rings, (Lag((2, 0), (0, 0), 0.5, 0),)))  # c begins before a, by its lag
    shifted = replace(schedule, starts=tuple(np.array([at, at + 1.0]) for at in (0.4, 0.0, -0.1)))
    starts = [float(own[0]) for own in from_zero(shifted).starts]
    assert starts == pytest.approx([0.0, 3.6, -0.5])
    for at, counted in (((0.0, -0.4, -0.5), [0.0, -0.4, -0.5]), ((0.0, -4.4, -40.5), [0.0, -0.4, -0.5])):
        shifted = replace(schedule, starts=tuple(np.array([t, t + 1.0]) for t in at))
        assert [float(own[0]) for own in near_zero(shifted)] == pytest.approx(counted)


def test_without_a_resistor_braking_energy_must_be_stored() -> None:
    steps = (Move("move", 1.0, 1.0, Hull.of([(1.0, 150.0)])), Wait("wait", 0.0, 9.0, (Mode("motors", 50.0),)))
    schedule = solve(Problem(4.0, (Ring("a", steps),)))
    document = {
        "format": "energy-opt/job/2",
        "cycle_time": 4.0,
        "robot": [{"name": "a", "step": [{"wait": 1.0, "power": {"motors": 50.0}}]}],
    }
    for capacity, resistor, valid in ((0.0, True, True), (50.0, False, False), (101.0, False, True)):
        asked = {**document, "supply": {"capacity": capacity, "resistor": resistor}}
        found = Supply(workcell_of(asked, Path("cell")), [Swings()]).drawn(schedule, True)
        assert found.valid == valid and (found.overflow > 0) != valid


def test_less_power_than_the_arms_take_at_rest_is_refused_before_any_move_is_solved() -> None:
    """A limit in kW was searched for without an end."""
    steps = [{"to": [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]}, {"to": [0.0, 1.0, -1.0, 0.0, 0.0, 0.0]}]
    cell = {"format": "energy-opt/job/2", "cycle_time": 4.0, "mode": [{"name": "brakes", "power": 30.0}],
            "robot": [{"name": "a", "robot": "z1", "step": steps}], "supply": {"max_power": 0.9}}  # fmt: skip
    with pytest.raises(eo.Infeasible, match=r"supply: max_power = 0.9 W is below the 30 W that the arms take at rest"):
        eo.job(cell, model="careful", self_collision="off")
