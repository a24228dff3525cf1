"""Checks of arguments by their annotations: a value of another type is refused in one line."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import fields
from numbers import Integral, Real
from os import PathLike
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from energy_opt.errors import BadInput, shown

NUMBERS: dict[Any, type] = {float: Real, int: Integral}  # with NumPy's
WORDS = {
    str: "text", float: "a number", int: "a whole number", bool: "true or false", PathLike: "the name of a file",
    Callable: "a function",
}  # fmt: skip
MAKERS = {"Robot": "load_robot", "PowerModel": "load_model", "Cell": "load_cell"}  # functions that return an object

Taken = TypeVar("Taken", bound=Callable[..., Any])


def fits(value: object, hint: Any) -> bool:
    """Whether a value is of the type that an annotation states. Annotations that are no classes fit all values."""
    kind, parts = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if kind is Literal:
        return isinstance(value, str)
    if kind in NUMBERS:
        return isinstance(value, NUMBERS[kind]) and not isinstance(value, bool)
    if kind is Any or not isinstance(kind, type):
        return True
    if _is_list(kind, parts):
        several = isinstance(value, kind) and not isinstance(value, (str, bytes))
        return several and all(fits(each, parts[0]) for each in value)  # type: ignore[attr-defined]
    return isinstance(value, kind)


def _is_list(kind: Any, parts: tuple[Any, ...]) -> bool:
    """Whether an annotation is a sequence of values of one type."""
    return isinstance(kind, type) and issubclass(kind, Sequence) and bool(parts) and len(parts) == 1 + (kind is tuple)


def in_words(hint: Any) -> str:
    """What an annotation asks for, such as "a number" or "a Robot (load_robot returns one)"."""
    kind, parts = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return " or ".join(in_words(part) for part in parts if part is not NoneType)
    if kind is Literal:
        return "one of " + ", ".join(map(str, parts))
    if _is_list(kind, parts):
        return f"a sequence, each {in_words(parts[0])}"
    name = getattr(kind, "__name__", str(kind))
    article = "an" if name[0] in "AEIOU" else "a"
    return WORDS.get(kind) or f"{article} {name}" + (f" ({MAKERS[name]} returns one)" if name in MAKERS else "")


def expect(value: object, hint: Any, name: str) -> None:
    """Check a value; `name` is that of the argument in messages, such as "--lock".

    Raises:
        BadInput: the value is of another type than `hint` states.
    """
    if not fits(value, hint):
        raise BadInput(f"{name} {shown(value)}: expected {in_words(hint)}")


def check_fields(instance: Any) -> None:
    """Check the fields of a dataclass by their annotations.

    Raises:
        BadInput: names a field with a value of another type.
    """
    hints = _hints(type(instance))
    for field in fields(instance):
        expect(getattr(instance, field.name), hints[field.name], _flag(field.name))


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


_hints: Callable[[Any], dict[str, Any]] = functools.cache(get_type_hints)


def typed(taken: Taken) -> Taken:
    """A function, or a class with its public methods, that refuses arguments of other types than are annotated."""
    if not inspect.isclass(taken):
        return _typed(taken)
    for name, method in list(vars(taken).items()):
        if inspect.isfunction(method) and (name == "__init__" or not name.startswith("_")):
            setattr(taken, name, _typed(method))
    return taken


def _typed(call: Taken) -> Taken:
    signature = inspect.signature(call)

    @functools.wraps(call)
    def checked(*args: Any, **given: Any) -> Any:
        hints = _hints(call)
        for name, value in signature.bind(*args, **given).arguments.items():
            if name in hints and signature.parameters[name].kind is not inspect.Parameter.VAR_KEYWORD:
                expect(value, hints[name], _flag(name))
        return call(*args, **given)

    return checked  # type: ignore[return-value]
