"""The power law against numbers worked out from the table of laws by hand, and the model file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from energy_opt.effects import ALL_EFFECTS, BY_NAME, BaseTilt, Smooth
from energy_opt.errors import BadInput
from energy_opt.power import PowerModel, drive_function, load_model, source_method_1, source_method_2
from energy_opt.power.model import Uncertainty
from energy_opt.power.warm import warmed

Q, V, A = np.array([0.5, -0.2, 1.0]), np.array([0.8, -0.3, 0.0]), np.array([1.5, -2.0, 0.4])
TAU, T = np.array([10.0, 4.0, -2.0]), 30.0
SIGN, REST = np.sign(V), np.array([0.1, 0.2, 0.3])


def model_of(**effects: dict[str, object]) -> PowerModel:
    """A model of three joints with the named effects."""
    return PowerModel("arm", tuple(BY_NAME[name](**values) for name, values in effects.items()))


def evaluate(model: PowerModel) -> tuple[np.ndarray, float, dict[str, float]]:
    """Motor torque, power and parts of a model at the state above."""
    function, names = drive_function(model, 3)
    tau_m, power, parts = function(Q, V, A, TAU, T, model.values(3))
    return np.array(tau_m).ravel(), float(power), dict(zip(names, np.array(parts).ravel().tolist(), strict=True))


def gear(eta: float, at_rest: float) -> np.ndarray:
    """tau / eta where tau drives the joint, tau * eta where the joint drives."""
    driving = TAU * V
    factor = np.where(driving > 0, 1 / eta, np.where(driving < 0, eta, at_rest))
    return TAU * factor


# motor torque that each torque effect leads to, alone
@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ({"coulomb_friction": {"tau_c": [2, 1, 5]}}, TAU + np.array([2, 1, 5]) * SIGN),
        ({"viscous_friction": {"b": 3.0}}, TAU + 3 * V),
        (
            {"stribeck_friction": {"tau_s": [1, 2, 3], "v_s": 0.4}},
            TAU + np.array([1, 2, 3]) * np.exp(-((V / 0.4) ** 2)) * SIGN,
        ),
        ({"load_friction": {"mu": 0.1}}, TAU + 0.1 * np.abs(TAU) * SIGN),
        ({"armature": {"inertia": [0.5, 1, 2]}}, TAU + np.array([0.5, 1, 2]) * A),
        ({"gravity_spring": {"stiffness": [9, 0, -4], "rest": REST}}, TAU - np.array([9, 0, -4]) * (Q - REST)),
        ({"gear_efficiency": {"eta": 0.8}}, gear(0.8, (0.8 + 1 / 0.8) / 2)),
        ({"gear_efficiency": {"eta": 0.8, "rest": "free"}}, gear(0.8, 1.0)),
        ({"gear_efficiency": {"eta": 0.8, "rest": "driving"}}, gear(0.8, 1 / 0.8)),
        ({"gear_efficiency": {"eta": 0.8, "rest": "driven"}}, gear(0.8, 0.8)),
    ],
)
def test_motor_torque(effect: dict[str, dict[str, object]], expected: np.ndarray) -> None:
    tau_m, power, parts = evaluate(model_of(**effect))
    np.testing.assert_allclose(tau_m, expected, rtol=1e-12)
    assert power == pytest.approx(expected @ V, rel=1e-12)
    assert sum(parts.values()) == pytest.approx(power, rel=1e-12)


DRIVE = TAU * V + 0.01 * TAU**2  # [9.0, -1.04, 0.04]


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ({}, TAU @ V),
        ({"standby": {"power": 88.04}}, TAU @ V + 88.04),
        ({"copper_loss": {"r_over_kt2": 0.01}}, DRIVE.sum()),
        ({"copper_loss": {"r_over_kt2": [0.01, 0.02, 0]}}, TAU @ V + 0.01 * 100 + 0.02 * 16),
        ({"inverter_loss": {"c": 0.5}}, TAU @ V + 0.5 * 16),
        ({"motion_power": {"power": 12.0}}, TAU @ V + 12),
        ({"standby_drift": {"power": 6.0, "time_constant": 60.0}}, TAU @ V + 6 * (1 - math.exp(-0.5))),
        (
            {"copper_loss": {"r_over_kt2": 0.01}, "winding_temperature": {"rate": 0.4, "time_constant": 60.0}},
            TAU @ V + 0.01 * (TAU @ TAU) * (1 + 0.4 * (1 - math.exp(-0.5))),
        ),
        ({"supply_efficiency": {"eta": 0.8}, "standby": {"power": 40.0}}, (TAU @ V + 40) / 0.8),
        (
            {"copper_loss": {"r_over_kt2": 0.01}, "regeneration": {"efficiency": 0.25, "level": "joint"}},
            9.0 - 0.25 * 1.04 + 0.04,
        ),
        ({"copper_loss": {"r_over_kt2": 0.01}, "regeneration": {"efficiency": 0.0, "level": "bus"}}, 8.0),
        (
            {"coulomb_friction": {"tau_c": 2.0}, "copper_loss": {"r_over_kt2": 0.01}, "standby": {"power": 5.0}},
            (12 * 0.8 + 2 * -0.3) + 0.01 * (144 + 4 + 4) + 5,
        ),
    ],
)
def test_power(effects: dict[str, dict[str, object]], expected: float) -> None:
    _, power, parts = evaluate(model_of(**effects))
    assert power == pytest.approx(expected, rel=1e-12)
    assert sum(parts.values()) == pytest.approx(power, rel=1e-12)


def test_bus_shares_what_joints_would_lose() -> None:
    """With no regeneration the bus still feeds one joint from another; clamped joint by joint it cannot."""
    braking = PowerModel("arm", (BY_NAME["regeneration"](efficiency=0.0, level="bus"),))
    joint = PowerModel("arm", (BY_NAME["regeneration"](efficiency=0.0, level="joint"),))
    assert evaluate(braking)[1] == pytest.approx(8 - 1.2)
    assert evaluate(joint)[1] == pytest.approx(8)


def test_a_warm_model_is_what_the_model_tends_to() -> None:
    """At 30 s, laws with time constants of 1 s have their final values."""
    cold = model_of(
        copper_loss={"r_over_kt2": [0.01, 0.02, 0]}, winding_temperature={"rate": 0.4, "time_constant": 1.0},
        viscous_friction={"b": 0.5}, thermal_viscous={"b": [2.0, 1.0, 3.0], "share": 0.4, "time_constant": 1.0},
        standby={"power": 40.0}, standby_drift={"power": 6.0, "time_constant": 1.0},
    )  # fmt: skip
    warm = warmed(replace(cold, uncertainty=Uncertainty((), np.zeros((0, 0)), (cold,))))
    assert warm is not None and warm.uncertainty is not None
    assert {e.name for e in warm.effects} == {"copper_loss", "viscous_friction", "standby"}
    for model in (warm, warm.uncertainty.rivals[0]):
        assert evaluate(model)[1] == pytest.approx(evaluate(cold)[1], rel=1e-9)
    assert warmed(warm) is None


def test_standing_still_is_not_moving() -> None:
    model = model_of(motion_power={"power": 10.0}, coulomb_friction={"tau_c": 3.0})
    function, _ = drive_function(model, 3)
    tau_m, power, _ = function(Q, np.zeros(3), np.zeros(3), TAU, 0.0, model.values(3))
    assert float(power) == 0
    np.testing.assert_array_equal(np.array(tau_m).ravel(), TAU)


def test_tilted_base() -> None:
    """Turned by roll about x, then by pitch about y: gravity in the base is what the rotation matrices say."""
    roll, pitch = 0.3, -0.7
    c, s = math.cos(roll), math.sin(roll)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    c, s = math.cos(pitch), math.sin(pitch)
    about_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    gravity = np.array([0.2, 0.1, -9.81])
    effect = BaseTilt(roll=roll, pitch=pitch)
    seen = np.array(BaseTilt.gravity(ca.DM(gravity), BaseTilt.split(ca.DM(effect.full(3)), 3))).ravel()
    np.testing.assert_allclose(seen, (about_y @ about_x).T @ gravity, rtol=1e-12)


@pytest.mark.parametrize("kind", [e for e in ALL_EFFECTS if e.stage in ("torque", "drive", "power", "supply")])
def test_neutral_changes_nothing(kind: type) -> None:
    neutral = PowerModel("arm", (kind.neutral(3),))
    assert evaluate(neutral)[1] == pytest.approx(TAU @ V, rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    v=st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    tau=st.lists(st.floats(-80, 80), min_size=3, max_size=3),
)
def test_smooth_laws_stay_within_their_stated_width(v: list[float], tau: list[float]) -> None:
    """Smoothed power is never farther from the exact one than the widths at the kinks allow, and sharper is closer."""
    model = model_of(
        coulomb_friction={"tau_c": 4.0},
        load_friction={"mu": 0.1},
        copper_loss={"r_over_kt2": 0.004},
        inverter_loss={"c": 0.2},
        regeneration={"efficiency": 0.3, "level": "joint"},
    )
    arguments = (Q, v, A, tau, T, model.values(3))
    exact = float(drive_function(model, 3)[0](*arguments)[1])
    speeds = np.abs(v)
    for scale in (1.0, 0.01):
        smooth = float(drive_function(model, 3, Smooth(scale))[0](*arguments)[1])
        w = 0.01 * scale
        # |sign error| <= 1 and <= (w/v)^2 / 2; times friction torque, times speed (work) and current (copper, inverter)
        slip = np.minimum(1.0, 0.5 * (w / np.maximum(speeds, 1e-12)) ** 2)
        friction = 4 + 0.1 * np.abs(tau)
        largest = np.abs(tau) + friction
        bound = np.sum(slip * friction * (speeds + 2 * 0.004 * largest + 0.2))
        bound += (
            np.sum(0.1 * 0.05 * scale * (speeds + 2 * 0.004 * largest + 0.2)) + 3 * (0.2 * 0.05 + 0.7 * 0.5) * scale
        )
        assert abs(smooth - exact) <= bound + 1e-9


def test_model_file_round_trip(tmp_path: Path) -> None:
    model = model_of(
        standby={"power": 88.04},
        copper_loss={"r_over_kt2": [0.1, 0.2, 0.3]},
        payload={"mass": 1.5, "com": [0.0, 0.01, 0.1]},
        regeneration={"efficiency": 0.5, "level": "joint"},
    )
    model.save(tmp_path / "model.toml")
    again = load_model(tmp_path / "model.toml")
    assert again.structure == model.structure and again.robot == "arm"
    np.testing.assert_array_equal(again.values(3), model.values(3))


def test_source_paper_models(tmp_path: Path) -> None:
    """Methods 1 and 2 of the paper: 92.3 W alone, and 88.04 W with R/Kt^2 = 0.0036 W/(N m)^2."""
    for model, standby, copper in ((source_method_1(), 92.3, None), (source_method_2(), 88.04, 0.0036)):
        model.save(tmp_path / "model.toml")
        again = load_model(tmp_path / "model.toml")
        assert again.robot == "panda"
        assert again.get("standby").values["power"] == [standby]
        assert (None if copper is None else [copper]) == (
            again.get("copper_loss") and again.get("copper_loss").values["r_over_kt2"].tolist()
        )


HEAD = 'format = "energy-opt/model/1"\nrobot = "panda"\n'
COVARIANCE = (
    '[[effect]]\nname = "standby"\npower = 1\n[[effect]]\nname = "copper_loss"\nr_over_kt2 = 0.004\n'
    "[covariance]\nnames = {names}\nmatrix = {matrix}\n"
)
TWO = '["standby.power.0", "copper_loss.r_over_kt2.0"]'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('robot = "panda"\n', "format is missing"),
        ('format = "energy-opt/model/9"\n', "expected 'energy-opt/model/1'"),
        ('format = "energy-opt/job/1"\ncycle_time = 8\n', r"expected 'energy-opt/model/1'\Z"),
        (HEAD + "extra = 1\n", "unknown key 'extra'"),
        (HEAD + '[[effect]]\nname = "warp"\n', r"unknown name 'warp'; .*`--effects FILE\.py`"),
        (
            HEAD + '[[effect]]\nname = "standby"\n',
            r"\[\[effect\]\] 1: effect standby: parameter 'power' is missing \[W\]",
        ),
        (HEAD + '[[effect]]\nname = "standby"\npower = -3\n', r"power = -3 is outside"),
        (HEAD + '[[effect]]\nname = "standby"\npower = "much"\n', "not a number"),
        (HEAD + '[[effect]]\nname = "standby"\npower = nan\n', "not a finite number"),
        (HEAD + '[[effect]]\nname = "standby"\npower = [1, 2]\n', "has 2 values"),
        (HEAD + '[[effect]]\nname = "standby"\npower = 1\nwatts = 2\n', "unknown parameter 'watts'"),
        (HEAD + '[[effect]]\nname = "regeneration"\nefficiency = 0.5\nlevel = "cell"\n', "expected one of bus, joint"),
        (HEAD + '[[effect]]\nname = "standby"\npower = 1\n' * 1 + '[[effect]]\nname = "standby"\npower = 2\n', "twice"),
        (HEAD + '[[effect]]\nname = "winding_temperature"\nrate = 1\ntime_constant = 9\n', "copper_loss"),
        (HEAD + "[[effect]]\npower = 1\n", "effect 1: name is missing"),
        (HEAD + "[effect]\npower = 1\n", "effect: expected a list"),
        (HEAD.replace('"panda"', "3"), "robot = 3; expected text"),
        (HEAD + COVARIANCE.format(names='["standby.power.0"]', matrix="[[1.0, 2.0]]"), "matrix is not 1 x 1 numbers"),
        (HEAD + COVARIANCE.format(names='["standby.power.1"]', matrix="[[1.0]]"), "is not effect.parameter.index"),
        (HEAD + COVARIANCE.format(names='["standby.power.0"]', matrix="[[nan]]"), "covariance: matrix 1 1 = nan"),
        (HEAD + COVARIANCE.format(names="3", matrix="[]"), "covariance: names = 3; expected a list"),
        (
            HEAD
            + COVARIANCE.format(names='["standby.power.0", "copper_loss.r_over_kt2.0"]', matrix="[[1, 2], [3, 4]]"),
            "matrix is not symmetric",
        ),
        (HEAD + COVARIANCE.format(names=TWO, matrix="[[1.0, 2.0], [2.0, 1.0]]"), "is no covariance"),
        (
            HEAD + COVARIANCE.format(names=TWO, matrix="[[-1, 0], [0, 1]]"),
            r"variance of standby.power.0 is -1; expected 0",
        ),
        (HEAD + COVARIANCE.format(names=TWO, matrix="[[1.0, 0.0], [1e-4, 1e-8]]"), "matrix is not symmetric"),
        (
            HEAD + COVARIANCE.format(names='["standby.power.0", "standby.power.0"]', matrix="[[1, 0], [0, 1]]"),
            "'standby.power.0' is given twice",
        ),
        (HEAD + "[[rival]]\n", r"\[\[rival\]\] 1: no effect"),
        (HEAD + '[[rival]]\n[[rival.effect]]\nname = "warp"\n', r"\[\[rival\]\] 1: \[\[effect\]\] 1: .*'warp'"),
        (HEAD + "[[effect]\n", "not valid TOML"),
    ],
)
def test_faulty_model_files(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "model.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match=says) as caught:
        load_model(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_every_fault_of_a_model_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(
        HEAD + '[[effect]]\nname = "standby_drift"\npower = -5\nwrong = 1\n' + '[[effect]]\nname = "coper_loss"\n'
    )
    with pytest.raises(BadInput) as caught:
        load_model(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == 3 and all(line.startswith(f"{path}: [[effect]] ") for line in lines)
    for line, says in zip(
        lines, ("unknown parameter 'wrong'", "'time_constant' is missing", "copper_loss"), strict=True
    ):
        assert says in line


def test_a_list_must_fit_the_robot() -> None:
    with pytest.raises(BadInput, match="has 2 values; the robot has 3 joints"):
        model_of(copper_loss={"r_over_kt2": [1, 2]}).check(3)


def test_a_model_names_its_robot_by_name_or_by_a_urdf() -> None:
    model = model_of(copper_loss={"r_over_kt2": 0.01})
    for name, own in (("arm", True), ("cells/arm.urdf", True), ("", True), ("armour", False)):
        assert replace(model, robot=name).is_of("arm") == own
