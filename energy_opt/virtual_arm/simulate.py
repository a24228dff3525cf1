"""Playback of motions on a virtual arm, and output of its instruments' readings as a measured set."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import replacing, write_toml
from energy_opt.robot import Robot
from energy_opt.virtual_arm.drives import electrical_power, reading
from energy_opt.virtual_arm.mujoco_arm import STEP, MujocoArm, Played
from energy_opt.virtual_arm.plant import Plant


@dataclass(frozen=True)
class Reference:
    """Samples of a motion. The arm rests before the first and after the last one.

    Attributes:
        name: of the run in the set.
        time: (N,) [s].
        position, velocity: (N, n) [rad, rad/s].
    """

    name: str
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def static(self) -> bool:
        """True if no joint moves."""
        return bool(np.ptp(self.position, axis=0).max() < 1e-9)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity (M, n) at times t (M,) from the first sample on: cubic Hermite, at rest outside."""
        from scipy.interpolate import CubicHermiteSpline

        curve = CubicHermiteSpline(self.time - self.time[0], self.position, self.velocity)
        inside = np.clip(t, 0.0, self.duration)
        return curve(inside), np.where((inside == t)[:, None], curve(inside, 1), 0.0)


def pose(name: str, position: np.ndarray, duration: float) -> Reference:
    """A reference that holds `position` (n,) for `duration` [s]."""
    two = np.tile(position, (2, 1))
    return Reference(name, np.array([0.0, duration]), two, np.zeros_like(two))


LOG_FORMAT = "energy-opt/log/1"
SLOWEST = 1e-3  # [Hz] least rate of readings
EXTRA = "velocity", "effort"  # further signals that can be logged
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Instruments:
    """Instruments of a run.

    Attributes:
        rate: encoder samples per second, Hz.
        meter_rate: readings of the meter per second on its own clock, Hz; None: in the encoders' file.
        noise: standard deviation of the meter's noise, W.
        power_resolution: of the meter, W.
        position_resolution: of the encoders, rad.
        jitter: standard deviation of the sampling times, s (recorded as they fall, to 0.5 ms).
        rest: standing still before and after each motion, s.
        extra: further signals to log: "velocity", "effort".
    """

    rate: float = 125.0
    meter_rate: float | None = None
    noise: float = 0.6
    power_resolution: float = 0.02
    position_resolution: float = 2e-5
    jitter: float = 0.0
    rest: float = 0.3
    extra: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        numbers = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "extra"}
        for name, value in numbers.items():
            if value is not None and not np.isfinite(value):
                raise BadInput(f"instruments: {name} = {value!r}; expected a finite number")
        for name in ("power_resolution", "position_resolution"):
            if not getattr(self, name) > 0:
                raise BadInput(f"instruments: {name} = {getattr(self, name)!r}; expected a number above 0")
        for name, rate in (("rate", self.rate), ("meter_rate", self.meter_rate)):
            if rate is not None and not rate >= SLOWEST:
                raise BadInput(f"instruments: {name} = {rate!r}; expected {SLOWEST:g} Hz or more")
        if self.rate > 1 / STEP or (self.meter_rate or 0) > 1 / STEP:
            raise BadInput(f"instruments: no rate above {1 / STEP:g} Hz, the simulation's own")
        for name in ("noise", "jitter", "rest"):
            if getattr(self, name) < 0:
                raise BadInput(f"instruments: {name} = {getattr(self, name):g}; expected 0 or more")
        for name in self.extra:
            if name not in EXTRA:
                raise BadInput(f"instruments: extra signal {name!r}; known: {', '.join(EXTRA)}")


@dataclass(frozen=True)
class Run:
    """One true run: the motion played, and the true power.

    Attributes:
        file: its file in the set.
        played: the true motion and torque.
        power: true power at the mains, W, at `played.time`; without the meter's own effects.
        start: set time of its time 0, s.
    """

    file: str
    played: Played
    power: np.ndarray
    start: float

    @property
    def duration(self) -> float:
        """Duration, rest included, s."""
        return STEP * len(self.power)

    @property
    def energy(self) -> float:
        """True energy over the run, J."""
        return float(self.power.sum() * STEP)


def play(arm: MujocoArm, plant: Plant, reference: Reference, rest: float = 0.0, start: float = 0.0) -> Run:
    """Play one motion.

    Args:
        arm: that plays it. plant: its effects. reference: the motion. rest: [s] of standing before and after.
        start: [s] the set time of its beginning.
    """
    if reference.static:
        played = arm.hold(reference.position[0], reference.duration)
    else:
        steps = round((reference.duration + 2 * rest) / STEP) + 1
        played = arm.play(*reference.at(np.arange(steps) * STEP - rest))
    power = electrical_power(plant, start + played.time, played.velocity, played.torque)
    return Run(f"{reference.name}.csv", played, power, start)


