"""Search for the hypothesis that explains the residual: a beam over sets of effects and unlisted structures.

A hypothesis is scored by loss / f + ln(N) * (free numbers) + PRICE * (effects), lower is better, where f >= 1 is the
noise's long-run variance over its variance (samples that repeat each other count less).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from energy_opt.diagnose.fit import Extra, Fit, fit
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.screen import Candidate, best_of, candidates, gain, sprung_joints
from energy_opt.diagnose.terms import Term, negligible
from energy_opt.diagnose.unlisted import exclusive, structures
from energy_opt.effects.meter import RESOLVED_LAG
from energy_opt.power import PowerModel

BEAM = 3
TRIED = 6  # effects tried per hypothesis and round
DEEPEST = 6
MOST_EXTRAS = 2  # unlisted structures after which the verdict no longer changes
BUDGET = 1.5e6  # samples times evaluations that a search may take
FEW_SAMPLES = 2000  # below these an evaluation costs the same
LOOK = 20  # evaluations that looking for candidates is worth
FEW = 6  # iterations while growing; the best are then fitted to the end
PRICE = 14.0  # per effect, for the many that are looked at
REFIT_PRICE = 8.0  # per declared effect whose values are fitted anew
EXTRA_PRICE = 21.0  # per unlisted structure, whose setting is scanned

LAGGING = {"meter_delay", "meter_filter"}

Key = tuple[frozenset[Term], frozenset[tuple[str, int]]]


@dataclass
class Search:
    """All hypotheses fitted so far, by what they add."""

    samples: Samples
    declared: PowerModel
    inflation: float = 1.0
    fits: dict[Key, Fit] = field(default_factory=dict)
    polished: set[Key] = field(default_factory=set)
    work: float = 0.0
    looked: dict[Key, list[tuple[float, Candidate, np.ndarray]]] = field(default_factory=dict)
    p_values: dict[tuple[float, Key, int], float] = field(default_factory=dict)  # see claims

    @property
    def exhausted(self) -> bool:
        """True when the search has taken what it may."""
        return self.work > BUDGET

    def price(self, numbers: int, terms: Sequence[Term], extras: int) -> float:
        """What free numbers and effects cost."""
        effects = sum(REFIT_PRICE if term.declared else PRICE for term in terms)
        return float(np.log(len(self.samples.power))) * numbers + effects + EXTRA_PRICE * extras

    def score(self, f: Fit) -> float:
        """Lower is better; infinite where an effect's values are too small to be claimed."""
        if any(negligible(c.term, c.values(z)) for c, z in zip(f.charts, f.numbers, strict=True)):
            return float("inf")
        if set(f.names) >= LAGGING:
            both = [float(c.values(z)[0]) for c, z in zip(f.charts, f.numbers, strict=True) if c.term.name in LAGGING]
            if abs(sum(both)) < RESOLVED_LAG:
                return float("inf")
        return f.loss / self.inflation + self.price(f.count, f.terms, len(f.extras))

    def ranked(self) -> list[Fit]:
        """All hypotheses, best first."""
        return sorted(self.fits.values(), key=self.score)

    def hypothesis(
        self, terms: tuple[Term, ...], starts: list[np.ndarray], extras: tuple[Extra, ...], thorough: bool = False
    ) -> Fit:
        """The fit of these terms and structures; fitted once, and to the end where `thorough`."""
        key = key_of(terms, extras)
        held = self.fits.get(key)
        if held is not None and (not thorough or key in self.polished):
            return held
        if held is not None:
            terms, starts, extras = held.terms, list(held.numbers), held.extras
        new = fit(self.samples, self.declared, terms, starts, extras, 30 if thorough else FEW)
        self.work += new.evaluations * max(len(self.samples.power), FEW_SAMPLES)
        if thorough:
            self.polished.add(key)
        if held is None or new.loss < held.loss:
            self.fits[key] = new
        return self.fits[key]

    def add(self, base: Fit, candidate: Candidate, weights: np.ndarray) -> Fit:
        """`base` with a candidate more."""
        return self.hypothesis((*base.terms, candidate.term), [*base.numbers, candidate.start(weights)], base.extras)

    def add_extra(self, base: Fit, extra: Extra) -> Fit:
        """`base` with a structure more."""
        return self.hypothesis(base.terms, list(base.numbers), (*base.extras, extra))

    def polish(self, f: Fit) -> Fit:
        """The same hypothesis fitted to the end."""
        return self.hypothesis(f.terms, list(f.numbers), f.extras, thorough=True)

    def without(self, base: Fit, index: int) -> Fit:
        """`base` less one term."""
        terms = tuple(t for k, t in enumerate(base.terms) if k != index)
        starts = [z for k, z in enumerate(base.numbers) if k != index]
        return self.hypothesis(terms, starts, base.extras, thorough=True)

    def proposals(self, base: Fit) -> list[tuple[float, Candidate, np.ndarray]]:
        """Candidates for the next effect with their linearised gain less the price of their numbers, best first."""
        key = key_of(base.terms, base.extras)
        if key not in self.looked:
            found = []
            for candidate in candidates(base, self.declared, self.samples):
                if not candidate.term.kind.same_on_all_joints and not candidate.term.declared:
                    candidate = sprung_joints(base, candidate, self.samples)
                gained, weights = gain(base, candidate, self.samples)
                numbers = len(candidate.origin)
                found.append((gained / self.inflation - self.price(numbers, (candidate.term,), 0), candidate, weights))
            self.looked[key] = best_of(found)
            self.work += LOOK * max(len(self.samples.power), FEW_SAMPLES)
        return self.looked[key]

    def extra_proposals(self, base: Fit) -> Iterator[tuple[float, Extra]]:
        """Unlisted structures whose linearised gain is worth their price."""
        for gained, extra in structures(base, self.samples):
            value = gained / self.samples.noise**2 / self.inflation - self.price(extra.columns.shape[1] + 1, (), 1)
            if value > 0 and exclusive(extra, base.terms):
                yield value, extra


