"""Search for the likeliest hypothesis: compare linearised sets around a fit, refit the best, repeat until it stays.

Around a fit, effects and free functions are added, dropped, swapped (also one for two) and added in pairs while the
evidence of the set grows; the resulting set is fitted. A set that does not improve once fitted is not tried again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from energy_opt.diagnosis.evidence.odds import Bank, Block, Subset, Weighed
from energy_opt.diagnosis.fit.candidates import Candidate, candidates, functions
from energy_opt.diagnosis.fit.posterior import Fit, Free, Nuisance, World, fit
from energy_opt.diagnosis.hypothesis.terms import Chart, Term, chart

# Prior log odds of an effect (one in fifty), of a refitted declared effect, of a free function. RARE is added before an
# effect is claimed; it excludes no alternative.
ODDS, REFIT_ODDS, FREE_ODDS = -4.0, -3.0, -5.0
RARE = {"iron_loss": -3.0, "psu_loss": -2.0, "asymmetric_friction": -1.5, "power_law_friction": -2.0,
        "thermal_viscous": -1.5}  # fmt: skip
GUESSED = 6.0  # prior width of a value that nobody declared, over that of a declared value
ROUNDS, MOVES, POOR = 12, 2, 3
PAIRED = 10  # most candidates that are combined in pairs
NEAR = 12.0  # log odds below the likeliest nuisance from which others are ignored
GAIN = 0.3  # least gain of log evidence for a move


@dataclass
class Search:
    """A search for the likeliest hypothesis.

    Attributes:
        closed: True without free functions.
        fits: the best fit of each hypothesis so far, by its terms and free functions.
        banks, scores, found, profiled: of fits by their tokens: bank, evidence, candidates, and score under the noise
            that suits the fit best.
        variants: how many variants of each effect are tried. settled: tokens of fits that `kinks.settled` returned.
    """

    world: World
    closed: bool = True
    fits: dict[tuple[frozenset[Term], frozenset[str]], Fit] = field(default_factory=dict)
    banks: dict[int, Bank] = field(default_factory=dict)
    scores: dict[int, Weighed] = field(default_factory=dict)
    variants: dict[str, int] = field(default_factory=dict)
    found: dict[int, list[Candidate]] = field(default_factory=dict)
    profiled: dict[int, float] = field(default_factory=dict)
    settled: set[int] = field(default_factory=set)

    def odds(self, f: Fit) -> float:
        """Prior log odds of a hypothesis."""
        return sum(odds_of(c.term, self.variants.get(c.term.name, 1)) for c in f.charts) + FREE_ODDS * len(f.free)

    def score(self, f: Fit) -> float:
        """Logarithm of evidence times odds, over all nuisances, linearised around the fit."""
        return self.weighed(f).value - 0.5 * f.world.whiten.log_determinant

    def level_score(self, f: Fit) -> float:
        """The score if rare effects were as likely before the data as the others."""
        return self.score(f) - sum(rarity(c.term) for c in f.charts)

    def weighed(self, f: Fit) -> Weighed:
        """A fit's own evidence over all nuisances."""
        if f.token not in self.scores:
            bank = Bank(f, self.own(f))
            self.scores[f.token] = bank.weigh(self.whole(bank))
        return self.scores[f.token]

    @staticmethod
    def whole(bank: Bank) -> Subset:
        """The blocks of a bank that its fit has."""
        return frozenset(k for k, b in enumerate(bank.blocks) if isinstance(b.source, int))

    def bank(self, f: Fit) -> Bank:
        """The bank around a fit, built once."""
        if f.token not in self.banks:
            self.banks[f.token] = self._bank(f)
        return self.banks[f.token]

    def own(self, f: Fit) -> list[Block]:
        """Blocks of a fit's own effects and free functions."""
        blocks, jacobian = [], f.jacobian
        for k, (c, z, place) in enumerate(zip(f.charts, f.numbers, f.places, strict=True)):
            odds = odds_of(c.term, self.variants.get(c.term.name, 1))
            o = c.origin
            known = c.mean - o, np.minimum(c.lower - o, 0.0), np.maximum(c.upper - o, 0.0)
            blocks.append(Block(c.term.name, jacobian[:, place], c.precision, *known, odds, k, z - o))
        cuts = np.cumsum([g.columns.shape[1] for g in f.free])[:-1]
        whites = np.split(jacobian[:, f.count : f.count + len(f.weights)], cuts, axis=1)
        for k, (g, white, own) in enumerate(zip(f.free, whites, np.split(f.weights, cuts), strict=False)):
            blocks.append(replace(free_block(g, white, len(f.charts) + k), present=own))
        return blocks

    def _bank(self, f: Fit) -> Bank:
        blocks = self.own(f)
        if f.token not in self.found:
            self.found[f.token] = list(candidates(f))
        found = self.found[f.token]
        counts = Counter(c.chart.term.name for c in found)
        self.variants.update({name: max(n, self.variants.get(name, 1)) for name, n in counts.items()})
        curves = [] if f.free or self.closed else list(functions(f))  # one free function is enough to show a structure
        added: list[Candidate | Free] = [*found, *curves]
        columns = {id(x.columns): x.columns for x in added}
        white = f.world.whiten(np.column_stack(list(columns.values())))
        ends = np.cumsum([0, *(x.shape[1] for x in columns.values())])
        whites = {key: white[:, a:b] for key, a, b in zip(columns, ends[:-1], ends[1:], strict=True)}
        for c in found:
            odds, name = odds_of(c.chart.term, self.variants[c.chart.term.name]), c.chart.term.name
            blocks.append(Block(name, whites[id(c.columns)], c.precision, c.mean, c.low, c.high, odds, c))
        blocks += [free_block(g, whites[id(g.columns)], g) for g in curves]
        bank = Bank(f, blocks)
        here = self.whole(bank)
        worth = {n: bank.nuisances[n] + bank.under(here, n)[0] for n in bank.nuisances}
        best = max(worth.values())
        bank.likely = sorted((n for n, value in worth.items() if value > best - NEAR), key=lambda n: -worth[n])
        return bank

    def refit(self, bank: Bank, chosen: Subset) -> Fit:
        """Fit a set of a bank's blocks, starting at the linearised amounts."""
        f, weighed = bank.fit, bank.weigh(chosen)
        charts: list[Chart] = []
        starts: list[np.ndarray] = []
        free: list[Free] = []
        for k, x in zip(sorted(chosen), weighed.amounts, strict=True):
            source = bank.blocks[k].source
            if isinstance(source, int) and source < len(f.charts):
                charts.append(f.charts[source])
                c = f.charts[source]
                starts.append(np.clip(c.origin + x, c.lower, c.upper))
            elif isinstance(source, int):
                free.append(f.free[source - len(f.charts)])
            elif isinstance(source, Free):
                free.append(next(g for g in functions(f) if (g.signal, g.size) == (source.signal, source.size)))
            else:
                charts.append(source.chart)
                starts.append(source.start(x))
        return self.fitted(charts, starts, free, weighed.nuisance, f.amounts)

    def open(self) -> None:
        """Allow free functions from now on."""
        self.closed = False
        self.banks.clear()

    def so_far(self, start: Fit) -> Fit:
        """The likeliest hypothesis that was fitted and scored; `start` if there is none."""
        known = [f for f in self.fits.values() if f.token in self.scores]
        return max(known, key=self.score, default=start)

    def keep(self, f: Fit) -> Fit:
        """Register a fit from elsewhere."""
        self.fits.setdefault((frozenset(c.term for c in f.charts), frozenset(g.signal for g in f.free)), f)
        return f

    def fitted(
        self, charts: list[Chart], starts: list[np.ndarray], free: list[Free], nuisance: Nuisance, amounts: np.ndarray
    ) -> Fit:
        """Fit a hypothesis from `starts` (z of each chart) and `amounts` of links; return its best fit so far."""
        key = frozenset(c.term for c in charts), frozenset(g.signal for g in free)
        self.world.go_on()
        new = fit(self.world, nuisance, charts, starts, free, amounts)
        likeliest = self.weighed(new).nuisance
        if likeliest != nuisance:
            new = fit(self.world, likeliest, charts, list(new.numbers), free, new.amounts)
        held = self.fits.get(key)
        if held is None or self.score(new) > self.score(held):
            self.fits[key] = new
        return self.fits[key]

    def descend(self, start: Fit, rounds: int = ROUNDS) -> Fit:
        """Search from a fit on, in at most `rounds` refits; return the likeliest hypothesis."""
        best = self.keep(self.renewed(start))
        poor: set[frozenset[str]] = set()
        for _ in range(rounds):
            if len(poor) >= POOR:
                break
            bank = self.bank(best)
            here = self.whole(bank)
            there = self._climb(bank, here, poor)
            if there == here:
                break
            new = self.refit(bank, there)
            if self.score(new) > self.score(best) + GAIN:
                best = new
            else:
                poor.add(frozenset(_label(bank, k) for k in there))
            better = max(self.fits.values(), key=self.score)
            if self.score(better) > self.score(best) + GAIN:
                best = better
        return best

    def renewed(self, f: Fit) -> Fit:
        """The same hypothesis under the nuisance that is likeliest for it."""
        likeliest = self.weighed(f).nuisance
        if likeliest == f.nuisance:
            return f
        return fit(self.world, likeliest, f.charts, list(f.numbers), f.free, f.amounts)

    def _climb(self, bank: Bank, start: Subset, poor: set[frozenset[str]]) -> Subset:
        """The best set by linearised evidence: single moves first, then swaps, then one for two, then pairs."""
        here = start
        for _ in range(MOVES):
            reached = bank.glance(here) + GAIN
            for stage in (_single, _swaps, _merged, _pairs):
                best, most = here, reached
                for option in stage(bank, here):
                    self.world.go_on()
                    if not buildable(bank, option):
                        continue
                    found = bank.glance(option)
                    if found > most and frozenset(_label(bank, k) for k in option) not in poor:
                        best, most = option, found
                if best != here:
                    break
            if best == here:
                return here
            here = best
        return here


