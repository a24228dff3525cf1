"""Base class of effects: named parameters with units, and one CasADi expression.

The power of an arm is built in stages, and every effect belongs to exactly one of them:

    rigid      changes the rigid body itself            tau = RNEA(q, v, a; payload, gravity)
    torque     adds to the motor's torque               tau_m = tau + sum of torque effects
    heat       heat of a joint's drive                  c_j = sum of heat effects, as r_j * tau_m,j^2
    winding    multiplies the heat that it needs        c_j * factor
    drive      what becomes of negative drive power     d_j = tau_m,j * v_j + c_j  ->  p
    power      adds to the power of the whole arm       p + ...
    supply     between the drives and the meter         p / eta
    meter      what the meter makes of the true power   reading(t), never part of an energy

Properties that other code needs (is it overhead, does it store energy, does it depend on time, ...) are attributes of
the class: no code outside names an effect. The stages' base classes are in `stages`.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from energy_opt.effects.parameter import Parameter
from energy_opt.errors import BadInput, refuse

SMALL = 1e-9  # least absolute value of a factor by which another parameter is divided
Stage = Literal["rigid", "torque", "heat", "winding", "drive", "power", "supply", "meter"]


@dataclass(frozen=True)
class Signals:
    """The state at one instant, as CasADi columns: q [rad], v [rad/s], a [rad/s^2], tau [N m] (rigid body), t [s].

    Signals of the past or the recording are None if unknown, as in planning: `temperature` (n, 1) [degC] of each joint;
    `warmth` (n, 1) 0 at the set's first temperature and 1 at its highest; `idle` [s] the time since the
    last motion ended (negative while moving and before any motion); `returned` [W] what a store gives back at this
    instant; `run` the index of the run; `dwell` how many standstills between motions the run has had; `day` [s] time
    since the set's first sample, in a set of some hours; `heated` (n, 1) [W] recent heat of each joint, with
    exponential weights; `logged` further recorded signals by name, 0 or 1 or a number.
    """

    q: ca.SX
    v: ca.SX
    a: ca.SX
    tau: ca.SX
    t: ca.SX
    temperature: ca.SX | None = None
    warmth: ca.SX | None = None
    idle: ca.SX | None = None
    returned: ca.SX | None = None
    run: ca.SX | None = None
    dwell: ca.SX | None = None
    day: ca.SX | None = None
    heated: ca.SX | None = None
    logged: Mapping[str, ca.SX] | None = None


class Effect:
    """Base of all effects; an instance holds its parameters' values.

    Subclasses set `name` and `parameters` and write the law of their base class (`TorqueEffect`, `PowerEffect`, ...,
    which set `stage`). `p` in a law holds the parameters by name, as CasADi columns of full length (a per-joint
    parameter always has one entry per joint there, a table is given row by row), the words of `options` and the lengths
    of free dimensions. docs/extending.md explains the other class attributes.

    Args:
        values: of every parameter, by name, in SI units; and the words of `options`.

    Raises:
        BadInput: a parameter is missing, unknown, out of bounds or of another shape.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    parameters: ClassVar[tuple[Parameter, ...]]
    # words that are not numbers; the first of each option is its default
    options: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    free_options: ClassVar[tuple[str, ...]] = ()  # options that accept any word, e.g. a signal's name
    extents_by_default: ClassVar[Mapping[str, int]] = {}  # lengths of free dimensions if no values are given

    # Properties that other code needs.
    overhead: ClassVar[bool] = False  # True if its power is drawn whether the arm moves or not: counted as standby
    stores: ClassVar[bool] = False  # True if its work is the change of `stored` between the ends, whatever the path
    drifts: ClassVar[bool] = False  # True if the law depends on time
    dissipates: ClassVar[bool] = False  # True if its share of the energy is never negative
    convex_in_retiming: ClassVar[bool] = True  # True if retiming stays convex under this effect
    follows: ClassVar[tuple[str, ...]] = ()  # signals of the past or the recording that the law uses
    bakes: ClassVar[bool] = False  # True if its values are numbers, not parameters, of the inverse dynamics
    needs: ClassVar[tuple[str, ...]] = ()  # effects that it requires
    contains: ClassVar[tuple[str, ...]] = ()  # effects whose sum is a special case of this one, see `containing`
    # Parameters that the law multiplies by another one, and the product's bound in a fit: {"com": ("mass", 100.0)}.
    products: ClassVar[Mapping[str, tuple[str, float]]] = {}
    same_on_all_joints: ClassVar[bool] = True  # True if one number may represent all joints in a fit
    sought: ClassVar[bool] = True  # True if diagnosis may propose it when a declared model lacks it
    version: ClassVar[int] = 0  # counts how often a class of this name was registered again

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if "parameters" not in cls.__dict__:
            return
        # parameters as keywords, annotated with unit and size; options with their default
        keyword = partial(inspect.Parameter, kind=inspect.Parameter.KEYWORD_ONLY)
        numbers = [keyword(p.name, annotation=described(p)) for p in cls.parameters]
        kinds = {key: str if key in cls.free_options else Literal[words] for key, words in cls.options.items()}
        words = [keyword(key, default=words[0], annotation=kinds[key]) for key, words in cls.options.items()]
        cls.__signature__ = inspect.Signature([*numbers, *words])  # type: ignore[attr-defined]

    def __init__(self, **values: Any) -> None:
        self.values: dict[str, np.ndarray] = {}
        self.choices: dict[str, str] = {}
        self.extents: dict[str, int] = {}
        known, faults = {p.name: p for p in self.parameters}, list[str]()
        for key in values:
            if key not in known and key not in self.options:
                expected = ", ".join([*known, *self.options])
                faults.append(f"effect {self.name}: unknown parameter {key!r}; it has {expected}")
        for key, p in known.items():
            if key not in values:
                faults.append(f"effect {self.name}: parameter {key!r} is missing [{p.unit}]")
                continue
            try:
                self.values[key] = p.checked(self.name, values[key], self.extents)
            except BadInput as error:
                faults.append(str(error))
        for key, words in self.options.items():
            word = values.get(key, words[0])
            if not isinstance(word, str) or (word not in words and key not in self.free_options):
                faults.append(f"effect {self.name}: {key} = {word!r}; expected one of {', '.join(words)}")
            self.choices[key] = word
        refuse(faults)

    @property
    def form(self) -> tuple[str, ...]:
        """Structure for a built problem: name, options and lengths, not values; see `registry.of_form`."""
        words = {**self.choices, **self.extents}
        mark = (f"@{self.version}",) if self.version else ()
        return (self.name, *(f"{key}={word}" for key, word in sorted(words.items())), *mark)

    def full(self, joints: int) -> np.ndarray:
        """All parameters as one vector, per-joint ones expanded; shape (sum of counts,)."""
        parts = [p.full(self.name, self.values[p.name], joints, self.extents) for p in self.parameters]
        return np.concatenate(parts) if parts else np.zeros(0)

    def named(self, vector: ca.SX, joints: int) -> SimpleNamespace:
        """The parameters as a law receives them: `split` of a column laid out as `full`, with options and lengths of
        dimensions.

        Args:
            vector: (size, 1), symbols or numbers. joints: number of joints.
        """
        out = self.split(vector, joints, self.extents)
        out.__dict__.update(self.choices)
        return out

    @classmethod
    def size(cls, joints: int, extents: Mapping[str, int] | None = None) -> int:
        """Length of `full`."""
        return sum(p.count(joints, cls._extents(extents)) for p in cls.parameters)

    @classmethod
    def split(cls, vector: ca.SX, joints: int, extents: Mapping[str, int] | None = None) -> SimpleNamespace:
        """The parameters by name, cut out of a column.

        Args:
            vector: (size, 1), laid out as `full`. joints: number of joints.
            extents: lengths of free dimensions, by name.
        """
        known = cls._extents(extents)
        out, at = SimpleNamespace(**known), 0
        for p in cls.parameters:
            count = p.count(joints, known)
            setattr(out, p.name, vector[at : at + count])
            at += count
        return out

    @classmethod
    def from_full(cls, vector: Sequence[float] | np.ndarray, joints: int, **words: str | int) -> Effect:
        """The effect with given values.

        Args:
            vector: (size,) laid out as `full`. joints: number of joints.
            words: options, and lengths of free dimensions.
        """
        known = cls._extents({key: int(word) for key, word in words.items() if key not in cls.options})
        parts = vars(cls.split(np.asarray(vector, dtype=float), joints, known))
        values = {p.name: parts[p.name].reshape(p.shape(joints, known) or (1,)) for p in cls.parameters}
        return cls(**values, **{key: word for key, word in words.items() if key in cls.options})

    @classmethod
    def neutral(cls, joints: int, **words: str | int) -> Effect:
        """The effect at its neutral value: it changes nothing."""
        known = cls._extents({key: int(word) for key, word in words.items() if key not in cls.options})
        full = [np.full(p.count(joints, known), p.neutral) for p in cls.parameters]
        return cls.from_full(np.concatenate(full) if full else np.zeros(0), joints, **words)

    @classmethod
    def _extents(cls, given: Mapping[str, int] | None) -> dict[str, int]:
        """Lengths of all free dimensions: those given, else the defaults of the class."""
        return {**cls.extents_by_default, **(given or {})}

    @classmethod
    def offered(cls, recorded: Collection[str]) -> list[dict[str, str]]:
        """Options and lengths under which diagnosis may propose it, from the names of the signals that are recorded.

        None of the signals that its law follows may be missing.
        """
        if not set(cls.follows) <= set(recorded):
            return []
        return [dict(zip(cls.options, words, strict=True)) for words in product(*cls.options.values())]

    @classmethod
    def stored(cls, q: ca.SX, v: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Energy [J] held at position q and velocity v (n, 1), of an effect that `stores`."""
        raise NotImplementedError

    @classmethod
    def return_factor(cls, p: SimpleNamespace) -> ca.SX | float:
        """Factor with which mechanical power that was stored and is returned passes the effect to the meter."""
        return 1.0

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        """Parameter values (size,), laid out as `full`, away from neutral and inside the bounds, for checks."""
        out: list[float] = []
        for p in cls.parameters:
            for _ in range(p.count(joints, cls._extents(None))):
                size = 0.1 if p.neutral == 0 else 0.15 * abs(p.neutral)
                away = size * rng.uniform(0.6, 1.4)
                value = p.neutral + away if p.neutral + away <= p.upper else p.neutral - away
                out.append(float(np.clip(value, p.lower, p.upper)))
        return np.array(out)

    # A fit works with numbers x in which the effect is (nearly) linear, instead of `full`. They equal `full`, but
    # `products` take the place of their parameters.

    @classmethod
    def containing(cls, *others: Effect) -> tuple[Effect, ...]:
        """Effects that each equal the sum of `others`, the effects `contains`; they differ in numbers that matter only
        elsewhere.
        """
        raise NotImplementedError(cls.name)

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        """The effect at a value where it changes almost nothing, but where its derivatives by all parameters are
        informative.
        """
        return cls.neutral(joints, **words)

    @classmethod
    def to_chart(cls, full: np.ndarray, joints: int) -> np.ndarray:
        """Coordinates x (size,) of a fit, from values (size,) laid out as `full`.

        A parameter of `products` is replaced by its product with its factor, such as mass * com.
        """
        x, (times, by) = np.array(full, dtype=float), cls._products(joints)
        x[times] *= full[by]
        return x

    @classmethod
    def from_chart(cls, x: np.ndarray, joints: int) -> np.ndarray:
        """Values (size,), laid out as `full`, from coordinates x (size,); the inverse of `to_chart`.

        A factor near 0 is replaced by SMALL before the division.
        """
        full, (times, by) = x.copy(), cls._products(joints)
        full[by] = _nonzero(x[by])
        full[times] /= full[by]
        return full

    @classmethod
    def chart_slope(cls, x: np.ndarray, joints: int) -> np.ndarray:
        """d full / d x (square), for y = x_t / f with f the factor: dy / dx_t = 1 / f and dy / df = -x_t / f^2."""
        out, (times, by) = np.eye(len(x)), cls._products(joints)
        factor = _nonzero(x[by])
        out[times, times], out[times, by] = 1 / factor, -x[times] / factor**2
        return out

    @classmethod
    def chart_bounds(cls, joints: int) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest coordinates x of a fit, (size,) each."""
        known = {name: (-most, most) for name, (_, most) in cls.products.items()}
        each = [(known.get(p.name, p.bounds), p.count(joints, cls.extents_by_default)) for p in cls.parameters]
        bounds = np.array([pair for pair, count in each for _ in range(count)]).reshape(-1, 2)
        return bounds[:, 0], bounds[:, 1]

    @classmethod
    def _products(cls, joints: int) -> tuple[np.ndarray, np.ndarray]:
        """Indices in `full` of the parameters of `products`, and of the factors that multiply them."""
        at = cls.split(np.arange(cls.size(joints)), joints).__dict__
        pairs = [np.broadcast_arrays(at[name], at[factor]) for name, (factor, _) in cls.products.items()]
        none = np.zeros(0, dtype=int)
        return np.concatenate([none, *(own for own, _ in pairs)]), np.concatenate([none, *(by for _, by in pairs)])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Effect) or type(other) is not type(self) or other.choices != self.choices:
            return False
        return all(np.array_equal(value, other.values[key]) for key, value in self.values.items())

    def __hash__(self) -> int:
        return hash((type(self), *(value.tobytes() for value in self.values.values())))

    def __repr__(self) -> str:
        given = {**{k: _short_text(v) for k, v in self.values.items()}, **{k: repr(w) for k, w in self.choices.items()}}
        return f"{type(self).__name__}({', '.join(f'{k}={v}' for k, v in given.items())})"


def described(p: Parameter) -> str:
    """Unit and size of a parameter in words, as "N m, a number or one per joint"."""
    if p.size == "scalar":
        return p.unit
    if p.size == "joint":
        return f"{p.unit}, a number or one per joint"
    sizes = [f"{d} numbers" if isinstance(d, int) else f"one per {d.rstrip('s')}" for d in p.dimensions]
    return f"{p.unit}, {', '.join(sizes)}"


def _nonzero(factor: np.ndarray) -> np.ndarray:
    """A divisor with small values (below SMALL) replaced by SMALL."""
    return np.where(np.abs(factor) < SMALL, SMALL, factor)


def _short_text(value: np.ndarray) -> str:
    """A value in few characters, for `repr`."""
    if value.size == 1:
        return f"{value.item():.6g}"
    if value.ndim > 1:
        return f"<{' x '.join(str(n) for n in value.shape)} numbers>"
    return f"[{', '.join(f'{x:.6g}' for x in value)}]"
