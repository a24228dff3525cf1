"""A user's own effects, as the documentation shows them: registered, checked, planned with, in workers, diagnosed."""

from __future__ import annotations

import inspect
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.cli.main import main
from energy_opt.effects import (
    CoulombFriction,
    FrictionCurve,
    Parameter,
    PowerEffect,
    known_effects,
    load_file,
    loaded_sources,
    register,
    registry,
    unregister,
)
from energy_opt.effects.check import check_effect
from energy_opt.errors import BadInput
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.path import straight
from energy_opt.motion.timing.toppra import fastest
from energy_opt.power import PowerModel, load_model
from energy_opt.robot import load_robot
from energy_opt.tables import read_table, write_table

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
OWN = EXAMPLES / "my_effects.py"
START, GOAL = np.array([0, -1.2, 1.2, -1.5, -1.5, 0]), np.array([1.0, -1.2, 1.2, -1.5, -1.5, 0])  # one joint moves


@pytest.fixture
def own():
    kinds = load_file(OWN)
    yield {kind.name: kind for kind in kinds}
    for kind in kinds:
        unregister(kind.name)


def test_effects_of_the_documentation_pass_the_check(own):
    assert set(own) == {"joint_brake", "fan"} and set(own) < set(known_effects())
    for kind in own.values():
        assert check_effect(kind) == []


LAW = """from energy_opt.effects import Parameter, {base}
class Mine({base}):
    name = "mine"
    parameters = (Parameter("p", "1", 0.0, 0.0, 10.0),)
    @classmethod
    def {law}:
        return {value}
"""
POWER, TORQUE = ("PowerEffect", "power(cls, x, tau_m, p, k)"), ("TorqueEffect", "torque(cls, x, p, k)")


@pytest.mark.parametrize(
    ("stage", "value", "says"),
    [
        (POWER, "p.p * x.v", r"shape \(2, 1\); expected \(1, 1\)"),
        (TORQUE, "p.p * x.v[0]", r"shape \(1, 1\); expected \(2, 1\) on an arm of 2 joints"),
        (POWER, "p.p * x.speed", r"no attribute 'speed' \(line 7\)"),
        (POWER, "p.p / x.v[0]", "its law is not finite at rest"),
        (POWER, "p.p + (x.v[0] - 1) ** 0.5", "its law is not finite at rest"),
        (POWER, "None", r"its law returns nothing \(None\)"),
        (POWER, "p.p if x.v[0] > 0 else 0", r"\(line 7\); a law has no `if`: use functions of k"),
    ],
)
def test_laws_that_no_plan_can_use_are_refused(tmp_path: Path, stage: tuple[str, str], value: str, says: str) -> None:
    """With the file and the effect, where the file is read; not as a fault of the program while planning."""
    path = tmp_path / "laws.py"
    path.write_text(LAW.format(base=stage[0], law=stage[1], value=value))
    with pytest.raises(BadInput, match=f"laws.py: effect mine: .*{says}"):
        load_file(path)
    assert "mine" not in known_effects()


def test_an_effect_that_takes_the_place_of_an_earlier_one_has_its_own_form(tmp_path: Path) -> None:
    """Functions are kept by form: with the form of the earlier one, an energy would be that of its law."""
    forms = []
    for value in ("p.p", "2 * p.p"):
        path = tmp_path / "laws.py"
        path.write_text(LAW.format(base=POWER[0], law=POWER[1], value=value))
        (kind,) = load_file(path)
        forms.append(kind(p=1.0).form)
        unregister("mine")
    assert forms[0] != forms[1]


def test_an_own_effect_may_change_the_rigid_body(tmp_path: Path) -> None:
    path = tmp_path / "laws.py"
    path.write_text(LAW.format(base="RigidEffect", law="gravity(cls, gravity, p)", value="gravity * (1 + p.p)"))
    (kind,) = load_file(path)
    assert check_effect(kind) == []
    unregister("mine")


def test_other_processes_get_only_registered_effects():
    kinds = load_file(OWN)
    assert [where for _, where in loaded_sources()] == [str(OWN)]
    for kind in kinds:
        unregister(kind.name)
    assert loaded_sources() == ()


