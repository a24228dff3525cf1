"""A power model: a robot's effects with their values, read from and written to a model file."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
from pydantic import ConfigDict, StrictStr

from energy_opt.arguments import expect
from energy_opt.effects import EXACT, BaseTilt, Effect, PowerEffect, SupplyEffect, effect_class, registered
from energy_opt.errors import BadInput, read_each, suggest
from energy_opt.files import path_of, read_toml, write_toml
from energy_opt.schema import Number, Table, parse

FORMAT = "energy-opt/model/1"


class EffectTable(Table):
    """An effect of a model file: its name, the source of its values, and its parameters and options."""

    model_config = ConfigDict(extra="allow")
    name: StrictStr
    source: StrictStr = ""


class RivalTable(Table):
    """Another model that explains the same data."""

    effect: list[EffectTable] = []


class CovarianceTable(Table):
    """Covariance of the numbers `names` of a model, each effect.parameter.index."""

    names: list[StrictStr]
    matrix: list[list[Number]]


class ModelTable(Table):
    """A model file."""

    format: Literal["energy-opt/model/1"]
    robot: StrictStr = ""
    effect: list[EffectTable] = []
    covariance: CovarianceTable | None = None
    rival: list[RivalTable] = []


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of a model's values, from the data that determined them.

    Attributes:
        names: of numbers, see `names_of`. matrix: their covariance (len(names), len(names)), in the numbers' units.
        rivals: other models that explain the same data as well.
    """

    names: tuple[str, ...]
    matrix: np.ndarray
    rivals: tuple[PowerModel, ...] = ()


