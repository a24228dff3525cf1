"""A measured set as arrays: one `Run` per run, joints in the robot's order, SI units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from energy_opt.robot import PointMass, Robot

JOINT_SIGNALS = ("position", "velocity", "acceleration", "effort", "current", "temperature")


@dataclass(frozen=True)
class Run:
    """One run; time counts from the run's own zero. Joint samples (N) and meter readings (M) have stamps of their own.

    A reading is the mean of the power over the `window` that ends at its stamp, and the power at the stamp where that
    is 0. A counter's reading is the mean power since its reading before; a total is one reading over the whole run.
    `energy_opt.measured.meter` takes a model's power to the readings.

    Attributes:
        file: its name in the log; pieces of a cut recording are called file#1, file#2, ...
        kind: "motion" or "static".
        start: set time of the run's time 0, s.
        time: (N,) s, increasing. position: (N, n) rad.
        velocity, acceleration, effort, temperature, current: (N, n) rad/s, rad/s^2, N m, degC, A, or None where not
            logged.
        power_time, power: (M,) s on the run's clock, and W.
        window: (M,) s, how long a reading's mean reaches back from its stamp; 0 is the power at the stamp.
        meter: "power", "energy" (differences of a counter) or "total" (one reading).
        clock: "shared" with the joints, "stated" in log.toml, or "estimated" by correlation; an estimated clock is
            known to a fraction of a reading, so a delay found on it says nothing of the meter.
        logged: by name what else was recorded at the joints' stamps, (N,): 0 and 1 of digital signals, or numbers.
        lines: (N,) lines of the file (its first is 1), where the run comes from one.
    """

    file: str
    kind: str
    start: float
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None
    acceleration: np.ndarray | None
    effort: np.ndarray | None
    temperature: np.ndarray | None
    power_time: np.ndarray
    power: np.ndarray
    current: np.ndarray | None = None
    window: np.ndarray = field(default_factory=lambda: np.zeros(0))
    meter: str = "power"
    clock: str = "shared"
    lines: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    logged: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.window) != len(self.power):
            object.__setattr__(self, "window", np.zeros(len(self.power)))

    def logged_at(self, samples: slice | np.ndarray) -> dict[str, np.ndarray]:
        """`logged` at some joint samples."""
        return {name: values[samples] for name, values in self.logged.items()}

    def joint_signals(self) -> Iterator[tuple[str, np.ndarray]]:
        """Name and (N, n) values of every joint signal that is logged."""
        for name in JOINT_SIGNALS:
            values = getattr(self, name)
            if values is not None:
                yield name, values


@dataclass(frozen=True)
class MeasuredSet:
    """All runs of a set.

    `clock` is True where the log states every run's set time; `payload` is what the recorder states, where it does;
    `remarks` say what reading it took: samples dropped, recordings cut, clocks found.
    """

    path: Path
    robot: Robot
    runs: tuple[Run, ...]
    clock: bool
    payload: PointMass | None = None
    remarks: tuple[str, ...] = ()
