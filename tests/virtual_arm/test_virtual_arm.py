"""The virtual arm: its dynamics against Pinocchio's, its drives against the library's laws, its files, its faults."""

import subprocess
import sys
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from virtual_arms import ARMS, SIZES, SPECIAL_SIZES, draw_effect, draw_special
from virtual_motions import excitation, there_and_back
from virtual_sets import arm, base_model

import energy_opt as eo
from energy_opt.effects import (
    BY_NAME,
    BaseTilt,
    MeterDelay,
    MeterFilter,
    MeterGain,
    MeterWindow,
    Payload,
    RunOffset,
    Standby,
)
from energy_opt.errors import BadInput
from energy_opt.power import PowerModel, drive_function
from energy_opt.power.drive_law import rigid_inputs, rigid_torque
from energy_opt.robot import load_robot
from energy_opt.virtual_arm.drives import electrical_power, reading
from energy_opt.virtual_arm.plant import Cogging, Fan, Plant, StandbyStep, load_plant
from energy_opt.virtual_arm.simulate import Instruments, play, pose, simulate

pytest.importorskip("mujoco")

from energy_opt.virtual_arm.drives import JointLaws
from energy_opt.virtual_arm.mujoco_arm import STEP, MujocoArm

REST = 1e-3  # [rad/s] below this the plant's dry friction fades out


@pytest.mark.parametrize("name", ["panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1", "ur3e", "ur5e", "ur10e"])
def test_inverse_dynamics_agree_with_pinocchio(name: str) -> None:
    robot = load_robot(name)
    payload, tilt = Payload(mass=1.3, com=[0.02, 0.05, 0.1]), BaseTilt(roll=0.1, pitch=-0.2)
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-2, 2, (3, 25, robot.n))
    for model in (PowerModel(name, ()), PowerModel(name, (payload, tilt))):
        virtual = MujocoArm(robot, Plant(model)).inverse(q, v, a)
        ours = robot.body.torque(q, v, a, *rigid_inputs(model, robot.body))
        np.testing.assert_allclose(virtual, ours, atol=1e-10)


def test_a_joint_locked_away_from_zero_changes_both_alike() -> None:
    robot = load_robot("panda", lock={"panda_joint6": 1.1, "panda_joint3": -0.4})
    rng = np.random.default_rng(1)
    q, v, a = rng.uniform(-1, 1, (3, 10, robot.n))
    virtual = MujocoArm(robot, Plant(PowerModel("panda", ()))).inverse(q, v, a)
    np.testing.assert_allclose(virtual, robot.body.torque(q, v, a), atol=1e-10)


@pytest.mark.parametrize("robot", ["panda", "z1"])
@pytest.mark.parametrize("effect", ["", *(kind.name for kind in SIZES)])
def test_forward_simulation_follows_the_law_of_every_effect(robot: str, effect: str) -> None:
    """Power from the simulated torque against the library's expressions on the simulated motion."""
    rng = np.random.default_rng(5)
    body, model = arm(robot), base_model(robot)
    if effect:
        model = model.replaced(draw_effect(BY_NAME[effect], robot, rng))
    plant = Plant(model)
    virtual = MujocoArm(body, plant)
    function, _ = drive_function(model, body.n)
    for reference in excitation(body, rng, motions=2, poses=1):
        seen = play(virtual, plant, reference, rest=0.3, start=30.0)
        q, v = seen.played.position, seen.played.velocity
        a = np.gradient(v, seen.played.time, axis=0)
        v = np.where(np.abs(v) < REST, 0.0, v)
        tau = rigid_torque(model, body.body, q, v, a)
        values = ca.repmat(model.values(body.n), 1, len(q))
        _, power, _ = function.map(len(q))(q.T, v.T, a.T, tau.T, seen.start + seen.played.time, values)
        gap = np.array(power).ravel() - seen.power
        width = 0.7 if effect == "gear_efficiency" else 0.2  # its sign's jump is as large as the load
        assert np.sqrt(np.mean(gap**2)) < width
        assert abs(gap.mean()) < 0.05 * max(1.0, np.ptp(seen.power) / 20)


