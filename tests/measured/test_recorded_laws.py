"""Laws that follow what was recorded or went before: temperature, hours, signals, own heat, payloads in mid-run."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from logs import Z1, arm, lines, log, put
from scipy.integrate import solve_ivp

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.diagnosis.data.predict import predict, recorded, rigid_torque
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.effects import EXACT, Signals
from energy_opt.measured import read_set
from energy_opt.motion.judge.energy import Scorer
from energy_opt.power.motions import dwells, idle_time
from energy_opt.robot import PointMass

N = 6


def signals(v, **more):
    none = ca.DM.zeros(N)
    return Signals(none, ca.DM(v), none, none, ca.DM(0), **{key: ca.DM(x) for key, x in more.items()})


def torque(effect, x):
    return np.array(ca.evalf(ca.SX(effect.torque(x, effect.named(ca.DM(effect.full(N)), N), EXACT)))).ravel()


def test_friction_falls_with_the_joints_temperature_and_is_the_references_in_a_plan():
    v, warm = np.array([0.5, -0.5, 1.0, -2.0, 0.2, 0.0]), np.array([20.0, 25.0, 30.0, 40.0, 50.0, 60.0])
    effect = eo.TemperatureFriction(tau_c=2.0, b=0.8, rate=np.log(2) / 25, reference=30.0)
    dry = 2.0 * np.sign(v) + 0.8 * v
    np.testing.assert_allclose(torque(effect, signals(v, temperature=warm)), dry * 2.0 ** ((30 - warm) / 25))
    np.testing.assert_allclose(torque(effect, signals(v)), dry)


def test_friction_follows_the_time_of_day():
    v = np.array([0.5, -0.5, 1.0, -2.0, 0.2, 0.1])
    effect = eo.DailyFriction(tau_c=1.5, b=0.4, share=0.3, peak=6 * 3600.0)
    dry = 1.5 * np.sign(v) + 0.4 * v
    for hour, share in ((6, 1.3), (12, 1.0), (18, 0.7), (30, 1.3)):
        np.testing.assert_allclose(torque(effect, signals(v, day=3600.0 * hour)), dry * share, atol=1e-12)
    np.testing.assert_allclose(torque(effect, signals(v)), dry)  # a plan has no hour


def test_own_heat_is_that_of_the_thermal_model():
    rng, constant = np.random.default_rng(0), 25.0
    time = np.concatenate([np.arange(0, 8, 0.02), np.arange(20, 31, 0.02)])  # a gap between two runs
    heat = 10 + 8 * np.sin(time[:, None] * [1.0, 0.3] + rng.uniform(0, 6, 2))
    heat[400:] *= 2

    def rate(t, theta):
        return (heat[max(np.searchsorted(time, t, side="right") - 1, 0)] - theta) / constant

    truth = solve_ivp(rate, (0, time[-1]), [0.0, 0.0], t_eval=time, max_step=0.02, rtol=1e-6).y.T
    ours = eo.WindingSelfHeating.heated(time, heat, np.array([1.0, 1.0, constant]))
    np.testing.assert_allclose(ours, truth, atol=2e-3 * truth.max())


def test_a_dwell_is_a_standstill_between_two_motions_whatever_the_noise():
    time = np.arange(0, 6, 0.01)
    v = np.where((time % 2 > 0.5) & (time % 2 < 1.5), 0.4, 0.0)[:, None]
    v[np.array([170, 240, 380])] = 5e-3  # noise of one row at rest
    v[330] = 0.0  # one row without motion
    found = dwells(time, v)
    assert found[0] == 0 and found[-1] == 2
    np.testing.assert_allclose(time[np.flatnonzero(np.diff(found))], [2.0, 4.0], atol=0.02)
    assert not dwells(time, 0 * v).any()


@pytest.fixture(scope="module")
def recorded_set(tmp_path_factory):
    """A set of two runs of three moves each, with temperature, a digital output and a number beside."""
    folder, robot = tmp_path_factory.mktemp("set"), eo.load_robot("ur5")
    rng, entries = np.random.default_rng(3), []
    for k in range(2):
        t = np.arange(0, 6, 0.01)
        s = np.cumsum(np.where((t % 2 > 0.5) & (t % 2 < 1.5), np.sin(np.pi * (t % 2 - 0.5)) ** 2, 0.0)) * 0.01
        q = rng.uniform(-1, 1, N) + np.outer(s, rng.uniform(0.3, 0.8, N))
        warm = 22 + 3 * t[:, None] + np.arange(N)
        gripper, fill = (t > 3.304).astype(int), 1 + np.sin(t)
        cells = [[f"{x:.6f}" for x in row] for row in np.column_stack([t, q, warm])]
        rows = [
            [*row, "" if n % 7 == 3 else str(g), f"{f:.5f}", "3", "90.0"]  # what does not change is left empty
            for n, (row, g, f) in enumerate(zip(cells, gripper, fill, strict=True))
        ]
        names = ["time", *(f"{j}.position" for j in robot.joints), *(f"{j}.temperature" for j in robot.joints)]
        lines = [",".join([*names, "signal.gripper", "flow", "mode", "power"]), *(",".join(row) for row in rows)]
        (folder / f"r{k}.csv").write_text("\n".join(lines) + "\n")
        entries.append(f'[[run]]\nfile = "r{k}.csv"\nstart = {20.0 * k}\n')
    head = 'format = "energy-opt/log/1"\nrobot = "ur5"\n'
    (folder / "log.toml").write_text(head + "".join(entries) + '[columns]\n"signal.flow" = "flow"\n')
    return folder


def test_logged_signals_are_read_and_hold_until_they_change(recorded_set):
    measured = read_set(recorded_set)
    run = measured.runs[0]
    assert set(run.logged) == {"gripper", "flow"}  # `mode` is neither 0 and 1 nor asked for
    np.testing.assert_array_equal(run.logged["gripper"], run.time > 3.304)
    samples = take_samples(measured)
    assert {"signal.gripper", "signal.flow", "temperature", "dwell"} <= set(recorded(samples))
    assert "day" not in recorded(samples)  # a set of half a minute


def test_a_column_of_digits_is_offered_unasked(recorded_set, tmp_path):
    text = (recorded_set / "r0.csv").read_text().replace("signal.gripper", "DO_3")
    (tmp_path / "r0.csv").write_text(text)
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "ur5"\n[[run]]\nfile = "r0.csv"\n')
    assert set(read_set(tmp_path).runs[0].logged) == {"DO_3"}


def test_a_signal_that_no_file_has_is_one_line(recorded_set, tmp_path, capsys):
    (tmp_path / "r0.csv").write_text((recorded_set / "r0.csv").read_text())
    head = 'format = "energy-opt/log/1"\nrobot = "ur5"\n[[run]]\nfile = "r0.csv"\n[columns]\n'
    (tmp_path / "log.toml").write_text(head + '"signal.valve" = "DO9"\n')
    assert main(["check", str(tmp_path)]) == 2
    assert "no column 'DO9'" in capsys.readouterr().err
    (tmp_path / "log.toml").write_text(head + '"signal.a b" = "DO9"\n')
    assert main(["check", str(tmp_path)]) == 2
    assert "a name of letters" in capsys.readouterr().err


MODEL = eo.PowerModel(
    "ur5",
    (
        eo.Standby(power=80.0),
        eo.CopperLoss(r_over_kt2=[0.01] * 3 + [0.05] * 3),
        eo.WindingSelfHeating(rate=[0.02, 0.03, 0.01, 0.05, 0.04, 0.02], time_constant=20.0),
        eo.TemperatureFriction(tau_c=[2.0, 2.5, 1.5, 0.6, 0.5, 0.4], b=0.5, rate=0.03, reference=40.0),
        eo.SignalPower(power=[6.0, 1.5], signal="gripper,flow"),
        eo.PayloadChange(mass=1.7, com=[0.02, -0.03, 0.08], first=1.0, lasts=1.0),
    ),
)


def test_a_payload_is_there_from_one_dwell_to_the_next(recorded_set):
    measured = read_set(recorded_set)
    samples = take_samples(measured)
    tau, _ = rigid_torque(MODEL, samples)
    body, there = measured.robot.body, (samples.dwell >= 1) & (samples.dwell < 2)
    assert 0.2 < there.mean() < 0.5
    loaded = body.torque(samples.q, samples.v, samples.a, PointMass(1.7, np.array([0.02, -0.03, 0.08])))
    bare = body.torque(samples.q, samples.v, samples.a)
    np.testing.assert_allclose(tau, np.where(there[:, None], loaded, bare), atol=1e-9)


def test_the_power_of_a_recording_is_that_of_the_formulas(recorded_set):
    samples = take_samples(read_set(recorded_set))
    shown = predict(MODEL, samples)
    tau, r = rigid_torque(MODEL, samples)[0], np.array([0.01] * 3 + [0.05] * 3)
    dry = np.array([2.0, 2.5, 1.5, 0.6, 0.5, 0.4])
    rubs = (dry * np.sign(samples.v) + 0.5 * samples.v) * np.exp(-0.03 * (samples.temperature - 40.0))
    heat = r * (tau + rubs) ** 2
    theta, state, at = np.zeros_like(heat), np.zeros(N), samples.t
    for k in range(1, len(at)):
        state = heat[k - 1] + np.exp(-(at[k] - at[k - 1]) / 20.0) * (state - heat[k - 1])
        theta[k] = state
    more = 1 + np.array([0.02, 0.03, 0.01, 0.05, 0.04, 0.02]) * theta
    switched = 6.0 * samples.logged["gripper"] + 1.5 * samples.logged["flow"]
    by_hand = 80 + (heat * more + (tau + rubs) * samples.v).sum(axis=1) + switched
    np.testing.assert_allclose(shown.power, by_hand, atol=2e-3 * np.abs(by_hand).max())


def test_derivatives_agree_with_finite_differences(recorded_set):
    """Of friction and copper loss only to a tenth: what they do to the heat of before is left out of the slope."""
    samples = take_samples(read_set(recorded_set))
    values, exact = MODEL.values(N), predict(MODEL, samples).jacobian
    for effect, where in zip(MODEL.effects, MODEL.slices(N), strict=True):
        fixed = [p.steps for p in effect.parameters for _ in range(p.count(N, effect.extents))]
        close = 0.1 if effect.name in ("copper_loss", "temperature_friction", "payload_change") else 1e-3
        for k in (where.start + np.flatnonzero(~np.array(fixed)))[::3]:
            step = 1e-4 * max(abs(values[k]), 1e-2)
            high, low = (predict(MODEL.with_values(values + s * (np.arange(len(values)) == k), N), samples).reading
                         for s in (step, -step))  # fmt: skip
            slope = (high - low) / (2 * step)
            np.testing.assert_allclose(exact[:, k], slope, atol=close * max(np.abs(slope).max(), 1e-9))


def test_in_a_plan_they_are_at_rest():
    """Cold windings, signals off, the reference's friction, the move's own payload."""
    robot = eo.load_robot("ur5")
    bare = eo.PowerModel("ur5", MODEL.effects[:2]) + eo.CoulombFriction(tau_c=[2.0, 2.5, 1.5, 0.6, 0.5, 0.4])
    bare = bare + eo.ViscousFriction(b=0.5)
    q, v, a = np.random.default_rng(1).normal(size=(3, 20, N))
    t = np.linspace(0, 2, 20)
    np.testing.assert_allclose(Scorer(robot, MODEL).drive(q, v, a, t)[1], Scorer(robot, bare).drive(q, v, a, t)[1])


def test_a_model_file_keeps_signals(tmp_path):
    MODEL.save(tmp_path / "model.toml")
    assert eo.load_model(tmp_path / "model.toml").effects == MODEL.effects
    with pytest.raises(eo.BadInput, match="2 signals and 1 powers"):
        eo.SignalPower(power=3.0, signal=["gripper", "brake"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "arm", "seed"),
    [
        ("signal_power", "panda", 700),
        ("temperature_friction", "ur5", 701),
        ("payload_change", "panda", 702),
        ("winding_self_heating", "xarm7", 703),
    ],
)
def test_diagnose_finds_them_in_worlds_of_other_formulas(cause, arm, seed, tmp_path):
    pytest.importorskip("mujoco")
    from misfit_world import World, write_world

    truth = write_world(World(arm, seed, (0.0, 0.0), cause=cause), tmp_path / "set")
    found = eo.diagnose(truth.folder, truth.declared).document()
    assert [row["name"] for row in found["effects"]] == [cause]


def test_idle_time_ignores_short_stops_and_single_noisy_speeds() -> None:
    time = np.arange(0, 4, 0.01)
    v = np.where((time > 0.995) & (time < 1.995), 0.5, 0.0)[:, None]
    clean = idle_time(time, v)
    assert (clean[:100] == -1).all() and (clean[100:200] == -1).all()
    np.testing.assert_allclose(clean[200:], time[200:] - time[199])
    noisy = v.copy()
    noisy[150:155] = 0.0  # the speed passes through zero within the motion
    noisy[[40, 250, 320]] = 0.02  # noise at standstill
    np.testing.assert_array_equal(idle_time(time, noisy), clean)


def test_a_signal_switches_within_a_mean_of_readings(tmp_path: Path) -> None:
    """Three readings are averaged: beside the signal's value in their middle, each switch left a third of its power."""
    t, q, _, _ = arm(Z1)
    on = (np.arange(len(t)) > 300).astype(float)
    header = ",".join(["time", *(f"{j}.position" for j in Z1.joints), "power", "signal.gripper"])
    put(tmp_path / "a.csv", lines(header, [t, q, 50 + 9 * on, on]))
    samples = take_samples(read_set(log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')))
    np.testing.assert_allclose(samples.power, 50 + 9 * samples.logged["gripper"], atol=1e-6)
