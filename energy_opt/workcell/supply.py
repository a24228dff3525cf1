"""The power that the robots of a cell draw: each from its own DC link, or all from a shared one.

With a shared link, one arm's braking can feed another's motion at that moment. So whole robots are shifted in the
cycle, and then the starts of moves within the neighbouring waits, for the least energy drawn and for the peak's bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from energy_opt.schedule import Move, Schedule, Wait
from energy_opt.schedule.problem import keeps
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.file import MOTORS, SupplyTable, WorkCell
from energy_opt.workcell.link import in_every_cycle

STEP, FINE = 5e-3, 1e-3  # [s] time steps of the power sums, while starts are shifted and in the result
INSTANT = 1e-9  # [s] a shorter step counts as a wait of this length
SHIFTS = (0.4, -0.4, 0.1, -0.1, 0.025, -0.025)  # [s] shifts of a start to try
ROUNDS = 4  # most sweeps over all moves
PHASES = 48  # shifts of a whole robot to try, in parts of the cycle; the best PROVEN of them are proven
PROVEN = 4
NOTHING = 1e-9  # relative: a price counts as lower only if it falls by more
ROOM = 0.99  # share of the power bound that shifting aims at: the finer grid finds higher peaks
COSTLY = 1e3  # [J/W, J/J] price of a watt above the bound, and of a joule that no resistor takes


@dataclass(frozen=True)
class Supplied:
    """The power that a cell draws in a cycle.

    Attributes:
        time: (N,) [s]; power: (N,) total power drawn [W].
        energy: [J]; lost: energy lost in resistors [J].
        peak: the largest power [W], of means over a step of the grid; bound: its limit.
        resistor: may energy that does not fit into the link be lost?
    """

    time: np.ndarray
    power: np.ndarray
    energy: float
    lost: float
    bound: float | None
    resistor: bool = True

    @property
    def peak(self) -> float:
        """The largest power [W]."""
        return float(self.power.max())

    @property
    def peak_time(self) -> float:
        """Time of the peak [s]."""
        return float(self.time[np.argmax(self.power)])

    @property
    def valid(self) -> bool:
        """True if the power's bound is kept, and a link without a resistor stores all braking energy."""
        return (self.bound is None or self.peak <= self.bound) and self.overflow == 0

    @property
    def overflow(self) -> float:
        """Braking energy that can be neither stored nor lost [J]."""
        return 0.0 if self.resistor else self.lost

    @property
    def price(self) -> float:
        """The objective of shifting [J]."""
        above = 0.0 if self.bound is None else max(0.0, self.peak - ROOM * self.bound)
        return self.energy + COSTLY * (above + self.overflow)