@dataclass(frozen=True, repr=False)
class PowerModel:
    """The effects of an arm; mechanical power tau^T v [W] is always counted, negative included.

    `model + effect` has one more effect, `model - "name"` one less, `model.replaced(effect)` other values of it.
    `model.save(path)` writes the model file.

    Attributes:
        robot: the robot's name, only a label; lists of values are in the order of the joints of the robot in use.
        effects: at most one of each name; BadInput is raised for two, and for one that needs another.
        uncertainty: of the values, if data determined them; it does not change the power.
    """

    robot: str
    effects: tuple[Effect, ...]
    uncertainty: Uncertainty | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        expect(self.robot, str, "model: robot")
        expect(self.effects, Sequence[Effect], "model: effects")
        names = [e.name for e in self.effects]
        for name in names:
            if names.count(name) > 1:
                raise BadInput(f"model of {self.robot}: effect {name!r} is given twice; merge them into one")
        drives = [e.name for e in self.effects if e.stage == "drive"]
        if len(drives) > 1:
            raise BadInput(f"model of {self.robot}: {' and '.join(drives)} both treat negative power; keep one of them")
        for effect in self.effects:
            for need in effect.needs:
                if need not in names:
                    raise BadInput(f"model of {self.robot}: {effect.name} needs {need}, which the model lacks")

    def is_of(self, robot: str) -> bool:
        """Whether it names the robot of this name, perhaps by the path of its URDF, or none."""
        return not self.robot or robot in (self.robot, Path(self.robot).stem)

    def get(self, name: str) -> Effect | None:
        """The effect of that name, or None."""
        return next((e for e in self.effects if e.name == name), None)

    def replaced(self, effect: Effect) -> PowerModel:
        """The model with `effect` in place of the one of its name, or added to the others."""
        if self.get(effect.name) is None:
            return PowerModel(self.robot, (*self.effects, effect))
        kept = tuple(effect if e.name == effect.name else e for e in self.effects)
        return PowerModel(self.robot, kept)

    def for_move(self, effect: Effect) -> PowerModel:
        """The model, and its rivals, with an effect that belongs to a move: a payload or a tilt.

        The covariance of the other values stays the same.
        """
        uncertainty = self.uncertainty
        if uncertainty is not None:
            kept = [k for k, name in enumerate(uncertainty.names) if name.partition(".")[0] != effect.name]
            names = tuple(uncertainty.names[k] for k in kept)
            rivals = tuple(r.replaced(effect) for r in uncertainty.rivals)
            uncertainty = Uncertainty(names, uncertainty.matrix[np.ix_(kept, kept)], rivals)
        return replace(self.replaced(effect), uncertainty=uncertainty)

    def __add__(self, other: Effect | PowerModel) -> PowerModel:
        """The model with one more effect, or with those of another model. An effect of your own is registered.

        Raises:
            BadInput: it has an effect of that name already (see `replaced`), or an effect of your own has a fault.
        """
        if not isinstance(other, (Effect, PowerModel)):
            return NotImplemented
        more = (other,) if isinstance(other, Effect) else other.effects
        registered(*more)
        return PowerModel(self.robot, (*self.effects, *more))

    def __sub__(self, other: str | Effect | type[Effect]) -> PowerModel:
        """The model without the effect of this name or class.

        Raises:
            BadInput: it has none of that name.
        """
        name = other if isinstance(other, str) else other.name
        if self.get(name) is None:
            names = [e.name for e in self.effects]
            raise BadInput(f"model of {self.robot}: has no {name!r}{suggest(name, names)}; it has {', '.join(names)}")
        return self.without(name)

    def __repr__(self) -> str:
        return f"PowerModel({self.robot!r}: {' + '.join(map(repr, self.effects)) or 'mechanical power alone'})"

    def standing(self, roll: float, pitch: float) -> PowerModel:
        """The model on a base turned by `roll` about x, then `pitch` about y [rad] against gravity.

        Raises:
            BadInput: the model has another tilt of its base.
        """
        turned = BaseTilt(roll=math.remainder(roll, 2 * math.pi), pitch=math.remainder(pitch, 2 * math.pi))
        own = self.get(turned.name)
        if own is None:
            return self if max(map(abs, turned.full(1))) == 0 else self.for_move(turned)
        if not np.allclose(own.full(1), turned.full(1), atol=1e-9):
            raise BadInput(
                f"the model's base_tilt is {', '.join(f'{x:g}' for x in own.full(1))} rad, --base says "
                f"{', '.join(f'{x:g}' for x in turned.full(1))}; give one of them"
            )
        return self

    def without(self, name: str) -> PowerModel:
        """The model without the effect of that name and without the effects that need it."""
        return PowerModel(self.robot, tuple(e for e in self.effects if e.name != name and name not in e.needs))

    @property
    def structure(self) -> tuple[tuple[str, ...], ...]:
        """Structure for a built problem: the effects present and their options, not their values.

        An exception are effects that change links: their values are numbers in the inverse dynamics.
        """
        return tuple(e.form if not e.bakes else (*e.form, f"@{hash(e):x}") for e in self.effects)

    def values(self, joints: int) -> np.ndarray:
        """All parameter values as one vector (P,), effects in order, each laid out as `Effect.full`."""
        return np.concatenate([e.full(joints) for e in self.effects] or [np.zeros(0)])

    def slices(self, joints: int) -> list[slice]:
        """Where each effect's parameters lie in `values`."""
        out, at = [], 0
        for e in self.effects:
            size = e.size(joints, e.extents)
            out.append(slice(at, at + size))
            at += size
        return out

    def places(self, joints: int) -> dict[str, slice]:
        """As `slices`, by the effects' names."""
        return dict(zip((e.name for e in self.effects), self.slices(joints), strict=True))

    def symbols(self, joints: int) -> ca.SX:
        """A symbolic column for `values`."""
        return ca.SX.sym("p", sum(e.size(joints, e.extents) for e in self.effects))

    def with_values(self, vector: Sequence[float] | np.ndarray, joints: int) -> PowerModel:
        """The same effects with the values `vector` (P,), laid out as `values` for so many joints."""
        effects = tuple(
            type(e).from_full(np.asarray(vector)[s], joints, **e.choices, **e.extents)
            for e, s in zip(self.effects, self.slices(joints), strict=True)
        )
        return PowerModel(self.robot, effects)

    def constant_power(self, joints: int) -> float:
        """Power [W] at the meter of what is drawn at every instant, whatever the arm does."""
        named = [(e, e.named(ca.DM(e.full(joints)), joints)) for e in self.effects]
        power = sum(ca.DM(e.constant(p)) for e, p in named if isinstance(e, PowerEffect))
        for effect, p in named:
            if isinstance(effect, SupplyEffect):
                power = effect.at_meter(power, p, EXACT)
        return float(power)

    def kept(self, wanted: Callable[[Effect], bool]) -> PowerModel:
        """The model with only the effects for which `wanted` is true."""
        return PowerModel(self.robot, tuple(e for e in self.effects if wanted(e)))

    @property
    def overhead(self) -> PowerModel:
        """The model of an arm that brakes hold: its motors draw no power."""
        return self.kept(lambda effect: effect.overhead or effect.stage in ("rigid", "torque", "supply"))

    @property
    def bodies(self) -> tuple[PowerModel, ...]:
        """One model for each rigid body: those that differ in payload, tilt or links; here only the model itself."""
        return (self,)

    def shares(self, joints: int, p: ca.SX) -> list[tuple[ca.SX | float, PowerModel, int, ca.SX]]:
        """Terms of the power as a weighted sum: weight, model, its place in `bodies`, and its part of `p`.

        Here only the model itself.
        """
        return [(1.0, self, 0, p)]

    @property
    def weighted(self) -> tuple[tuple[float, PowerModel], ...]:
        """The models that this one is the weighted mean of: itself."""
        return ((1.0, self),)

    def check(self, joints: int) -> None:
        """Raise BadInput where a per-joint list does not have one value for each of the robot's joints."""
        self.values(joints)

    def to_document(self) -> dict[str, Any]:
        """The model file's content."""
        records = []
        for e in self.effects:
            values = ((p.name, e.values[p.name]) for p in e.parameters)
            row = {name: float(x[0]) if x.size == 1 else x.tolist() for name, x in values}
            records.append({"name": e.name, **row, **e.choices})
        document: dict[str, Any] = {"format": FORMAT, "robot": self.robot, "effect": records}
        if self.uncertainty is not None:
            document["covariance"] = {"names": list(self.uncertainty.names), "matrix": self.uncertainty.matrix.tolist()}
            document["rival"] = [{"effect": rival.to_document()["effect"]} for rival in self.uncertainty.rivals]
        return {key: value for key, value in document.items() if key != "rival" or value}

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model file (TOML); BadInput where `path` cannot be written."""
        write_toml(Path(path), self.to_document())


def model_from_document(document: dict[str, Any], where: str) -> PowerModel:
    """A model from a parsed model file; `where` names it in messages.

    Raises:
        BadInput: names `where` and every effect and parameter at fault.
    """
    table = parse(ModelTable, document, where)
    model = _model_of(table.robot, table.effect, where)
    empty = next((k for k, rival in enumerate(table.rival, start=1) if not rival.effect), None)
    if empty is not None:
        raise BadInput(f"{where}: [[rival]] {empty}: no effect; expected [[rival.effect]] tables below it")
    rivals = tuple(
        _model_of(table.robot, rival.effect, f"{where}: [[rival]] {k}") for k, rival in enumerate(table.rival, start=1)
    )
    if table.covariance is None:
        return replace(model, uncertainty=Uncertainty((), np.zeros((0, 0)), rivals) if rivals else None)
    covariance = _covariance(table.covariance, names_of(model), f"{where}: [covariance]")
    return replace(model, uncertainty=Uncertainty(tuple(table.covariance.names), covariance, rivals))


ROUNDED = 1e-3  # errors of correlations in files that are rounded to a few digits


def _covariance(table: CovarianceTable, known: Sequence[str], where: str) -> np.ndarray:
    """The covariance matrix (N, N) of a model's numbers.

    Raises:
        BadInput: a name is unknown or repeated, or the matrix is no covariance of so many numbers.
    """
    names, size = table.names, len(table.names)
    for name in names:
        if name not in known:
            raise BadInput(f"{where} name {name!r} is not effect.parameter.index of the model{suggest(name, known)}")
        if names.count(name) > 1:
            raise BadInput(f"{where} name {name!r} is given twice")
    if [len(row) for row in table.matrix] != [size] * size:
        raise BadInput(f"{where} matrix is not {size} x {size} numbers, as names says")
    matrix = np.array(table.matrix).reshape(size, size)
    variance = np.diag(matrix)
    for name, value in zip(names, variance, strict=True):
        if value < 0:
            raise BadInput(f"{where} the variance of {name} is {value:g}; expected 0 or more")
    spread = np.sqrt(variance)
    correlation = matrix / np.where(spread > 0, spread, 1.0) / np.where(spread > 0, spread, 1.0)[:, None]
    if np.abs(correlation - correlation.T).max(initial=0.0) > ROUNDED:
        raise BadInput(f"{where} matrix is not symmetric")
    if np.linalg.eigvalsh(correlation).min(initial=0.0) < -ROUNDED * size:
        raise BadInput(f"{where} matrix is no covariance: some sum of the numbers would have a negative variance")
    return matrix


def _model_of(robot: str, records: Sequence[EffectTable], where: str) -> PowerModel:
    """A model from its effect tables; every fault names its table's number."""

    def effect(number: int, row: EffectTable) -> Effect:
        try:
            return effect_class(row.name)(**(row.model_extra or {}))
        except BadInput as error:
            raise BadInput("\n".join(f"[[effect]] {number}: {x}" for x in str(error).splitlines())) from None

    try:
        return PowerModel(robot, tuple(read_each(effect, enumerate(records, start=1))))
    except BadInput as error:
        raise BadInput("\n".join(f"{where}: {x}" for x in str(error).splitlines())) from None


def names_of(model: PowerModel) -> list[str]:
    """Every number of a model as effect.parameter.index, the index counting the parameter's numbers row by row."""
    return [f"{e.name}.{p.name}.{k}" for e in model.effects for p in e.parameters for k in range(e.values[p.name].size)]


def read_model(path: str | PathLike[str]) -> PowerModel:
    """Read a model file; see `known.load_model`.

    Raises:
        BadInput: names the file, the effect and the parameter at fault.
    """
    return model_from_document(read_toml(path_of(path, "model"), "model"), str(path))
