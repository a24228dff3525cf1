"""Files with a schema: a pydantic model says what may be in a file, and every fault of a file becomes one line.

A fault says what is wrong, where (tables of a list by number and by their `name`), and what would be right.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints, ValidationError

from energy_opt.errors import BadInput, suggest


def _number(value: object) -> object:
    """Only numbers: text and truth values are refused, though pydantic could convert them."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError("expected a number")
    try:
        return float(value)
    except OverflowError:
        raise ValueError("expected a number below 1e300") from None


def reads(read: Callable[[Any], Any]) -> BeforeValidator:
    """A pydantic validator made from a function that reads a value of a file and may raise BadInput."""

    def validate(value: Any) -> Any:
        try:
            return read(value)
        except BadInput as error:
            raise ValueError(str(error)) from None

    return BeforeValidator(validate)


Number = Annotated[float, BeforeValidator(_number), Field(allow_inf_nan=False)]
Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=128, pattern=r"^[^\x00-\x1f\x7f]+$")]


# Expected values by pydantic's name of a fault, if its own words are long.
PLAIN = {
    "string_type": "text", "string_too_short": "text that is not empty", "string_pattern_mismatch": "text in one line",
    "list_type": "a list", "tuple_type": "a list", "dict_type": "a table", "model_type": "a table",
    "bool_type": "true or false", "greater_than": "a number above {gt:g}", "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}", "less_than_equal": "{le:g} or less", "too_short": "{min_length} or more entries",
    "too_long": "{max_length} entries at most",
}  # fmt: skip


KINDS = {kind for kind in PLAIN if kind.endswith("_type")} | {"literal_error"}  # faults of a value of another kind


class Table(BaseModel):
    """A table of a file. Unknown keys are faults. The values cannot be changed after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


Read = TypeVar("Read", bound=Table)


def faults_of(model: type[Read], document: Mapping[str, Any]) -> tuple[Read | None, list[str]]:
    """The document as `model`, or None and all its faults, one line each; a wrong `format` is reported alone."""
    try:
        return model.model_validate(dict(document)), []
    except ValidationError as error:
        faults = error.errors(include_url=False)
        other = [fault for fault in faults if fault["loc"] == ("format",) and "format" in document]
        lines = dict.fromkeys(_line(model, document, fault) for fault in _merged(document, other or faults))
        return None, list(lines)


def parse(model: type[Read], document: Mapping[str, Any], where: str) -> Read:
    """A document as `model`.

    Args:
        where: put before every fault: the file's name.

    Raises:
        BadInput: every fault of the document, one line each.
    """
    found, faults = faults_of(model, document)
    if found is None:
        raise BadInput("\n".join(f"{where}: {fault}" for fault in faults))
    return found


def _merged(document: Mapping[str, Any], faults: Sequence[Any]) -> list[Any]:
    """The faults without those of kinds that a value does not have, where a value may be of several kinds.

    Pydantic tries every kind, reports the faults of each, and puts the kind's name into the place of a fault. Where no
    kind fits the value, one fault names them all.
    """
    values: dict[Any, list[tuple[bool, Any]]] = {}
    for n, fault in enumerate(faults):
        k = _kind_at(document, fault)
        loc = fault["loc"] if k is None else fault["loc"][:k] + fault["loc"][k + 1 :]
        other_kind = k == len(loc) and (fault["type"] in KINDS or fault["msg"].endswith("expected a number"))
        values.setdefault(n if k is None else loc[:k], []).append((other_kind, {**fault, "loc": loc}))
    out = []
    for found in values.values():
        if len(found) > 1 and all(other for other, _ in found):
            texts = list(dict.fromkeys(_expected(fault).removeprefix("expected ") for _, fault in found))
            merged = " or ".join([", ".join(texts[:-1]), texts[-1]] if texts[1:] else texts)
            found = [(False, {**found[0][1], "type": "value_error", "msg": f"expected {merged}"})]
        out += [fault for other, fault in found if not other] or [fault for _, fault in found]
    return out if len(out) == len(faults) else _merged(document, out)


def _kind_at(document: Any, fault: Any) -> int | None:
    """Index of the name of a value's kind in the place of a fault; None without one."""
    at = document
    for k, part in enumerate(fault["loc"]):
        if isinstance(part, int):
            if isinstance(at, list):  # else: the file has a single value in place of a list
                at = at[part] if part < len(at) else None
        elif not isinstance(at, Mapping):
            return k
        elif part in at:
            at = at[part]
        elif k < len(fault["loc"]) - 1 or fault["type"] not in ("missing", "extra_forbidden"):
            return k
    return None


def _line(model: type[Table], document: Mapping[str, Any], fault: Any) -> str:
    """A fault as one line: place, value, and what would be right."""
    place = _place(document, fault["loc"])
    key = str(fault["loc"][-1]) if fault["loc"] else ""
    if fault["type"] == "extra_forbidden":
        known = _keys(model, fault["loc"][:-1])
        return f"{_joined(place[:-1])}unknown key {key!r}{suggest(key, known)}; known: {', '.join(known)}"
    if fault["type"] == "missing":
        return f"{': '.join(place) if isinstance(fault['loc'][-1], int) else _joined(place[:-1]) + key} is missing"
    text = _expected(fault)
    shown = fault.get("input")
    value = "" if isinstance(shown, (Mapping, list)) or not place else f" = {shown!r:.60}"
    head = ": ".join(place)
    return f"{head}{value}{'; ' if value else ': '}{text}" if head else text


def _expected(fault: Any) -> str:
    """What is wrong with a value, without its place."""
    kind, text = fault["type"], str(fault["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    if kind in PLAIN:
        quoted = kind == "bool_type" and isinstance(fault.get("input"), str)
        return f"expected {PLAIN[kind].format(**fault.get('ctx', {}))}{', without quotes' if quoted else ''}"
    return text if kind == "value_error" or text.startswith("expected") else f"expected {text}"


def _joined(place: list[str]) -> str:
    return "".join(f"{part}: " for part in place)


def _place(document: Any, loc: tuple[Any, ...]) -> list[str]:
    """Place of a fault: keys of tables, and entries of lists as `step 2 (weld)`."""
    out: list[str] = []
    at = document
    for part in loc:
        if isinstance(part, int):
            if not isinstance(at, list):  # the file has a single value in place of a list
                continue
            at = at[part] if part < len(at) else None
            named = at.get("name") if isinstance(at, Mapping) else None
            out[-1] += f" {part + 1}" + (f" ({named})" if isinstance(named, str) and named.isprintable() else "")
        else:
            out.append(str(part))
            at = at.get(part) if isinstance(at, Mapping) else None
    return out


def _keys(model: Any, loc: tuple[Any, ...]) -> list[str]:
    """The known keys of a table at `loc` of a model."""
    for part in loc:
        if isinstance(part, int):
            continue
        fields = getattr(model, "model_fields", {})
        found = [f.annotation for name, f in fields.items() if part in (name, f.alias)]
        if not found:
            continue
        model = _model_in(found[0]) or model
    return [f.alias or name for name, f in getattr(model, "model_fields", {}).items()]


def _model_in(annotation: Any) -> Any:
    """The table class in an annotation such as `tuple[Step, ...] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        found = _model_in(part)
        if found is not None:
            return found
    return None