def test_drive_laws_agree_with_the_library_at_random_states() -> None:
    """All electrical effects at once, both levels of regeneration: numpy here, CasADi there."""
    rng = np.random.default_rng(2)
    n = 6
    for level in ("bus", "joint"):
        effects = [draw_effect(BY_NAME[name], "z1", rng) for name in ELECTRIC if name != "regeneration"]
        effects.append(BY_NAME["regeneration"](efficiency=0.3, level=level))
        model = base_model("z1")
        for effect in effects:
            model = model.replaced(effect)
        function, _ = drive_function(model, n)
        v, torque = rng.normal(0, 1, (200, n)), rng.normal(0, 10, (200, n))
        v[::5] = 0.0
        t = rng.uniform(0, 200, 200)
        ours = function.map(200)(
            np.zeros((n, 200)), v.T, np.zeros((n, 200)), torque.T, t, ca.repmat(model.values(n), 1, 200)
        )
        np.testing.assert_allclose(electrical_power(Plant(model), t, v, torque), np.array(ours[1]).ravel(), atol=1e-9)


ELECTRIC = (
    "inverter_loss",
    "supply_efficiency",
    "motion_power",
    "winding_temperature",
    "standby_drift",
    "regeneration",
)


def test_the_arm_comes_to_rest_and_holds_gravity() -> None:
    rng = np.random.default_rng(3)
    body = arm("ur5e")
    model = base_model("ur5e").replaced(draw_effect(BY_NAME["coulomb_friction"], "ur5e", rng))
    model = model.replaced(draw_effect(BY_NAME["stribeck_friction"], "ur5e", rng))
    plant = Plant(model)
    goal = np.array([0.4, -1.0, 1.2, -0.5, 0.3, 0.2])
    seen = play(MujocoArm(body, plant), plant, there_and_back("x", np.zeros(6), goal, 1.0, 0.2), rest=0.5)
    last = seen.played
    assert np.abs(last.velocity[-50:]).max() < 1e-4
    gravity = body.body.torque(last.position[-1:], np.zeros((1, 6)), np.zeros((1, 6)))
    np.testing.assert_allclose(last.torque[-1:], gravity, atol=0.25)  # dry friction still holds a little
    assert np.abs(np.diff(last.torque[-100:], axis=0)).max() < 0.05  # no chatter


def test_input_energy_equals_heat_and_work() -> None:
    """A closed motion with dry friction: the motors' work is the friction's, tau_c times the way."""
    body = arm("panda")
    friction = np.full(7, 0.8)
    model = base_model("panda").replaced(BY_NAME["coulomb_friction"](tau_c=friction))
    plant = Plant(model)
    goal = np.array([0.3, 0.4, 0.2, -1.2, 0.5, 1.4, 0.3])
    start = np.array([0.0, 0.0, 0.0, -1.8, 0.0, 1.8, 0.0])
    seen = play(MujocoArm(body, plant), plant, there_and_back("x", start, goal, 1.4, 0.3), rest=0.4).played
    work = float((seen.torque * seen.velocity).sum() * STEP)
    way = np.abs(np.diff(seen.position, axis=0)).sum(axis=0)
    assert work == pytest.approx(float(friction @ way), rel=0.02)


def test_meter_delays_lags_and_scales() -> None:
    t = np.arange(4000) * STEP
    power = np.where(t > 1.0, 20.0, 10.0)
    plain = Plant(PowerModel("panda", ()))
    np.testing.assert_array_equal(reading(plain, t, power, STEP), power)
    late = Plant(PowerModel("panda", (MeterDelay(delay=0.25), MeterGain(gain=1.1))))
    assert reading(late, t, power, STEP)[1200] == pytest.approx(11.0)
    assert reading(late, t, power, STEP)[1300] == pytest.approx(22.0)
    slow = reading(Plant(PowerModel("panda", (MeterFilter(time_constant=0.5),))), t, power, STEP)
    assert slow[1500] == pytest.approx(20 - 10 * np.exp(-1.0), abs=0.05)
    mean = reading(Plant(PowerModel("panda", (MeterWindow(duration=0.5),))), t, power, STEP)
    assert mean[[1000, 1250, 1600]] == pytest.approx([10.0, 15.0, 20.0], abs=0.05)
    # the library's own law says the same
    np.testing.assert_allclose(MeterWindow.reading(t, power, 0.5)[1100:], mean[1100:], atol=0.05)