def free_block(g: Free, white: np.ndarray, source: Free | int, odds: float = FREE_ODDS) -> Block:
    """The block of a free function with columns `white` (M, c), whose amounts are 0 before the data."""
    none, inf = np.zeros(white.shape[1]), np.full(white.shape[1], np.inf)
    return Block(f"free {g.signal}", white, np.eye(len(none)) / g.size**2, none, -inf, inf, odds, source)


def _label(bank: Bank, k: int) -> str:
    b = bank.blocks[k]
    return f"{b.name} {b.source.chart.term.options}" if isinstance(b.source, Candidate) else b.name


def odds_of(term: Term, variants: int) -> float:
    """Logarithm of a term's odds before the data; of the effects that it replaces, all but one count as refitted."""
    if term.declared:
        return REFIT_ODDS
    return ODDS + rarity(term) + REFIT_ODDS * max(len(term.instead) - 1, 0) - float(np.log(max(variants, 1)))


def rarity(term: Term) -> float:
    """Logarithm of a term's odds before the data over those of a usual effect."""
    return 0.0 if term.declared else RARE.get(term.name, 0.0)


def _loose(bank: Bank, here: Subset) -> list[int]:
    """Blocks of a set that may be removed."""
    return [k for k in here if bank.blocks[k].name not in bank.fit.world.given]