def test_a_brake_is_paid_by_the_joint_and_by_the_second(own):
    """8 W for the one joint that moves, for as long as it moves: worked out by hand."""
    robot, model = load_robot("ur5e"), load_model(EXAMPLES / "my_model.toml")
    timing = fastest(robot, model, straight(START, GOAL))
    energy = Scorer(robot, model).energy(timing.trajectory(robot.joints))
    assert energy.by_effect["joint_brake"] == pytest.approx(8 * timing.duration, rel=1e-3)
    assert energy.loss > energy.by_effect["joint_brake"] and energy.standby == pytest.approx(90 * timing.duration)


def test_planned_with_from_the_command_line_and_in_spawned_workers(tmp_path, own, capfd):
    words = ["--start", ",".join(map(str, START)), "--goal", ",".join(map(str, GOAL)), "--mode", "retime"]
    model = ["--model", str(EXAMPLES / "my_model.toml"), "--effects", str(OWN)]
    assert main(["optimize", "--robot", "ur5e", *words, *model, "--out", str(tmp_path / "out"), "--quiet"]) == 0
    one = json.loads((tmp_path / "out/result.json").read_text())
    assert one["energy"]["by_effect"]["joint_brake"] > 0
    (tmp_path / "suite.toml").write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["ur5e"]\nmodes = ["retime"]\ndurations = ["free"]\n\n'
        f"[[moves]]\nname = 'turn'\nstart = {START.tolist()}\ngoal = {GOAL.tolist()}\n"
    )
    assert main(["bench", str(tmp_path / "suite.toml"), *model, "--jobs", "1", "--out", str(tmp_path / "b")]) == 0
    from energy_opt.batches.records import read_parquet

    (row,) = read_parquet(tmp_path / "b/results.parquet")
    assert row["status"] == "solved" and row["energy_total"] == pytest.approx(one["energy"]["total"], rel=1e-6)


@pytest.mark.slow
def test_a_fan_that_follows_temperature_is_found_in_a_log(tmp_path, own):
    pytest.importorskip("mujoco")
    from virtual_sets import make_set

    from energy_opt.diagnosis import diagnose
    from energy_opt.measured import read_set
    from energy_opt.virtual_arm.simulate import Instruments

    made = make_set(tmp_path / "set", "z1", [], seed=3, instruments=Instruments(noise=0.5, power_resolution=0.02))
    joints = load_robot("z1").joints
    runs = read_set(made.folder).runs
    for run in runs:
        table = read_table(made.folder / run.file)
        t = run.start + table["time"]
        warm = {f"{name}.temperature": 35 + 8 * np.sin(2 * np.pi * t / 70 + 0.1 * j) for j, name in enumerate(joints)}
        table["power"] = table["power"] + 0.5 * (np.mean(list(warm.values()), axis=0) - 25)
        columns = {**table, **warm}
        write_table(made.folder / run.file, list(columns), list(columns.values()))
    found = diagnose(read_set(made.folder), made.declared).document()
    assert [row["name"] for row in found["effects"]] == ["fan"] and found["verdict"] == "explained"
    assert found["effects"][0]["parameters"]["per_kelvin"] == pytest.approx(0.5, abs=0.03)


