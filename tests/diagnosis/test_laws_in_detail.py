"""What a law's effect depends on beside the motion: the set's other runs, the form of the law, numbers with steps.

Also the noise beside free functions.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.clusters import clusters
from energy_opt.diagnosis.data.noise import Noise, weighed
from energy_opt.diagnosis.data.noise import weighted as with_weights
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.data.samples import Samples
from energy_opt.diagnosis.evidence.errors import quality
from energy_opt.diagnosis.fit.candidates import travel
from energy_opt.diagnosis.fit.posterior import Nuisance
from energy_opt.diagnosis.fit.posterior import World as Setting
from energy_opt.diagnosis.hypothesis.links import links_of
from energy_opt.diagnosis.hypothesis.terms import Scale, Term, chart
from energy_opt.diagnosis.search.effect_sets import Search, without
from energy_opt.diagnosis.search.kinks import other_drives, sizes
from energy_opt.effects import IdleHold, MotionPower, Regeneration, WindingSelfHeating
from energy_opt.measured import read_set
from energy_opt.virtual_arm.simulate import Instruments

pytest.importorskip("mujoco")
from misfit_world import World, write_world
from virtual_sets import make_set

INSTRUMENTS = Instruments(noise=0.6, power_resolution=0.05)


def test_a_declared_effect_that_is_not_refitted_stays_for_those_that_need_it():
    """Copper loss with its declared values is what a winding's temperature needs."""
    terms = [Term("copper_loss", declared=True), Term("winding_temperature")]
    f = SimpleNamespace(charts=[SimpleNamespace(term=t) for t in terms], numbers=[1, 2], free=(), nuisance=0, amounts=0)
    found = SimpleNamespace(fitted=lambda charts, *rest: [c.term.name for c in charts])
    assert without(found, f, 0) == ["winding_temperature"]
    f.charts[0].term = Term("copper_loss")
    assert without(found, f, 0) == []


def test_windings_are_as_warm_as_the_whole_set_made_them(tmp_path):
    """Some of the runs alone foresee the same power as within their set; so do temperatures relative to it."""
    truth = write_world(World("z1", 5, motions=3, poses=1), tmp_path)
    samples = take_samples(read_set(truth.folder))
    warming = np.linspace(20, 30, len(samples.t))[:, None] + np.zeros(samples.n)
    samples = replace(samples, temperature=warming)
    model = truth.declared.replaced(WindingSelfHeating(rate=0.2, time_constant=60.0))
    whole = predict(model, samples)
    for runs in ([1, 3], [0, 2]):
        part, rows = samples.part(runs), np.concatenate([np.arange(samples.t.size)[samples.slices[r]] for r in runs])
        assert np.allclose(part.warmth, samples.warmth[rows])
        assert np.allclose(predict(model, part).power, whole.power[rows], rtol=1e-9)
    assert np.ptp(whole.power - predict(truth.declared, samples).power) > 0.01


@pytest.mark.slow
def test_heat_that_grows_faster_than_the_square_of_torque_is_no_copper_loss(tmp_path):
    """A saturated motor's: a larger resistance explains nine tenths of it."""
    truth = write_world(World("xarm7", 300007, (0.0, 0.05), "ar1", unlisted="saturation"), tmp_path)
    assert not diagnose(read_set(truth.folder), truth.declared).effects


@pytest.mark.parametrize(
    "world",
    [
        World("z1", 12000010, (0.0, 0.05), "ar1", unlisted="current_offset"),  # a loss in proportion to signed torque
        pytest.param(  # friction that builds up over some travel
            World("panda", 12000042, (0.0, 0.05), "ar1", unlisted="dahl"), marks=pytest.mark.slow
        ),
        pytest.param(  # a supply that switches by its load
            World("xarm7", 12010011, (0.0, 0.05), "ar1", "viscous_friction", unlisted="phases"), marks=pytest.mark.slow
        ),
    ],
    ids=lambda world: world.unlisted,
)
def test_a_law_that_no_effect_has_is_not_claimed_as_another(tmp_path, world):
    truth = write_world(world, tmp_path)
    assert {e.name for e in diagnose(read_set(truth.folder), truth.declared).effects} <= {world.cause}


