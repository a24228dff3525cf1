"""The effects that are known by name, and the description of an effect by its class.

Known are the effects of the package, those of installed packages, and those that a user registers. An installed package
names its effects under the entry point group `energy_opt.effects`; each entry is an effect's class, or a module with
effects. `load_file` registers the effects of one Python file.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from energy_opt.effects import changing_friction, electrics, friction, mechanics, meter, recorded, stages
from energy_opt.effects.base import Effect, described
from energy_opt.effects.check import refuse_unusable
from energy_opt.effects.parameter import Parameter
from energy_opt.errors import BadInput, one_line_of, suggest
from energy_opt.files import read_text

STAGES = {
    "rigid": "changes the rigid body",
    "torque": "adds to the motor's torque",
    "heat": "heat of a joint's drive",
    "winding": "multiplies a joint's heat",
    "drive": "between joints and bus",
    "power": "adds to the arm's power",
    "supply": "between bus and meter",
    "meter": "reading of the meter",
}
TRAITS = {
    "overhead": "counted as standby", "stores": "stores energy", "dissipates": "dissipates energy",
    "drifts": "depends on time",
}  # fmt: skip


def described_effect(kind: type[Effect]) -> dict[str, Any]:
    """name, stage, law (the first paragraph of its docstring), parameters, options and traits of an effect."""
    text = inspect.getdoc(kind) or ""
    traits = [STAGES.get(kind.stage, kind.stage)]
    traits += [words for trait, words in TRAITS.items() if getattr(kind, trait)]
    if kind.needs:
        traits.append(f"needs {' and '.join(kind.needs)}")
    if not kind.convex_in_retiming:
        traits.append("retiming is not convex with it")
    return {
        "name": kind.name,
        "class": kind.__name__,
        "stage": kind.stage,
        "law": " ".join(text.split("\n\n")[0].split()),
        "text": text,
        "parameters": [
            {"name": p.name, "unit": p.unit, "words": described(p), "size": p.size, "neutral": p.neutral}
            | {"lower": p.lower, "upper": p.upper}
            for p in kind.parameters
        ],
        "options": {key: list(words) for key, words in kind.options.items()},
        "traits": traits,
    }


LARGEST = 10**6  # [bytes] largest file of effects
GROUP = "energy_opt.effects"

ALL_EFFECTS: tuple[type[Effect], ...] = (
    electrics.Standby, electrics.CopperLoss, friction.CoulombFriction, friction.ViscousFriction,
    friction.StribeckFriction, friction.LoadFriction, mechanics.Armature, mechanics.Payload, mechanics.BaseTilt,
    mechanics.GravitySpring, electrics.Regeneration, friction.GearEfficiency, electrics.InverterLoss,
    electrics.SupplyEfficiency, electrics.MotionPower, electrics.WindingTemperature, electrics.StandbyDrift,
    meter.MeterDelay, meter.MeterFilter, meter.MeterGain, meter.MeterWindow, friction.FrictionCurve,
    friction.AsymmetricFriction, friction.PowerLawFriction, friction.SigmoidFriction, changing_friction.ThermalViscous,
    electrics.PsuLoss, electrics.IronLoss, recorded.DcLink, recorded.IdleHold, recorded.RunOffset,
    mechanics.LinkInertia, recorded.WindingSelfHeating, changing_friction.TemperatureFriction,
    changing_friction.DailyFriction, recorded.SignalPower, mechanics.PayloadChange,
)  # fmt: skip
BY_NAME: dict[str, type[Effect]] = {effect.name: effect for effect in ALL_EFFECTS}

# Methods for the law of an effect, by the base class of its stage: at least one must be defined.
LAWS: dict[type[Effect], tuple[str, ...]] = {
    stages.RigidEffect: ("gravity", "point_mass", "links", "changing_mass"),
    stages.TorqueEffect: ("torque",),
    stages.HeatEffect: ("heat",),
    stages.WindingEffect: ("factor",),
    stages.DriveEffect: ("drawn",),
    stages.PowerEffect: ("power",),
    stages.SupplyEffect: ("at_meter",),
    meter.MeterEffect: ("reading", "sensitivity"),
}

_added: dict[str, type[Effect]] = {}
_versions: dict[str, int] = {}  # the last version of each name, also of those that are no longer registered
_sources: dict[str, tuple[str, str]] = {}  # digest of a file of effects -> its text and path

Kind = TypeVar("Kind", bound=type[Effect])


def register(kind: Kind) -> Kind:
    """Register your own effect, so that model files and options know its name; also usable as a decorator.

    An effect that was registered before from the same place is replaced.

    Raises:
        BadInput: it is not an effect, its name is taken, or a part is missing; the message names it.
    """
    _check(kind)
    held = BY_NAME.get(kind.name) or _added.get(kind.name)
    if held is not None and (held.__module__, held.__qualname__) != (kind.__module__, kind.__qualname__):
        raise BadInput(
            f"effect {kind.name!r} of {kind.__module__}: the name is taken by {held.__module__}.{held.__qualname__}"
        )
    if held is not kind:
        kind.version = _versions[kind.name] = _versions.get(kind.name, -1 if held is None else held.version) + 1
        _added[kind.name] = kind
    return kind


def registered(*effects: Effect) -> None:
    """Register the classes of effects that are not known; errors as in `register`."""
    known = known_effects()
    for effect in effects:
        if known.get(effect.name) is not type(effect):
            register(type(effect))


def unregister(name: str) -> None:
    """Unregister a user's effect; the package's own effects stay."""
    _added.pop(name, None)


def known_effects() -> dict[str, type[Effect]]:
    """Every effect by its name: the package's, those of installed packages, those registered."""
    _installed()
    return {**BY_NAME, **_added}


