"""Headers of a meter: the whole robot's power, a counter of energy, a supply's voltage and current."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence

from energy_opt.measured.header import COMMANDED, UNITS, Header, cut, known_unit, words_in

POWER = words_in("power watt watts wattage wattmeter powermeter leistung puissance potencia potenza p pwr apower")
ENERGY = words_in("energy joule joules wh kwh energie energia counter arbeit")
VOLT = words_in("voltage volt volts u v spannung tension tensione voltaje")
AMPERE = words_in("current ampere amperes amps amp i a strom courant corriente corrente")
# Words for a single motor instead of the robot, unless the header also names the robot.
SINGLE = words_in(
    "joint motor axis axes achse actuator drive servo gripper tool finger elbow shoulder wrist antrieb j m link "
    "pc camera"
)
WHOLE = words_in("robot arm controller total whole sum main gesamt totale")
ALTERNATING = words_in("pf cos phi apparent reactive frequency hz va var")
PHASE, PHASES = words_in("phase act active wirk"), tuple(map(set, ("123", "abc", "rst", "uvw")))
BATTERY = words_in("battery charge capacity soc")
NOT_POWER = words_in(
    "apparent apparente aparente reactive reactiva reattiva va kva var kvar varh kvarh schein blind factor max min "
    "peak limit state mode on off status button percent pct mech mechanical shaft error err"
)
METERED = dict.fromkeys(words_in("meter measured meas actual ist elec electric electrical ac mains grid netz"), 0.5)
METERED |= dict.fromkeys(words_in("raw filtered mean average avg mittel rms instantaneous inst"), 0.0)

SUPPLY = {"robot": 2.0, "supply": 1.0, "bus": 1.0, "dc": 1.0, "total": 1.0, "battery": 0.5, "input": 0.5, "in": 0.5}
SILENT = words_in("field data value values val wert messwert reading readings msg valeur valor valore") | {*METERED}


def power_column(header: Sequence[str]) -> str | None:
    """The header of the whole robot's power, None if there is none."""
    good = {"total": 2.0, "totale": 2.0, "gesamt": 2.0, "input": 0.5, "in": 0.5, "import": 0.5, "main": 0.5} | METERED
    good |= dict.fromkeys(words_in("robot arm controller active wirk whole sum"), 1.0)
    return _best_header(header, POWER, NOT_POWER, good, "power")


def power_by_file(header: Sequence[str], name: str) -> str | None:
    """The only header whose words say nothing, if with the words of the file's name it is the whole robot's power."""
    silent = [text for text in header if text and set(cut(text).words) <= SILENT]
    named = " ".join(re.findall(r"[^\W\d_]+", name))
    return silent[0] if len(silent) == 1 and power_column([f"{named} {silent[0]}"]) else None


def energy_column(header: Sequence[str]) -> str | None:
    """The header of a counter of energy."""
    good = {"total": 1.0, "import": 1.0, "robot": 1.0, "active": 0.5}
    found = _best_header(header, ENERGY, NOT_POWER | {"kinetic", "potential", "reactive"}, good, "energy")
    h = cut(found or "")
    telling = set(h.words) & (ENERGY - {"counter"}) or known_unit("energy", h.unit) not in (None, "J")  # J: a joint?
    return found if telling else None


def _best_header(
    header: Sequence[str], words: frozenset[str], never: frozenset[str], good: Mapping[str, float], kind: str
) -> str | None:
    """The header that fits best, by its words and its unit; None if none fits."""
    best, score = None, 0.0
    alike = [h.text for h in map(cut, header) if set(h.words) & words or known_unit(kind, h.unit)]
    alike = [text for text in alike if not set(cut(text).words) & (never | COMMANDED)]
    whole = {*words, *good, *map(str.lower, UNITS[kind])}
    for text in header:
        h = cut(text)
        unit = known_unit(kind, h.unit)
        have = set(h.words) & words
        foreign = h.unit and unit is None and any(known_unit(k, h.unit) for k in UNITS)
        if not (have or unit) or set(h.words) & never or foreign or not _may_be_whole_robot(h, header, good):
            continue
        if _one_of_several(text, alike, whole):
            continue
        value = 1 + (1.0 if unit else 0.0) + sum(good.get(word, 0) for word in h.words) - 0.1 * len(h.words)
        value += 0.5 if have - {"p"} else 0.0
        value -= 0.5 * len(h.numbers) + (2.0 if set(h.words) & COMMANDED else 0.0)
        if value > score:
            best, score = text, value
    return best