def _open(bank: Bank, here: Subset) -> list[int]:
    """Blocks that may be added to a set: effects that it lacks, and free functions if it has none."""
    names = {bank.blocks[k].name for k in here}
    odd = any(name.startswith("free") for name in names)
    return [
        k for k, b in enumerate(bank.blocks)
        if k not in here and b.name not in names and not (odd and b.name.startswith("free"))
        and all(_together(bank, k, other) for other in here)
    ]  # fmt: skip


def _single(bank: Bank, here: Subset) -> Iterator[Subset]:
    """Sets with one block less, one more, or another variant of one."""
    for k in _loose(bank, here):
        yield here - {k}
        name = bank.blocks[k].name
        yield from (here - {k} | {j} for j, b in enumerate(bank.blocks) if j not in here and b.name == name)
    yield from (here | {k} for k in _open(bank, here))


def _front(bank: Bank, here: Subset, most: int) -> list[int]:
    """The most promising effects to add, one variant of each."""
    alone = sorted(((bank.glance(here | {k}), k) for k in _open(bank, here)), reverse=True)
    first: dict[str, int] = {}
    for _, k in alone:
        if not bank.blocks[k].name.startswith("free"):
            first.setdefault(bank.blocks[k].name, k)
    return list(first.values())[:most]


def _swaps(bank: Bank, here: Subset) -> Iterator[Subset]:
    """Sets with one effect exchanged for another."""
    for k in _loose(bank, here):
        less = here - {k}
        yield from (less | {j} for j in _open(bank, less) if not bank.blocks[j].name.startswith("free"))