def effect_class(name: str) -> type[Effect]:
    """The effect of that name.

    Raises:
        BadInput: there is none; the message proposes similar names.
    """
    kinds = known_effects()
    if not isinstance(name, str) or name not in kinds:
        raise BadInput(
            f"unknown name {name!r}{suggest(str(name), kinds)}; load effects of your own first (`--effects FILE.py`, "
            f"`eo.effects.load_file`); known: {', '.join(kinds)}"
        )
    return kinds[name]


def of_form(form: tuple[str, ...], joints: int) -> Effect:
    """An effect of the form that `Effect.form` describes, at its neutral value."""
    name, *words = form
    return effect_class(name).neutral(joints, **words_of(words))


def words_of(words: Iterable[str]) -> dict[str, str]:
    """Options and lengths from their `key=word` form; a version's mark is left out."""
    return dict(word.split("=", 1) for word in words if not word.startswith("@"))


def load_file(path: str | Path) -> list[type[Effect]]:
    """Register every effect that a Python file defines; the same text is run once.

    Raises:
        BadInput: the file cannot be read or run, or holds no effect.
    """
    try:
        text = read_text(Path(path), LARGEST)
    except BadInput as error:
        raise BadInput(f"--effects {error}; expected a Python file of effects") from None
    return load_source(text, str(path))


def load_source(text: str, where: str) -> list[type[Effect]]:
    """As `load_file`, from the text of a file, as another process receives it.

    Args:
        text: Python source. where: names the file in messages.

    Raises:
        BadInput: the text does not run, or it has no effect.
    """
    mark = hashlib.sha256(text.encode()).hexdigest()[:16]
    name = _module(mark)
    if mark in _sources:
        return [register(kind) for kind in _in(sys.modules[name])]
    module = ModuleType(name)
    module.__file__ = where
    sys.modules[name] = module  # so that its effects can be pickled
    try:
        exec(compile(text, where, "exec"), vars(module))
        kinds = _in(module)
        if not kinds:
            raise BadInput(f"{where}: defines no effect: a class with a name, derived from one of energy_opt.effects'")
        for kind in kinds:
            register(kind)
    except BadInput as error:
        del sys.modules[name]
        raise BadInput(f"{where}: {error}" if where not in str(error) else str(error)) from None
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise BadInput(f"{where}: {one_line_of(error, where)}") from None
    _sources[mark] = (text, where)
    return kinds


def loaded_sources() -> tuple[tuple[str, str], ...]:
    """Text and place of every file whose effects are registered. Another process needs these for the same models."""
    kinds = {mark: _in(sys.modules[_module(mark)]) for mark in _sources}
    return tuple(_sources[mark] for mark, own in kinds.items() if any(_added.get(kind.name) is kind for kind in own))


def _module(mark: str) -> str:
    """The name under which a file of effects is imported."""
    return f"energy_opt_effects_{mark}"


def _in(module: ModuleType) -> list[type[Effect]]:
    """The effects that a module itself defines."""
    return [
        x for x in vars(module).values()
        if isinstance(x, type) and issubclass(x, Effect) and x.__module__ == module.__name__ and "name" in vars(x)
    ]  # fmt: skip


@lru_cache(maxsize=1)
def _installed() -> None:
    """Register the effects of installed packages."""
    for entry in entry_points(group=GROUP):
        try:
            found: Any = entry.load()
        except Exception as error:
            raise BadInput(f"entry point {entry.name} = {entry.value} of {GROUP}: {error}") from error
        for kind in _in(found) if isinstance(found, ModuleType) else [found]:
            register(kind)


def _check(kind: Any) -> None:
    """Refuse a class that cannot be an effect: base class, name, parameters and laws must be there, the law usable.

    Raises:
        BadInput: states what is missing.
    """
    if not isinstance(kind, type) or not issubclass(kind, Effect):
        raise BadInput(f"{kind!r} is not an effect: a class derived from one of energy_opt.effects'")
    where = f"effect {kind.__qualname__}"
    bases = [stage for stage in LAWS if issubclass(kind, stage)]
    if not bases:
        expected = ", ".join(stage.__name__ for stage in LAWS)
        raise BadInput(f"{where}: derive it from one of {expected}")
    name = getattr(kind, "name", None)
    if not isinstance(name, str) or not name.isidentifier() or name != name.lower():
        raise BadInput(f"{where}: name = {name!r}; expected lower-case words joined by _")
    parameters = getattr(kind, "parameters", None)
    if not isinstance(parameters, tuple) or not all(isinstance(p, Parameter) for p in parameters):
        raise BadInput(f"{where}: parameters is not a tuple of Parameter")
    laws = LAWS[bases[0]]
    if unbound := [law for law in (*laws, "stored") if not hasattr(getattr(kind, law), "__func__")]:
        raise BadInput(f"{where}: {unbound[0]} is not a class method: write @classmethod above it")
    if all(getattr(kind, law).__func__ is getattr(bases[0], law).__func__ for law in laws):
        raise BadInput(f"{where}: defines no law: {' or '.join(laws)}, as {bases[0].__name__} describes")
    if kind.stores and kind.stored.__func__ is Effect.stored.__func__:  # type: ignore[attr-defined]
        raise BadInput(f"{where}: stores energy, but does not define stored(q, v, p)")
    refuse_unusable(kind)