NEW = {
    "iron_loss": {"hysteresis": [1.5, 0.5], "eddy": [0.2, 0.4]},
    "psu_loss": {"affine": 0.1, "quadratic": 1e-3},
    "idle_hold": {"power": 6.0, "duration": 0.3},
    "dc_link": {"capacity": 1.5},
}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # speeds 2 and 1 rad/s, torques 3 and -4 N m from 0.5 to 1.5 s: 2 W out; torques turned round: -2 W
        ("iron_loss", [0, 2 + 1.5 * 2 + 0.5 + 0.2 * 4 + 0.4, -2 + 4.7, 0]),
        ("psu_loss", [0, 2.0 + 0.2 + 0.004, -2 + 0.2 + 0.004, 0]),
        ("idle_hold", [0, 2, -2, 6]),
        ("dc_link", [0, 2, 0, 0]),
    ],
)
def test_power_of_the_newer_laws(name: str, expected: list[float]) -> None:
    t = np.arange(2000) * STEP
    v = np.where((t >= 0.5) & (t < 1.5), 1.0, 0.0)[:, None] * [2.0, 1.0]
    tau = np.where(t < 1.0, 1.0, -1.0)[:, None] * [3.0, -4.0]
    power = electrical_power(Plant(PowerModel("x", (BY_NAME[name](**NEW[name]),))), t, v, tau)
    np.testing.assert_allclose(power[[100, 700, 1200, 1600]], expected, atol=1e-9)
    if name == "dc_link":  # what came back in the last half second, up to 1.5 J, is used first
        again = electrical_power(Plant(PowerModel("x", (BY_NAME[name](**NEW[name]),))), t, v, -tau)
        assert again[t < 1.0].max() == 0 and again[(t >= 1.0) & (t < 1.45)].max() == pytest.approx(0.0, abs=1e-9)


def test_newer_frictions_on_a_joint() -> None:
    v = np.array([0.5, -1.0])
    cases = {
        "asymmetric_friction": ({"tau_plus": [2.0, 3.0], "tau_minus": [1.0, 4.0]}, [2.0, -4.0]),
        "power_law_friction": ({"c": [2.0, 3.0], "exponent": 0.5}, [2.0 * 0.5**0.5, -3.0]),
        "friction_curve": ({"speed": [0.0, 0.5, 2.0], "torque": [[0.0, 1.5, 3.0], [0.0, 1.0, 2.5]]}, [1.5, None]),
    }
    for name, (values, expected) in cases.items():
        laws = JointLaws(Plant(PowerModel("x", (BY_NAME[name](**values),))), 2)
        torque = laws.damping(v, np.zeros(2)) * v
        for seen, wanted in zip(torque, expected, strict=True):
            assert wanted is None or seen == pytest.approx(wanted, rel=1e-4)
        assert torque[1] < -0.9


def test_specials_are_seen_where_they_should_be() -> None:
    body, start = arm("panda"), np.array([0.2, -0.3, 0.1, -1.7, 0.3, 1.5, 0.2])
    plain = Plant(base_model("panda"))
    cogged = Plant(base_model("panda"), (Cogging(amplitude=np.full(7, 2.0), periods=9.0, phase=0.2),))
    still = [play(MujocoArm(body, p), p, pose("x", start, 0.5)) for p in (plain, cogged)]
    moved = still[1].played.torque[-1] - still[0].played.torque[-1]
    np.testing.assert_allclose(moved, -2.0 * np.sin(9 * start + 0.2), atol=0.02)
    timed = Plant(base_model("panda"), (Fan(power=5.0, period=4.0), StandbyStep(power=3.0, time=10.0)))
    t = np.array([1.0, 3.0, 11.0])
    quiet = np.zeros((3, 7))
    gap = electrical_power(timed, t, quiet, quiet) - electrical_power(plain, t, quiet, quiet)
    np.testing.assert_allclose(gap, [5.0, 0.0, 3.0])


@pytest.mark.parametrize("name", list(SPECIAL_SIZES))
def test_every_special_changes_the_power(name: str) -> None:
    rng = np.random.default_rng(8)
    body = arm("panda")
    plain = Plant(base_model("panda"))
    odd = Plant(base_model("panda"), (draw_special(name, "panda", rng),))
    reference = excitation(body, rng, motions=1, poses=0)[0]
    power = [play(MujocoArm(body, p), p, reference, 0.3, 200.0).power for p in (plain, odd)]
    assert np.sqrt(np.mean((power[1] - power[0]) ** 2)) > 0.5