def test_the_form_of_a_law_is_tested_as_the_meter_shows_it(tmp_path):
    """A load that a signal switches, of which a meter's lag is likely: its edges are those of the lagging power."""
    truth = write_world(World("panda", 11830020, (0.0, 0.0), "white", "signal_power"), tmp_path)
    assert "signal_power" in {e.name for e in diagnose(read_set(truth.folder), truth.declared).effects}


def test_travel_counts_from_the_begin_of_a_run_and_from_each_reversal():
    """A swing of amplitude 1 rad from its end: the path from one end, |1 - cos t| and |1 + cos t|."""
    t = np.linspace(0, 3 * np.pi, 3001)
    way = travel(np.sin(t)[:, None], t, [slice(0, 2001), slice(2001, 3001)])[:, 0]
    expected = np.concatenate([1 - np.cos(t[:1001]), 1 + np.cos(t[1001:2001]), 1 - np.cos(t[2001:])])
    assert way == pytest.approx(expected, abs=0.01)


def test_paths_of_slides_are_compared_by_how_far_slides_move():
    """Two motions of 40 mm that differ by 15 mm midway are no repeats; two that differ by 0.3 mm are."""
    s, rows = np.linspace(0, 1, 51), 51
    paths = [0.04 * s, 0.04 * s + 0.015 * np.sin(np.pi * s), 0.04 * s + 0.0003 * np.sin(np.pi * s)]
    q = np.concatenate([np.column_stack([path, s]) for path in paths])
    samples = SimpleNamespace(
        q=q, v=np.ones_like(q), t=np.tile(s, 3), slices=[slice(rows * k, rows * (k + 1)) for k in range(3)],
        kinds=("motion",) * 3, body=SimpleNamespace(slides=(True, False)),
    )  # fmt: skip
    samples.unit = Samples.unit.func(samples)
    assert clusters(samples) == [[0, 2], [1]]
    samples.v[:, 0] = 0.0  # a slide that stands still
    assert Samples.unit.func(samples).tolist() == [1.0, 1.0]


def test_white_noise_is_seldom_taken_for_noise_with_memory():
    """Evidence of first-order noise beside white noise, by the dense covariance of 150 readings at 10 Hz."""
    count, rng = 150, np.random.default_rng(0)
    lag = 0.1 * np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    waves = (0.0, 0.3, 0.6, 1.0)
    dense = {(w, m): np.eye(count) + w**2 * np.exp(-lag / m) for w in waves for m in (0.08, 0.25, 0.7, 2.0)}
    taken = {key: (np.linalg.inv(c), np.linalg.slogdet(c)[1]) for key, c in dense.items()}

    def remembered(x: np.ndarray) -> bool:
        def worth(wave: float, memory: float) -> tuple[float, float]:
            inverse, determinant = taken[wave, memory]
            white = float(x @ inverse @ x) / count
            return -0.5 * count * np.log(white) - 0.5 * determinant, white**0.5

        return max(weighed(worth, 0.0, count, waves), key=lambda row: row[0])[1].wave > 0

    assert np.mean([remembered(rng.normal(size=count)) for _ in range(200)]) < 0.05
    slow = np.linalg.cholesky(dense[1.0, 0.7])
    assert np.mean([remembered(slow @ rng.normal(size=count)) for _ in range(20)]) > 0.9