def simulate(
    references: Sequence[Reference],
    plant: Plant,
    robot: Robot,
    folder: Path,
    *,
    seed: int = 0,
    instruments: Instruments | None = None,
    starts: Sequence[float] | np.ndarray | None = None,
    truth: Mapping[str, Any] | None = None,
) -> list[Run]:
    """Play motions on a virtual arm, and write the readings of its instruments as a measured set.

    Args:
        references: the motions, in order.
        plant: the true drives of the arm.
        robot: the arm.
        folder: for log.toml, the runs' CSV files and truth.toml.
        seed: of the noise and the clocks.
        instruments: rates, noise and resolutions (None: the defaults).
        starts: [s] set time of each run's time 0; by default one after the other, 2 s apart.
        truth: further content of truth.toml.

    Returns:
        The runs as they truly were.

    Raises:
        BadInput: MuJoCo is not installed, the plant does not fit the robot, or the arm cannot follow a motion.
    """
    seen = instruments or Instruments()
    rng = np.random.default_rng(seed)
    arm = MujocoArm(robot, plant)
    runs: list[Run] = []
    entries = []
    now = 0.0
    whole, done = sum(r.duration for r in references), 0.0
    for k, reference in enumerate(references):
        log.info("run %d of %d", k + 1, len(references), extra={"share": done / max(whole, 1e-9)})
        done += reference.duration
        start = now if starts is None else float(starts[k])
        run = play(arm, plant, reference, seen.rest, start)
        now = start + run.duration + 2.0
        runs.append(run)
        entry: dict[str, Any] = {"file": run.file, "kind": "static" if reference.static else "motion", "start": start}
        entry |= _write_run(folder, run, plant, arm.joints, seen, rng)
        entries.append(entry)
    write_toml(folder / "log.toml", {"format": LOG_FORMAT, "robot": robot.named_in(folder), "run": entries})
    document = {
        "noise_rms": seen.noise,
        "resolution": seen.power_resolution,
        "noise_floor": float(np.hypot(seen.noise, seen.power_resolution / np.sqrt(12))),
        "energy_used": [run.energy for run in runs],
        **(truth or {}),
        **{key: value for key, value in plant.to_document().items() if key in ("robot", "effect", "special")},
    }
    write_toml(folder / "truth.toml", document)
    return runs


def _clock(length: float, rate: float, jitter: float, offset: float, rng: np.random.Generator) -> np.ndarray:
    """Sampling times within [0, length], s."""
    times = offset + np.arange(int((length - offset) * rate) + 1) / rate
    if jitter > 0:
        bound = 0.4 / rate
        times = times + np.clip(rng.normal(0.0, jitter, len(times)), -bound, bound)
        times = np.round(np.clip(times, 0.0, length) / (STEP / 2)) * (STEP / 2)
        times = times[np.r_[True, np.diff(times) > 0]]
    return times


def _write_run(
    folder: Path, run: Run, plant: Plant, joints: Sequence[str], seen: Instruments, rng: np.random.Generator
) -> dict[str, str]:
    """Write a run's files; returns the entry of a power file for log.toml."""
    played = run.played
    length = float(played.time[-1])
    times = _clock(length, seen.rate, seen.jitter, 0.0, rng)
    step = seen.position_resolution
    header, columns, digits = ["time"], [times], [4]
    for j, joint in enumerate(joints):
        true = np.interp(times, played.time, played.position[:, j])
        header.append(f"{joint}.position")
        columns.append(np.round((true + rng.normal(0.0, step / 3, len(times))) / step) * step)
        digits.append(_decimals(step))
    signals = {"velocity": (played.velocity, 1e-3, 5), "effort": (played.torque, 0.02, 3)}
    for name in seen.extra:
        values, noise, places = signals[name]
        for j, joint in enumerate(joints):
            header.append(f"{joint}.{name}")
            columns.append(np.interp(times, played.time, values[:, j]) + rng.normal(0.0, noise, len(times)))
            digits.append(places)
    shown = reading(plant, played.time, run.power, STEP)
    aside = seen.meter_rate is not None
    if seen.meter_rate is not None:
        clock = _clock(length, seen.meter_rate, 0.0, float(rng.uniform(0, 0.5 / seen.meter_rate)), rng)
    else:
        clock = times
    watts = np.interp(clock, played.time, shown) + rng.normal(0.0, seen.noise, len(clock))
    watts = np.round(watts / seen.power_resolution) * seen.power_resolution
    places = _decimals(seen.power_resolution)
    if not aside:
        _write_columns(folder / run.file, [*header, "power"], [*columns, watts], [*digits, places])
        return {}
    _write_columns(folder / run.file, header, columns, digits)
    name = f"{Path(run.file).stem}_power.csv"
    _write_columns(folder / name, ["time", "power"], [clock, watts], [4, places])
    return {"power_file": name}


def _decimals(step: float) -> int:
    """Decimal places that show every multiple of `step`, or a thousandth of it."""
    places, most = 0, max(9, 3 - int(np.floor(np.log10(step))))
    while places < most and abs(round(step * 10**places) / (step * 10**places) - 1) > 1e-6:
        places += 1
    return places


def _write_columns(path: Path, header: Sequence[str], columns: Sequence[np.ndarray], digits: Sequence[int]) -> None:
    """A CSV file with the number of decimals that each instrument shows."""
    form = ",".join(f"%.{places}f" for places in digits)
    with replacing(path) as aside:
        np.savetxt(aside, np.column_stack(columns), form, header=",".join(header), comments="", encoding="utf-8")