def _one_of_several(text: str, others: Iterable[str], whole: Container[str]) -> bool:
    """True if a header differs from another in one word only, which is not in `whole` (as of a phase or a motor)."""
    words = _all_words(text)
    for other in map(_all_words, others):
        apart = [word for word, there in zip(words, other, strict=False) if word != there]
        if len(words) == len(other) and len(apart) == 1 and apart[0] not in whole:
            return True
    return False


def _all_words(text: str) -> list[str]:
    """The words, numbers and unit of a header, in lower case."""
    return re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text).lower())


def _may_be_whole_robot(h: Header, header: Sequence[str], good: Iterable[str]) -> bool:
    """True if a meter's column may be the whole robot's: not a single motor's, nor one of several alike."""
    words = set(h.words)
    if words & WHOLE & set(good):
        return True
    alike = [other for other in map(cut, header) if other.words == h.words and other.numbers != h.numbers]
    return not words & SINGLE and not (h.numbers and alike)


def whole_power(header: Sequence[str]) -> tuple[str, list[str]]:
    """What the whole robot's power is of some headers, and these: a "column"; the "product" of a supply's voltage and
    current; the "difference" of imported and exported power; the "sum" of three phases; "" if there is none.

    With an alternating supply, voltage times current is not the power drawn.
    """
    power, pair = power_column(header), product_columns(header)
    if pair is not None:
        own, direct = robots_own(pair), not alternating(header)
        if (own or direct) if power is None else (own and direct):
            return "product", list(pair)
    if power is None:
        phases = _phases(header)
        return ("sum", phases) if phases else ("", [])
    words = _all_words(power)
    exported = ["export" if word == "import" else word for word in words]
    back = [text for text in header if words != exported == _all_words(text)]
    return ("difference", [power, back[0]]) if back else ("column", [power])


def _phases(header: Sequence[str]) -> list[str]:
    """Headers of the active powers of three phases; none if there are no such three."""
    by: dict[tuple[str, ...], dict[str, str]] = {}
    for h in map(cut, header):
        words = _all_words(h.text)
        if set(h.words) & (NOT_POWER | COMMANDED) or not (set(h.words) & POWER or known_unit("power", h.unit)):
            continue
        for k, word in enumerate(words):
            if PHASE & {*words} or (k and words[k - 1] == "l"):
                by.setdefault((*words[:k], "", *words[k + 1 :]), {})[word] = h.text
    return next((list(found.values()) for found in by.values() if {*found} in PHASES), [])


def robots_own(pair: Sequence[str]) -> bool:
    """True if both headers name the robot."""
    return all(set(cut(name).words) & {"robot", "arm", "controller"} for name in pair)


def alternating(header: Iterable[str]) -> bool:
    """True if a header names a quantity that only an alternating supply has."""
    return any(set(cut(text).words) & ALTERNATING for text in header)


def of_battery(header: Iterable[str]) -> bool:
    """True if headers are those of a battery: the power drawn from it may be below zero, as in ROS' BatteryState."""
    return any(set(cut(text).words) & BATTERY for text in header)


def product_columns(header: Sequence[str]) -> tuple[str, str] | None:
    """Headers of a voltage and a current of the same supply, whose product is the power."""
    best, score = None, 0.0
    cells = [cut(text) for text in header]
    volts = [volt for volt in cells if set(volt.words) & VOLT or volt.unit == "V"]
    for volt in volts:
        if _one_of_several(volt.text, [other.text for other in volts], {*VOLT, *SUPPLY, "mv", "kv"}):
            continue
        for ampere in cells:
            named = set(ampere.words) & AMPERE or known_unit("current", ampere.unit)
            if not named or ampere.text == volt.text or ampere.numbers != volt.numbers:
                continue
            if set(ampere.words) & COMMANDED or set(volt.words) & COMMANDED:
                continue
            if not _may_be_whole_robot(volt, header, SUPPLY) or not _may_be_whole_robot(ampere, header, SUPPLY):
                continue
            other_v, other_a = set(volt.words) - VOLT, set(ampere.words) - AMPERE
            if other_v != other_a:
                continue
            value = 1 + sum(SUPPLY.get(word, 0) for word in other_v) - len(volt.numbers)
            if value > score:
                best, score = (volt.text, ampere.text), value
    return best