def test_an_installed_package_offers_effects_by_entry_point(tmp_path, monkeypatch, own):
    (tmp_path / "acme_effects.py").write_text(
        OWN.read_text().replace('"joint_brake"', '"acme_brake"').replace('"fan"', '"acme_fan"')
    )
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[energy_opt.effects]\nbrake = acme_effects:JointBrake\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._installed.cache_clear()
    try:
        assert known_effects()["acme_brake"](power=3.0).full(2).tolist() == [3.0, 3.0]
        assert "acme_fan" not in known_effects()
    finally:
        unregister("acme_brake")
        sys.modules.pop("acme_effects")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = 1\n", "defines no effect"),
        ("import nothing_of_that_name\n", "ModuleNotFoundError"),
        ("def f(:\n", "SyntaxError"),
        (
            "from energy_opt.effects import PowerEffect\nclass A(PowerEffect):\n    name = 'a'\n    parameters = ()\n",
            "defines no law: power",
        ),
        ("from energy_opt.effects import Standby\nclass A(Standby):\n    name = 'standby'\n", "the name is taken"),
        ("from energy_opt.effects import Effect\nclass A(Effect):\n    name = 'a'\n", "derive it from one of"),
        ("from energy_opt.effects import PowerEffect\nclass A(PowerEffect):\n    name = 'My A'\n", "lower-case words"),
        (
            "from energy_opt.effects import PowerEffect\nclass A(PowerEffect):\n    name = 'a'\n    parameters = []\n",
            "parameters is not a tuple",
        ),
        (
            "from energy_opt.effects import TorqueEffect\nclass A(TorqueEffect):\n    name, stores = 'a', True\n"
            "    parameters = ()\n    @classmethod\n    def torque(cls, x, p, k):\n        return 0\n",
            "stores energy, but does not define stored",
        ),
        (
            "from energy_opt.effects import TorqueEffect\nclass A(TorqueEffect):\n    name = 'a'\n"
            "    parameters = ()\n    def torque(cls, x, p, k):\n        return 0\n",
            "torque is not a class method: write @classmethod above it",
        ),
    ],
)
def test_faulty_files_of_effects(tmp_path, capsys, text, says):
    path = tmp_path / "own.py"
    path.write_text(text)
    assert main(["robots", "panda", "--effects", str(path)]) == 2
    error = capsys.readouterr().err
    assert says in error and str(path) in error and error.count("\n") == 1


def test_signatures_say_units_and_reprs_are_short():
    assert str(inspect.signature(CoulombFriction)) == "(*, tau_c: 'N m, a number or one per joint')"
    assert repr(CoulombFriction(tau_c=0.3)) == "CoulombFriction(tau_c=0.3)"
    assert CoulombFriction(tau_c=0.3) == CoulombFriction(tau_c=[0.3]) != CoulombFriction(tau_c=0.4)
    curve = FrictionCurve(speed=[0, 1], torque=[[1, 2], [3, 4]])
    assert repr(curve) == "FrictionCurve(speed=[0, 1], torque=<2 x 2 numbers>)"
    with pytest.raises(BadInput, match="torque has 2 values along 'points'; expected 3"):
        FrictionCurve(speed=[0, 1, 2], torque=[[1, 2], [3, 4]])
    with pytest.raises(BadInput, match=r"tau_c = -1 is outside \[0, 1e\+09\] N m"):
        CoulombFriction(tau_c=-1)


def test_a_class_registered_anew_replaces_what_was_built():
    """In a notebook a cell is run again: the law that counts is the last."""

    def cell(factor):
        def power(cls, x, tau_m, p, k):
            return factor * p.power

        body = {"name": "cell", "parameters": (Parameter("power", "W", 0, 0, 9),), "power": classmethod(power)}
        return register(type("Cell", (PowerEffect,), {**body, "__qualname__": "Cell"}))

    try:
        first = PowerModel("arm", (cell(1)(power=1.0),)).structure
        second = PowerModel("arm", (cell(2)(power=1.0),)).structure
        assert first != second and registry.of_form(second[0], 2).power(None, None, SimpleNamespace(power=3), None) == 6
    finally:
        unregister("cell")


def test_a_model_registers_the_effects_that_are_added_to_it():
    """Without `register`, a class that was defined again had the law of the first one in a plan."""

    def extra(factor):
        def power(cls, x, tau_m, p, k):
            return factor * p.power

        body = {"name": "extra", "parameters": (Parameter("power", "W", 0, 0, 9),), "power": classmethod(power)}
        return type("Extra", (PowerEffect,), {**body, "__qualname__": "Extra"})

    robot = load_robot("ur5e")
    rest = straight(START, START + 1e-3)
    try:
        powers = []
        for factor in (1, 3):
            model = PowerModel("ur5e", ()) + extra(factor)(power=2.0)
            motion = fastest(robot, model, rest).slowed(1.0).trajectory(robot.joints)
            powers.append(Scorer(robot, model).energy(motion).by_effect["extra"])
        np.testing.assert_allclose(powers, [2.0, 6.0], rtol=1e-9)
    finally:
        unregister("extra")