def _merged(bank: Bank, here: Subset) -> Iterator[Subset]:
    """Sets with one effect in place of two: two effects may imitate a single law together."""
    for pair in combinations(_loose(bank, here), 2):
        less = here.difference(pair)
        yield from (less | {j} for j in _open(bank, less) if not bank.blocks[j].name.startswith("free"))


def _pairs(bank: Bank, here: Subset) -> Iterator[Subset]:
    """Sets with two more effects, also in place of one."""
    yield from (here | {*pair} for pair in combinations(_front(bank, here, PAIRED), 2) if _together(bank, *pair))
    if len(here) < 5:
        for k in _loose(bank, here):
            less = here - {k}
            yield from (less | {*pair} for pair in combinations(_front(bank, less, 5), 2) if _together(bank, *pair))


def _term(bank: Bank, k: int) -> Term | None:
    """The term of a block, None for a free function."""
    source = bank.blocks[k].source
    if isinstance(source, Candidate):
        return source.chart.term
    return bank.fit.charts[source].term if isinstance(source, int) and source < len(bank.fit.charts) else None


def buildable(bank: Bank, chosen: Subset) -> bool:
    """True if every effect of the `chosen` set finds the effects that it needs in the set or in the declared model, and
    no declared effect gets new values that another one replaces.
    """
    terms = [term for k in chosen if (term := _term(bank, k)) is not None]
    names, declared = {term.name for term in terms}, {e.name for e in bank.fit.world.declared.effects}
    replaced = {name for term in terms for name in term.instead}
    there = (names | declared) - replaced
    return names.isdisjoint(replaced) and all(name in there for term in terms for name in term.kind.needs)


def _together(bank: Bank, a: int, b: int) -> bool:
    """False for two drive effects: a drive has one law for negative power."""
    return not all((term := _term(bank, k)) is not None and term.kind.stage == "drive" for k in (a, b))


def root(world: World, nuisance: Nuisance) -> Fit:
    """Fit of the declared model alone; only the effects in `World.given` are free."""
    charts = []
    for name in world.given:
        term = Term(name, declared=True)
        own = chart(term, world.declared, world.scale, world.samples.n)
        charts.append(replace(own, precision=own.precision / GUESSED**2))
    return fit(world, nuisance, charts, [c.origin for c in charts])


def moved(f: Fit, world: World) -> Fit:
    """Refit the same hypothesis in another world."""
    return fit(world, f.nuisance, f.charts, list(f.numbers), [replace(g) for g in f.free], f.amounts)


def without(found: Search, f: Fit, k: int) -> Fit:
    """Refit without the k-th effect and the effects that need it; a declared effect stays with its declared values."""
    left = f.charts[k].term
    charts = [c for i, c in enumerate(f.charts) if i != k and (left.declared or left.name not in c.term.kind.needs)]
    kept = [z for c, z in zip(f.charts, f.numbers, strict=True) if c in charts]
    return found.fitted(charts, kept, list(f.free), f.nuisance, f.amounts)