class Supply:
    """The supply of a cell's arms.

    Args:
        arms: by robot; None for one with only curves: it draws its mean power.
        step: of the grid [s]. first: under the first of several models, not their mean.
    """

    def __init__(self, cell: WorkCell, arms: Sequence[Arm | None], step: float = STEP, first: bool = False) -> None:
        self.cell, self.arms, self._first = cell, tuple(arms), first
        self.table = cell.supply or SupplyTable(shared=False)
        count = max(int(np.ceil(cell.cycle_time / step)), 2)
        self._step = cell.cycle_time / count
        self.time = (np.arange(count) + 0.5) * self._step
        # seconds after the start of a step, and the energies [J] until then at the link and elsewhere
        self._moves: dict[tuple[int, str, float], tuple[np.ndarray, ...]] = {}

    def drawn(self, schedule: Schedule, shared: bool) -> Supplied:
        """The power drawn by a schedule, from each robot's own link or from one that is `shared`."""
        bus, rest = (np.zeros((len(self.arms), len(self.time))) for _ in range(2))
        for r, k in _steps_of(schedule):
            self._add(schedule, r, k, bus[r], rest[r])
        drawn, lost = np.sum([self._at_link(b) for b in (bus.sum(axis=0, keepdims=True) if shared else bus)], axis=0)
        power = drawn + rest.sum(axis=0)
        energy, wasted = (float(each.sum() * self._step) for each in (power, lost))
        return Supplied(self.time, power, energy, wasted, self.table.max_power, self.table.resistor)

    def _at_link(self, bus: np.ndarray) -> np.ndarray:
        """Power (2, N) [W] that a link draws, and that it loses, under the drives' power `bus` (N,) [W].

        In a cell without a supply, the power is what the meter shows: models say what becomes of braking.
        """
        if self.cell.supply is None:
            return np.stack([bus, np.zeros_like(bus)])
        return np.array(in_every_cycle(bus * self._step, self.table.capacity)) / self._step

    def by_step(self, schedule: Schedule, shared: bool) -> Schedule:
        """The schedule with the energies that its steps take from the supply; they add up to the energy `drawn`.

        A step takes what it draws from the link less what it returns, and its share of what the link loses at that
        time: in proportion to the power that it returns then.
        """
        links = [0 if shared else r for r in range(len(self.arms))]
        bus, returned = np.zeros((2, len(links), len(self.time)))
        for r, k in _steps_of(schedule):
            power = self._powers(schedule, r, k)[0]
            bus[links[r]] += power
            returned[links[r]] -= power.clip(max=0)
        lost = np.array([self._at_link(of_one)[1] for of_one in bus]) / np.maximum(returned, NOTHING)
        energies = [np.zeros_like(of_robot) for of_robot in schedule.energies]
        for r, k in _steps_of(schedule):
            power, rest = self._powers(schedule, r, k)
            energies[r][k] = (power + rest - lost[links[r]] * power.clip(max=0)).sum() * self._step
        return replace(schedule, energies=tuple(energies))

    def _powers(self, schedule: Schedule, r: int, k: int) -> np.ndarray:
        """Power (2, N) [W] of one step at the link, and elsewhere."""
        out = np.zeros((2, len(self.time)))
        self._add(schedule, r, k, *out)
        return out

    def _add(self, schedule: Schedule, r: int, k: int, bus: np.ndarray, rest: np.ndarray) -> None:
        """Add a step's power to the grid: at the link (`bus`) if an arm moves or is held, else to `rest`.

        A cell of the grid gets the mean power of the step's part in it, so that no energy of a step is lost.
        """
        start, length = float(schedule.starts[r][k]), max(float(schedule.durations[r][k]), INSTANT)
        ring, arm = schedule.problem.rings[r], self.arms[r]
        if arm is None or schedule.modes[r][k] not in ("", MOTORS) or length <= INSTANT:
            at, energies = np.array([0.0, length]), [np.array([0.0, float(schedule.energies[r][k])])]
            into = [rest]
        else:
            key = (r, ring.steps[k].name, round(length, 6))
            if key not in self._moves:
                part = arm.parts(ring, schedule.starts[r], schedule.durations[r])[k]
                at = np.linspace(0, length, max(int(length / self._step) * 2, 2) + 1)
                powers = arm.powers(part, at, self._first)
                self._moves[key] = at, *(cumulative_trapezoid(power, at, initial=0) for power in powers)
            at, *energies = self._moves[key]
            into = [bus, rest]
        cells = np.arange(np.floor(start / self._step), np.floor((start + length) / self._step) + 1)
        edges = np.append(cells, cells[-1] + 1) * self._step - start
        for sums, until in zip(into, energies, strict=True):
            np.add.at(sums, cells.astype(int) % len(sums), np.diff(np.interp(edges, at, until)) / self._step)

    def heaviest(self, schedule: Schedule, found: Supplied) -> list[tuple[int, int]]:
        """Moves (robot, step) that make a schedule invalid, those with the largest share first.

        The share is of the power at its peak, or of the braking energy.
        """
        shares = {}
        for r, k in _steps_of(schedule):
            if isinstance(schedule.problem.rings[r].steps[k], Move):
                bus, rest = self._powers(schedule, r, k)
                shares[r, k] = float((bus + rest)[np.argmax(found.power)])
                if found.overflow > 0:
                    shares[r, k] = float(-bus.clip(max=0).sum())
        return sorted((move for move, share in shares.items() if share > 0), key=lambda move: -shares[move])

    def in_phase(self, schedule: Schedule, apart: Callable[[Schedule], bool]) -> Schedule:
        """The schedule with whole robots shifted later in the cycle, if the supply draws less.

        Args:
            apart: do the arms keep apart? Called for few schedules.
        """
        best, price = schedule, self.drawn(schedule, self.table.shared).price
        for r in range(1, len(schedule.starts)):
            found = []
            for k in range(1, PHASES):
                later = (*best.starts[:r], best.starts[r] + k * self.cell.cycle_time / PHASES, *best.starts[r + 1 :])
                if keeps(best.problem, later, best.durations):
                    moved = replace(best, starts=later)
                    found.append((self.drawn(moved, self.table.shared).price, k, moved))
            for now, _, moved in sorted(found, key=lambda x: x[:2])[:PROVEN]:
                if now < price - NOTHING * abs(price) and apart(moved):
                    best, price = moved, now
                    break
        return best

    def shifted(self, schedule: Schedule) -> Schedule:
        """The schedule with starts moved within the neighbouring waits, if the shared supply draws less."""
        best, price = schedule, self.drawn(schedule, self.table.shared).price
        for _ in range(ROUNDS):
            before = price
            for r, ring in enumerate(schedule.problem.rings):
                count = len(ring.steps)
                waits = [k for k, step in enumerate(ring.steps) if isinstance(step, Wait) and step.most > step.least]
                for one, two in zip(waits, [*waits[1:], *waits[:1]], strict=True):
                    if one == two:
                        continue
                    for shift in SHIFTS:
                        moved = _with_wait_shifted(best, r, one, two, count, shift)
                        if moved is None:
                            continue
                        now = self.drawn(moved, self.table.shared).price
                        if now < price - NOTHING * abs(price):
                            best, price = moved, now
            if price >= before * (1 - 1e-6):
                break
        return best


def _steps_of(schedule: Schedule) -> list[tuple[int, int]]:
    """Indices (robot, step) of every step."""
    return [(r, k) for r, ring in enumerate(schedule.problem.rings) for k in range(len(ring.steps))]


def _with_wait_shifted(schedule: Schedule, r: int, one: int, two: int, count: int, shift: float) -> Schedule | None:
    """The wait `one` longer by `shift` [s], the wait `two` shorter by it; None if that breaks a constraint."""
    ring = schedule.problem.rings[r]
    names = ("starts", "durations", "energies")
    starts, lengths, energies = (getattr(schedule, name)[r].copy() for name in names)
    for k, by in ((one, shift), (two, -shift)):
        step = ring.steps[k]
        assert isinstance(step, Wait)
        mode = next(mode for mode in step.modes if mode.name == schedule.modes[r][k])
        lengths[k] += by
        if not max(step.least, mode.shortest) <= lengths[k] <= step.most:
            return None
        energies[k] = mode.energy(lengths[k])
    k = one
    while k != two:
        k = (k + 1) % count
        starts[k] += shift
    changed: dict[str, Any] = {
        name: (*(old := getattr(schedule, name))[:r], new, *old[r + 1 :])
        for name, new in zip(names, (starts, lengths, energies), strict=True)
    }
    moved = replace(schedule, **changed)
    return moved if keeps(schedule.problem, moved.starts, moved.durations) else None
