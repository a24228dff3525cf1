"""A header's words, numbers and unit, and which signal they name: `actual_q_0`, `dq[3]`, `J1 Angle (deg)`, ...

Words are compared in lower case and without accents.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

DEGREE = math.pi / 180
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254}
POSITIONS = {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "gon": math.pi / 200, "rev": 2 * math.pi, **LENGTHS}
# Factors to SI units, by kind of quantity; the first unit of each is SI's. A word in another case means the last unit
# that differs from it in case alone: "mj" are mJ, though MJ are known.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "position": POSITIONS,
    "velocity": {**{f"{unit}/s": factor for unit, factor in POSITIONS.items()}, "rpm": math.pi / 30},
    "acceleration": {f"{unit}/s^2": factor for unit, factor in POSITIONS.items()},
    "effort": {
        "N m": 1.0, "mN m": 1e-3, "N mm": 1e-3, "N cm": 1e-2, "kN m": 1e3, "cN m": 1e-2, "daN m": 10.0,
        "kgf cm": 0.0980665, "kgf m": 9.80665, "lbf in": 0.112984829, "N": 1.0,
    },
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "kA": 1e3},
    "voltage": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "temperature": {"degC": 1.0},
    "power": {
        "W": 1.0, "MW": 1e6, "mW": 1e-3, "kW": 1e3, "uW": 1e-6, "cW": 1e-2, "dW": 0.1, "hW": 100.0,
        "J/s": 1.0, "hp": 745.699872, "PS": 735.49875,
    },
    "energy": {
        "J": 1.0, "kJ": 1e3, "MJ": 1e6, "mJ": 1e-3, "Ws": 1.0, "MWh": 3.6e9, "mWh": 3.6, "Wh": 3600.0, "kWh": 3.6e6,
    },
}  # fmt: skip
# Words at the end of a header that are no units there, though some are in brackets: of single letters all but six.
NO_SUFFIX = re.compile(r"(?i:min|rev|turn|ps)|cw|CW|dw|DW|hw|HW|[^sWAVJ°]")
BRACKETS = re.compile(r"[\[(<{]([^\[\](){}<>]+)[\])>}]\s*$")
BY_SIGNAL = {"position": "", "velocity": "/s", "acceleration": "/s^2"}  # suffix of an angle's unit, by signal
OTHER = {
    "°": "deg", "º": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "radian": "rad", "radians": "rad",
    "degres": "deg", "grados": "deg", "gradi": "deg", "secondes": "s", "segundos": "s", "secondi": "s",
    "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "usec": "us", "turn": "rev",
    "turns": "rev", "1/min": "rpm", "u/min": "rpm", "°c": "degC", "c": "degC", "celsius": "degC", "watt": "W",
    "watts": "W", "ampere": "A", "amps": "A", "amp": "A", "joule": "J", "joules": "J", "inches": "inch",
    "volt": "V", "volts": "V", "kilowatt": "kW", "kilowatts": "kW", "kwatt": "kW", "milliwatt": "mW",
    "milliwatts": "mW", "newtonmeter": "N m", "newtonmeters": "N m", "newtonmetre": "N m", "newtonmetres": "N m",
    "dps": "deg/s",
    "inlb": "lbf in", "inlbf": "lbf in", "lbin": "lbf in", "kgcm": "kgf cm",
}  # fmt: skip


def known_unit(kind: str, word: str) -> str | None:
    """The unit of UNITS[kind] that a word of a header or a unit row means, None where it means none.

    >>> known_unit("position", "[°]"), known_unit("effort", "N·m"), known_unit("energy", "(kWh)")
    ('deg', 'N m', 'kWh')
    """
    word = plain(word).strip().strip("[](){}<> ").strip()
    if not word or kind not in UNITS:
        return None
    lower = {name.lower().replace(" ", ""): name for name in UNITS[kind]}
    if word in UNITS[kind]:
        return word
    word = word.lower()
    angle = re.fullmatch(r"(\D+?)\s*(/|_per_|\.)\s*s(?:ec)?(\^?-?2|²)?\s*", word)
    if angle and kind in BY_SIGNAL:
        unit = OTHER.get(angle.group(1), angle.group(1)) + ("/s^2" if angle.group(3) else "/s")
        return lower.get(unit.lower())
    word = re.sub(r"(?<=[a-z])[ *.·⋅-](?=[a-z])", "", word)
    return lower.get(OTHER.get(word, word).lower().replace(" ", ""))


def no_unit(kind: str, word: str) -> str:
    """Message on a word that means no unit of UNITS[kind]."""
    return f"{word!r} is no unit of {kind}; known: {', '.join(UNITS[kind])}"


def words_in(text: str) -> frozenset[str]:
    """The words of a text that spaces separate."""
    return frozenset(text.split())


# Words that identify a joint's signal, the most specific signals first ("joint" is in many headers).
SIGNALS: dict[str, frozenset[str]] = {
    "acceleration": words_in(
        "qdd ddq acc accel acceleration accelerations ddtheta beschleunigung aceleracion accelerazione"
    ),
    "velocity": words_in(
        "qd dq vel velocity velocities speed speeds omega qdot dtheta rate geschwindigkeit vitesse velocidad velocita"
    ),
    "effort": words_in("tau effort efforts torque torques moment moments drehmoment couple coppia"),
    "current": words_in("current currents cur strom ampere i courant corriente corrente"),
    "temperature": words_in("temp temps temperature temperatures temperatur temperatura"),
    "position": words_in(
        "q pos position positions angle angles theta encoder winkel jpos posicion posizione angulo angolo"
    ),
}
JOINT = words_in(
    "joint joints j axis axes a achse achs gelenk articulation articulacion eje axe giunto asse"
)  # alone, they mean the joint's position
# Beside a word of JOINT, these say that the column is no position; unknown words make it the last choice.
QUANTITIES = words_in(
    "pwm duty load last auslastung utilization power energy leistung watt watts jerk ruck friction stiffness damping "
    "gain kp ki kd frequency pressure vibration noise brake bremse enable enabled status flag fault alarm warning id"
)
# Words for commanded or computed values: measured ones are wanted.
COMMANDED = words_in(
    "computed calculated calc model modelled modeled simulated sim estimate estimated est theoretical feedforward "
    "predicted target targets desired des command commanded cmd ref reference setpoint setpoints sp goal d planned "
    "nominal demand demanded requested expected soll vorgabe consigne consigna cible objetivo riferimento referencia"
)
STRANGE = words_in(  # a header with one of these words is no joint's signal
    "tcp cartesian tool pose wrench force ext external hat output register registers bit bits mode digital analog "
    "voltage volt voltages limit limits max min seq covariance contact collision name names accelerometer gripper "
    "finger momentum factor fraction scaling time stamp percent pct counts ticks increments error err deviation fehler"
)
MEASURED = words_in("actual measured state states act ist real feedback fb meas pv joint mesure medido medida misurato")
PLAIN = frozenset[str]().union(*SIGNALS.values(), JOINT, MEASURED, words_in("robot arm states data"))  # say no name
TIME = (
    "time", "timestamp", "stamp", "t", "zeit", "datetime", "date", "clock", "elapsed", "secs", "seconds", "zeitstempel",
    "datum", "uhrzeit", "duration", "temps", "tiempo", "tempo", "horodatage", "heure", "fecha", "hora",
    "ts",
)  # fmt: skip
NOT_TIME = words_in("execution frame nsecs nanosec control run cycle delta")
PARTS = PLAIN | COMMANDED | STRANGE | words_in("motor wirk schein blind gesamt leistung power wert")  # of joined words


@dataclass(frozen=True)
class Header:
    """A header split into words in lower case, numbers, and its unit (as written)."""

    text: str
    words: tuple[str, ...]
    numbers: tuple[int, ...]
    unit: str


@lru_cache(maxsize=8192)
def cut(text: str) -> Header:
    """Split a header into words, numbers and unit.

    >>> cut("J1 Angle (deg)")
    Header(text='J1 Angle (deg)', words=('j', 'angle'), numbers=(1,), unit='deg')
    >>> cut("/joint_states/position[2]").words
    ('joint', 'states', 'position')
    """
    rest, unit = text, ""
    bracket = BRACKETS.search(rest)
    if bracket and any(known_unit(kind, bracket.group(1)) for kind in UNITS):
        rest, unit = rest[: bracket.start()], bracket.group(1).strip()
    parts = _parts(rest)
    if not unit and len(parts) > 1:
        tail = re.search(rf"[_ ./-]((?:{'|'.join(POSITIONS)}|°)_?(?:per_?|/|_)?s(?:2|\^2)?|[A-Za-zµμ°]+)$", rest)
        word = tail.group(1) if tail else ""
        telling = NO_SUFFIX.fullmatch(word) is None or (word == "rev" and re.search(r"\d[_ ./-]rev$", rest))
        if word and telling and any(known_unit(kind, word) for kind in UNITS):
            rest, unit = rest[: tail.start()] if tail else rest, word
            parts = _parts(rest)
    words = tuple(word for part in parts if not part.isdigit() for word in _parted(part.lower()))
    numbers = tuple(int(part) for part in parts if part.isdigit() and len(part) < 5)
    return Header(text, words, numbers, unit)


def _parts(text: str) -> list[str]:
    """The words and numbers of a text, without accents."""
    return re.findall(r"[A-Za-zµμ°À-ÿ]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain(text)))


def plain(text: str) -> str:
    """A text without accents, and with u for the sign of millionths.

    >>> plain("Énergie"), plain("µA")
    ('Energie', 'uA')
    """
    text = "".join(letter for letter in unicodedata.normalize("NFD", text) if not unicodedata.combining(letter))
    return re.sub("[µμ](?=[A-Za-z])", "u", text)


def _parted(word: str) -> tuple[str, ...]:
    """The known words that a word joins: `sollwinkel` is ("soll", "winkel"), `qref` ("q", "ref")."""
    if word not in PARTS and word not in TIME:
        for k in range(1, len(word)):
            first, rest = word[:k], _parted(word[k:])
            if first in PARTS and (k > 1 or first in "qi") and len(rest[-1]) > 1 and PARTS.issuperset(rest):
                return first, *rest
    return (word,)


def unit_in(kind: str, header: str) -> str | None:
    """The unit of a kind that a header itself names."""
    return known_unit(kind, cut(header).unit)


def signal_of(words: Iterable[str], unit: str) -> str | None:
    """The joint signal that words and a unit ("" for none) name, or None.

    Words that only say "joint" mean the signal of the unit, and the position without one.
    """
    have = set(words)
    if have & STRANGE:
        return None
    if {"q", "dot"} <= have or {"theta", "dot"} <= have:
        return "velocity"
    if len(have) == 1 and have <= {"m", "t"} and known_unit("effort", unit):
        return "effort"  # of M1 [Nm], no letter says more than the unit
    named = next((signal for signal, known in SIGNALS.items() if have & known), None)
    if named is not None or not have & JOINT or have & QUANTITIES:
        return named
    return next((signal for signal in SIGNALS if known_unit(signal, unit)), None) if unit else "position"