def key_of(terms: tuple[Term, ...], extras: tuple[Extra, ...]) -> Key:
    """What tells hypotheses apart."""
    return (frozenset(terms), frozenset((e.family, e.joint) for e in extras))


def _refitted(found: Search) -> list[Fit]:
    """The declared effects with all their values fitted anew: where they are off, others show only beside that."""
    root = found.hypothesis((), [], ())
    chosen: dict[str, Candidate] = {}
    for _, candidate, _ in found.proposals(root):
        if candidate.term.declared and candidate.term.mode in ("number", "shared", "scale"):
            chosen.setdefault(candidate.term.name, candidate)
    if len(chosen) < 2:
        return []
    return [found.hypothesis(tuple(c.term for c in chosen.values()), [c.origin for c in chosen.values()], ())]


def _first(rows: list[tuple[float, Candidate, np.ndarray]]) -> list[tuple[float, Candidate, np.ndarray]]:
    """The proposals worth their price of the first `TRIED` effects, in all their variants."""
    names: list[str] = []
    for value, candidate, _ in rows:
        if value > 0 and candidate.term.name not in names and len(names) < TRIED:
            names.append(candidate.term.name)
    return [row for row in rows if row[0] > 0 and row[1].term.name in names]


def search(samples: Samples, declared: PowerModel) -> Search:
    """Look for effects until the best hypothesis gains nothing by one more."""
    out = Search(samples, declared)
    beam = [out.hypothesis((), [], ()), *_refitted(out)]
    for _ in range(DEEPEST):
        grown: dict[int, Fit] = {}
        for rank, base in enumerate(beam):
            if out.exhausted:
                break
            base = out.polish(base) if rank == 0 else base
            terms = _first(out.proposals(base))
            extras = sorted(out.extra_proposals(base), key=lambda row: -row[0])[:2]
            if rank == 0 and not terms and not extras:
                return out
            for _, candidate, weights in terms:
                new = out.add(base, candidate, weights)
                grown[id(new)] = new
            for _, extra in extras:
                new = out.add_extra(base, extra)
                grown[id(new)] = new
        best = out.score(beam[0])
        beam = sorted(grown.values(), key=out.score)[:BEAM]
        if not beam or out.score(out.polish(beam[0])) >= best or len(beam[0].extras) >= MOST_EXTRAS or out.exhausted:
            break
    return out