def test_a_set_is_written_as_the_contract_says(tmp_path: Path) -> None:
    body = arm("z1")
    rng = np.random.default_rng(4)
    references = excitation(body, rng, motions=1, poses=2)
    plant = Plant(base_model("z1"), (Fan(power=4.0),))
    seen = Instruments(meter_rate=50.0, noise=0.4, power_resolution=0.1, extra=("velocity",))
    runs = simulate(references, plant, body, tmp_path, seed=3, instruments=seen)
    log = tomllib.loads((tmp_path / "log.toml").read_text())
    assert log["format"] == "energy-opt/log/1" and [r["kind"] for r in log["run"]] == ["motion", "static", "static"]
    table = np.genfromtxt(tmp_path / log["run"][0]["file"], delimiter=",", names=True, deletechars="")
    assert table.dtype.names[:2] == ("time", "joint1.position") and "joint6.velocity" in table.dtype.names
    assert np.median(np.diff(table["time"])) == pytest.approx(0.008)
    steps = table["joint1.position"] / seen.position_resolution
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    meter = np.genfromtxt(tmp_path / log["run"][0]["power_file"], delimiter=",", names=True)
    assert np.diff(meter["time"]) == pytest.approx(0.02)
    true = np.interp(meter["time"], runs[0].played.time, runs[0].power)
    assert np.std(meter["power"] - true) == pytest.approx(0.4, rel=0.2)
    again = tmp_path / "again"
    simulate(references, plant, body, again, seed=3, instruments=seen)
    assert all((again / f.name).read_bytes() == f.read_bytes() for f in tmp_path.glob("*.csv"))


def test_plants_are_read_back_and_faults_are_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    file = tmp_path / "plant.toml"
    from energy_opt.files import write_toml

    plant = Plant(base_model("z1"), tuple(draw_special(name, "z1", rng) for name in SPECIAL_SIZES))
    write_toml(file, plant.to_document())
    back = load_plant(file)
    assert back.to_document().keys() == plant.to_document().keys()
    assert [type(s) for s in back.specials] == [type(s) for s in plant.specials]
    head = 'format = "energy-opt/model/1"\nrobot = "z1"\n'
    for text, words in (
        ('[[special]]\nname = "gremlin"\n', "gremlin"),
        ('[[special]]\nname = "fan"\npower = 3\nspeed = 1\n', "speed"),
        ('[[special]]\nname = "fan"\n', "power"),
        ('[[special]]\nname = "cogging"\namplitude = "big"\n', "amplitude"),
        ('[[effect]]\nname = "friction"\n', "friction"),
    ):
        file.write_text(head + text)
        with pytest.raises(BadInput, match=words):
            load_plant(file)
    with pytest.raises(BadInput, match="6 joints"):
        MujocoArm(arm("z1"), Plant(base_model("z1"), (Cogging(amplitude=np.ones(7)),)))


def test_a_jump_cannot_be_followed(tmp_path: Path) -> None:
    body, plant = arm("z1"), Plant(base_model("z1"))
    q = np.tile(np.full(6, 0.1), (400, 1))
    q[200:] += 1.0
    with pytest.raises(BadInput, match="does not follow"):
        MujocoArm(body, plant).play(q, np.zeros_like(q))


def test_without_mujoco_the_message_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from energy_opt.virtual_arm.mujoco_arm import import_mujoco\n"
        "from energy_opt.errors import BadInput\n"
        "try:\n    import_mujoco()\nexcept BadInput as e:\n    print(e)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install 'energy-opt[sim]'" in done.stdout


def test_every_arm_has_values_for_every_joint() -> None:
    for name, data in ARMS.items():
        n = arm(name).n
        assert len(data.r_over_kt2) == len(data.friction) == len(data.rotor) == n
        assert max(data.lifts) < n


def test_what_cannot_be_played_is_refused() -> None:
    plant = Plant(PowerModel("ur5", (Standby(power=90.0), RunOffset(power=[1.0, 2.0]))))
    with pytest.raises(BadInput, match="no law for run_offset"):
        plant.check(6)


def test_an_empty_list_of_trajectories_is_refused(tmp_path: Path) -> None:
    """It had written a set without runs, and then ended in an error of Python."""
    with pytest.raises(BadInput, match="no TRAJECTORY; give one or more to play"):
        eo.simulate([], plant=tmp_path / "plant.toml", robot="ur5e", out=tmp_path / "set")
    assert not (tmp_path / "set").exists()
