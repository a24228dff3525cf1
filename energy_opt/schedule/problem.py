"""What is scheduled: rings of moves and waits, time lags between them, and zones that one robot at a time may use."""

from __future__ import annotations

from dataclasses import dataclass

from energy_opt.schedule.curves import Curve


@dataclass(frozen=True)
class Mode:
    """A mode in which a robot waits.

    Attributes:
        name: for results; power: while it lasts [W].
        least: shortest duration, entry and exit included [s].
        enter, leave: seconds [s] and energy [J] of entry and exit.
    """

    name: str
    power: float
    least: float = 0.0
    enter: tuple[float, float] = (0.0, 0.0)
    leave: tuple[float, float] = (0.0, 0.0)

    @property
    def shortest(self) -> float:
        """The shortest wait in this mode [s]."""
        return max(self.least, self.enter[0] + self.leave[0])

    @property
    def fixed(self) -> float:
        """Energy [J] beyond power * duration: E = power * duration + fixed."""
        return self.enter[1] + self.leave[1] - self.power * (self.enter[0] + self.leave[0])

    def energy(self, duration: float) -> float:
        """Energy [J] of a wait of `duration` [s] in this mode."""
        return self.power * duration + self.fixed


@dataclass(frozen=True)
class Move:
    """A motion. Its duration [s] lies in [least, most]; `curve` gives its energy."""

    name: str
    least: float
    most: float
    curve: Curve


@dataclass(frozen=True)
class Wait:
    """A stay at one place. Its duration [s] lies in [least, most]; one of `modes` is chosen."""

    name: str
    least: float
    most: float
    modes: tuple[Mode, ...]


@dataclass(frozen=True)
class Ring:
    """The steps of one robot, in order; the first follows the last, one cycle later."""

    name: str
    steps: tuple[Move | Wait, ...]


@dataclass(frozen=True)
class Lag:
    """start(to) - start(from) >= length - cycle_time * height, in seconds.

    Attributes:
        begin, end: pairs (ring, step) of indices: "from" and "to".
        begin_ends: does the lag count from the end of step `begin` (else from its start)?
        length: [s].
        height: cycles between the two; None lets the solver choose it.
        most: the lag is at most this [s]; None for no bound.
        within: start(to) - start(from) is at most this [s]; None for no bound.
    """

    begin: tuple[int, int]
    end: tuple[int, int]
    length: float
    height: int | None = 0
    begin_ends: bool = False
    most: float | None = None
    within: float | None = None


@dataclass(frozen=True)
class Run:
    """Consecutive steps of a ring, as an interval of time.

    Attributes:
        ring, first, last: indices; `last` is smaller than `first` where the run passes the end of the ring.
        part: shares of the duration of `first` at which the interval begins and ends; None for the whole run.
    """

    ring: int
    first: int
    last: int
    part: tuple[float, float] | None = None


@dataclass(frozen=True)
class Exclusion:
    """Two runs of different rings that may not overlap in time, in any cycle; `gap` seconds lie between them."""

    first: Run
    second: Run
    gap: float = 0.0


@dataclass(frozen=True)
class Problem:
    """A cell. `cycle_time` in seconds."""

    cycle_time: float
    rings: tuple[Ring, ...]
    lags: tuple[Lag, ...] = ()
    exclusions: tuple[Exclusion, ...] = ()