@pytest.mark.slow
def test_of_durations_that_no_dwell_tells_apart_the_middle_one_is_taken(tmp_path):
    """A hold of 0.8 s where dwells last up to 0.61 s: 0.6 s leaves the last readings of a dwell unexplained.

    Its end is not known, as no dwell lasts so long; that of a hold of 0.3 s is known to a reading.
    """
    made = make_set(tmp_path / "set", "ur5", [IdleHold(power=8.0, duration=0.8)], seed=3, instruments=INSTRUMENTS)
    found = diagnose(read_set(made.folder), made.declared)
    assert (found.verdict, [x.name for x in found.effects]) == ("explained", ["idle_hold"])
    low, high = found.effects[0].ci95["duration"]
    assert low < 0.6 and high > 0.8
    short = make_set(tmp_path / "short", "ur5", [IdleHold(power=8.0, duration=0.3)], seed=3, instruments=INSTRUMENTS)
    found = diagnose(read_set(short.folder), short.declared)
    low, high = found.effects[0].ci95["duration"]
    assert low < 0.3 < high and 0.5 * found.samples.step < high - low < 3 * found.samples.step


def test_readings_at_the_end_of_a_hold_have_less_weight(tmp_path):
    """Speeds show the end of a motion, from which the hold lasts, a reading early or late."""
    made = make_set(tmp_path / "set", "ur5", [IdleHold(power=15.0, duration=0.25)], seed=3)
    samples = take_samples(read_set(made.folder))
    weight = with_weights(samples, predict(made.declared, samples), [1] * len(samples.parts)).weight
    ends = np.flatnonzero((samples.idle[:-1] < 0.25) & (samples.idle[1:] >= 0.25))
    least = [weight[k - 2 : k + 3].min() for k in ends]
    assert len(ends) > 5 and np.mean(np.array(least) < 0.2) > 0.8


def test_readings_beside_a_step_count_neither_in_the_fit_nor_against_a_model(tmp_path):
    """Where the power jumps as a motion begins, a reading a moment early or late is off by the jump."""
    made = make_set(
        tmp_path / "set", "ur5", [MotionPower(power=30.0)], seed=3, motions=3, poses=0,
        instruments=Instruments(noise=0.3, power_resolution=0.01),
    )  # fmt: skip
    samples = take_samples(read_set(made.folder))
    model = made.declared.replaced(MotionPower(power=30.0))
    samples = with_weights(samples, predict(model, samples), [1] * len(samples.parts))
    edges = 1 + np.flatnonzero(np.diff(samples.moving))
    assert max(samples.weight[k - 1 : k + 1].max() for k in edges) < 2 * samples.noise / 30.0
    assert samples.doubted[edges].all()
    found = quality(model, samples, Noise(samples.noise), np.zeros(len(samples.parts)))
    assert found.motion < 1.2 * found.noise_motion


def test_the_whole_range_of_a_number_with_steps_is_searched():
    """From the shortest hold on, which is far below a thousandth of the longest."""
    assert sizes(0.05, 1e3)[0] == pytest.approx(0.05)
    assert sizes(0.0, 200.0)[0] == pytest.approx(0.2)


def test_a_law_of_negative_power_is_tried_in_place_of_effects_that_imitate_it(tmp_path):
    """Friction of the whole load beside a gain takes the negative power of each joint away."""
    made = make_set(
        tmp_path / "set", "ur5", [Regeneration(efficiency=0.0, level="joint")], seed=3, motions=3, poses=0,
        instruments=Instruments(noise=0.3, power_resolution=0.01),
    )  # fmt: skip
    measured = read_set(made.folder)
    samples, declared = take_samples(measured), made.declared
    scale, links = Scale.of(measured.robot.limits, samples.power), links_of(samples, declared)
    found = Search(Setting.of(samples, declared, scale, links, Noise(samples.noise)))
    charts = [chart(Term(name), declared, scale, samples.n) for name in ("load_friction", "meter_gain")]
    amounts = np.zeros(links.basis.shape[1])
    both = found.fitted(charts, [c.origin for c in charts], [], Nuisance(0.025, 0.01), amounts)
    likeliest = max([both, *other_drives(found, both)], key=found.score)
    assert [c.term for c in likeliest.charts] == [Term("regeneration", ("level=joint",))]
