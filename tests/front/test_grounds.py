"""What an answer states beside its energy: where its saving ends, detours, values beyond belief."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.front.models import grounded
from energy_opt.front.optimize import Answer
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.trajectory import Trajectory
from energy_opt.motion.travel import detours
from energy_opt.power.known import careful, source_method_2

START, GOAL = [0.78, -2.42, 0.6, -0.4, -2.4, 1.1], [-0.5, -1.2, 1.9, -1.9, -1.2, -0.9]
QUICK = {"starts": 2, "controls": 20, "compile": "never"}


@pytest.fixture(scope="module")
def frictionless() -> Answer:
    """A ur5e's move of 2 s, planned without friction."""
    return eo.optimize("ur5e", "source-method-2", start=START, goal=GOAL, duration=2.0, **QUICK)


@pytest.fixture(scope="module")
def usual() -> Answer:
    """The same move as it is planned where no model is given."""
    return eo.optimize("ur5e", start=START, goal=GOAL, duration=2.0, **QUICK)


def energy_with(answer: Answer, trajectory: Trajectory, share: float) -> float:
    """J under source-method-2 and dry friction of that share of the effort limits."""
    friction = eo.CoulombFriction(tau_c=share * answer.arm.limits.effort)
    return Scorer(answer.arm, source_method_2(answer.arm).replaced(friction)).energy(trajectory).total


def test_a_ur_saves_with_friction_and_says_where_that_ends(frictionless: Answer, usual: Answer) -> None:
    """A plan without friction takes detours that cost more than they save as soon as there is friction."""
    beside = {row["name"]: row["saving_joules"] for row in frictionless.models}
    assert beside["source-method-2"] > 0 > beside["careful"]
    assert all(row["saving_joules"] >= 0 for row in usual.models) and usual.models[1]["saving_joules"] > 1
    share = frictionless.break_even_friction
    assert share is not None and 0 < share < 0.01 and usual.break_even_friction is None
    for answer, other, sign in ((frictionless, 0.9 * share, 1), (frictionless, 1.1 * share, -1), (usual, 0.199, 1)):
        scaled = answer.baseline("scaled").trajectory
        assert sign * (energy_with(answer, scaled, other) - energy_with(answer, answer.trajectory, other)) > 0
    said = "has no friction: the plan still saves energy if each joint has less than "
    assert any(said in text for text in frictionless.warnings)
    assert not any("has no friction" in text for text in usual.warnings)


def test_detours_are_named_with_both_figures(frictionless: Answer) -> None:
    q = frictionless.trajectory.position
    path, straight = np.abs(np.diff(q, axis=0)).sum(axis=0), np.abs(q[-1] - q[0])
    rows = {row["joint"]: row for row in frictionless.document()["travel"]}
    assert set(rows) == {j for j, p, s in zip(frictionless.arm.joints, path, straight, strict=True) if p > 1.5 * s}
    for joint, row in rows.items():
        k = frictionless.arm.joints.index(joint)
        assert row["path"] == pytest.approx(path[k], rel=1e-3) and row["straight"] == pytest.approx(straight[k])
    time, still = np.linspace(0, 1, 11), np.zeros((11, 1))
    there_and_back = Trajectory(("j",), time, np.sin(np.pi * time)[:, None], still, still)
    assert [(row["joint"], row["straight"] < 1e-9) for row in detours(there_and_back)] == [("j", True)]
    assert detours(Trajectory(("j",), time, time[:, None], still + 1, still)) == []
    millimetres = Trajectory(("j",), time, 0.005 * np.sin(np.pi * time)[:, None], still, still)
    assert detours(millimetres) == []


def test_every_model_and_every_corner_of_assumed_friction_is_held() -> None:
    """ur5: its friction is not published, so a plan is held at 1 to 6 % dry and 2 to 12 % viscous friction."""
    answer = eo.optimize("ur5", start=START, goal=GOAL, duration=2.0, **QUICK)
    slowed = answer.baseline("scaled").trajectory
    assert len(answer.models) == 6
    effort, velocity = answer.arm.limits.effort, answer.arm.limits.velocity
    for dry in (0.01, 0.035, 0.06):
        for viscous in (0.02, 0.07, 0.12):
            model = careful(answer.arm).replaced(eo.CoulombFriction(tau_c=dry * effort))
            model = model.replaced(eo.ViscousFriction(b=viscous * effort / velocity))
            scorer = Scorer(answer.arm, model)
            assert scorer.energy(answer.trajectory).total <= scorer.energy(slowed).total * (1 + 1e-9)


def test_worst_is_the_largest_over_the_range_of_assumed_friction() -> None:
    answer = eo.optimize("ur5", "careful", robust="worst", start=START, goal=GOAL, duration=2.0, **QUICK)
    assert answer.robust["total"] == pytest.approx(max(row["total"] for row in answer.models))
    assert max(answer.models, key=lambda row: row["total"])["name"].endswith("6 % dry, 12 % viscous")


def test_values_beyond_belief_are_named(usual: Answer) -> None:
    """A joint that accelerates as no arm does, and power beyond what the drives give."""
    t = usual.trajectory
    fast = replace(usual, trajectory=replace(t, acceleration=t.acceleration * [40, 1, 1, 1, 1, 1]), warnings=())
    fast = replace(fast, certificate=replace(usual.certificate, peak_power=2e6))
    said = grounded(fast, [Rival("mine", careful(usual.arm))], usual.arm).warnings
    assert [text for text in said if text.startswith("shoulder_pan_joint: the acceleration reaches")]
    power = "power without standby reaches 2e+06 W; the arm's drives give no more than 1678 W"
    assert [text for text in said if text.startswith(power) and ": the assumed electrical values" in text]
    assert not [text for text in usual.warnings if "reaches" in text]


def test_standby_is_no_power_of_the_drives(usual: Answer) -> None:
    """Small arms draw more at rest than their drives give: every plan of one was told that its model is wrong."""
    heavy = careful(usual.arm).replaced(eo.Standby(power=5000.0))
    for peak, warns in ((6600.0, False), (6700.0, True)):
        still = replace(usual, warnings=(), certificate=replace(usual.certificate, peak_power=peak))
        said = grounded(still, [Rival("mine", heavy)], usual.arm).warnings
        assert any("drives give no more than 1678 W" in text for text in said) == warns


def test_the_console_says_it_in_one_line_and_the_report_in_a_table(tmp_path, capsys) -> None:
    ends = [f"--{name}={','.join(map(str, q))}" for name, q in (("start", START), ("goal", GOAL))]
    options = ["--duration", "2", "--starts", "1", "--controls", "16", "--compile", "never", "--out", str(tmp_path)]
    assert main(["optimize", "--robot", "ur5e", *ends, *options, "--mode", "retime"]) == 0
    said = capsys.readouterr()
    lines = [line for line in said.err.splitlines() if line.startswith("assumed: ")]
    assert lines == [
        "assumed: acceleration 15.7 rad/s², jerk (no source), electrical values: "
        "run `diagnose` or give `--limits`, `--model`"
    ]
    document = json.loads((tmp_path / "result.json").read_text())
    assert {"what", "joint", "value", "unit", "source", "note"} == set(document["assumptions"][0])
    assert {"break_even_friction", "travel"} <= set(document)
    report = (tmp_path / "report.html").read_text()
    assert "Values that were not given" in report and "full speed in no less than 0.2 s" in report
