"""The unit that a header states, in brackets or at its end, or that a row of units below the header states."""

from __future__ import annotations

import re

from energy_opt.measured.header import UNITS, cut, known_unit, plain, words_in

WORD = re.compile(r"[^\W\d_]+")
# Units that are not converted: their first word, signs of them, and numbers before or behind a unit.
ODD = words_in(
    "btu cal kcal cv bhp kgf kp kpm gf kg cn dn mn lb lbs lbf oz ozf ft yd mil um count counts cts inc incs increments "
    "tick ticks pulses lsb arcmin arcsec pu percent promille pa kpa bar psi degf"
)
ANYWHERE = words_in("arcmin arcsec btu kcal kgf lbf ozf degf")  # no other words, so that no brackets are needed
PREFIXED = re.compile(r"(?:[uµμnhGT]|da)(?:W|Wh|Ws|J|A|V|N ?m)")
SIGNS = re.compile(r"[%‰^*·⋅]|^[^\W\d_]{1,6} ?/ ?(?:s|min|h|m|rev|turn|deg|rad|v|a)\d?$")
FACTOR = re.compile(r"[x×]? ?[\d.,]+ ?([^\W\d_][^\d]*)|([^\d]*[^\W\d_]) ?[x×*] ?[\d.,]+")
IN_BRACKETS = re.compile(r"([\[(<{])([^\[\](){}<>]+)[\])>}]")
SLOPES = ("velocity", "acceleration")  # positions show their unit
NOMINAL = ("voltage", "current")  # a number in brackets is that of the supply


def is_known(unit: str) -> bool:
    """Whether a word is a unit of some quantity."""
    return any(known_unit(kind, unit) for kind in UNITS)


def stated_unit(kind: str, column: str, below: str = "", joint: str = "") -> str:
    """The unit that the row of units (`below`), or the header, states for a column, known or not; "" for none.

    A known unit counts wherever it is; of other words in brackets, only those that look like a unit. A single letter in
    round brackets, and a word of the joint's name at the end, is a name.
    """
    own = WORD.findall(joint.lower())
    indexed = any(m[2].strip().isdigit() for m in IN_BRACKETS.finditer(column))  # tau_J[0] is no energy
    bare = column if indexed else IN_BRACKETS.sub("", column).strip()
    found = [
        (below.strip("[](){}<> "), True),
        *((m[2], m[1] != "(") for m in reversed([*IN_BRACKETS.finditer(column)])),
    ]
    found += [(unit, True) for unit in (cut(column).unit, cut(bare).unit) if unit.lower() not in own]
    found += [(word, True) for word in re.split(r"[\s_.-]", bare)[-1:] if word.lower() in ANYWHERE]
    units = [(text.strip().rstrip("."), square) for text, square in found]
    for text, _ in units:
        if known_unit(kind, text):
            return text
    for text, square in units:
        if (is_known(text) and (square or len(text) > 1)) or _looks_odd(kind, text):
            return text
    return ""


def _looks_odd(kind: str, text: str) -> bool:
    """Whether a word that is no known unit is one all the same: it has signs of a unit, a factor, or a unit's name."""
    if kind in SLOPES and not set("%‰") & set(text):
        return False
    word = plain(text).lower().strip()
    factor = FACTOR.fullmatch(word)
    if factor:
        return kind not in NOMINAL and any(known_unit(kind, part) for part in factor.groups() if part)
    first = next(iter(WORD.findall(word)), "")
    return (
        bool(SIGNS.search(word) or PREFIXED.fullmatch(text))
        or first in ODD
        or (kind == "position" and word in ("u", "umdr"))
    )
