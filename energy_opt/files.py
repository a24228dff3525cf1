"""Reading and writing of files. A written file is complete or absent. Errors name the file, the row and the column."""

from __future__ import annotations

import json
import math
import os
import re
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from errno import ENAMETOOLONG
from pathlib import Path
from secrets import token_hex
from typing import Any, TypeGuard

import numpy as np
import tomli_w
import yaml

from energy_opt.errors import BadInput, shown

LARGEST_TEXT = 10**9  # [bytes] largest file that is read whole: an hour of a log at 1 kHz has a third of it
LARGEST_DOCUMENT = 32 * 10**6  # [bytes] largest TOML, JSON or YAML document
DEEPEST = 64  # levels of a document; messages of the field have fewer than ten
MOST_NODES = 2 * 10**6  # most values of a YAML document, aliases expanded


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` when the block ends without an error."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.parent / f".{path.name}.{token_hex(4)}{path.suffix}"
        os.close(os.open(aside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))  # less the umask
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
    try:
        yield aside
        os.replace(aside, path)
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk is met while writing, where no file is named
        raise
    finally:
        aside.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` completely; on an error the old file stays."""
    with replacing(path) as aside:
        aside.write_text(text, encoding="utf-8")


def plain(value: Any) -> Any:
    """`value` as JSON can hold it: arrays become lists, non-finite numbers None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def to_json(value: Any) -> str:
    """One JSON document, strictly valid (no NaN, no Infinity)."""
    return json.dumps(plain(value), indent=2, allow_nan=False) + "\n"


def write_json(path: Path, value: Any) -> None:
    """Write `value` as JSON, as `write_text` does."""
    write_text(path, to_json(value))


def write_toml(path: Path, value: Mapping[str, Any]) -> None:
    """Write `value` as TOML, as `write_text` does."""
    write_text(path, tomli_w.dumps(plain(value)))


def found_beside(name: str, file: Path, found: Callable[[str], bool] = os.path.isfile) -> str | None:
    """What `file` names: the name itself, or beside `file` or in a folder above it; None if none is `found`."""
    at = (name, *(str(folder / name) for folder in file.resolve().parents))
    return next(filter(found, at), None)


def inside(folder: Path, name: str, allow_outside: bool = False) -> Path:
    """The path of a file that is named in a document in `folder`.

    Raises:
        BadInput: the file lies outside of the folder (after links are resolved) and `allow_outside` is False, or the
            locale cannot encode its name.
    """
    path = Path(folder) / name
    try:
        kept = allow_outside or path.resolve().is_relative_to(Path(folder).resolve())
    except UnicodeEncodeError:
        raise BadInput(
            f"{name!r}: not text in this locale's encoding; rename the file, or set LC_ALL=C.UTF-8"
        ) from None
    except (OSError, ValueError, RuntimeError):  # NUL bytes, circles of links, names too long
        kept = False
    if not kept:
        raise BadInput(f"{name!r} lies outside of {folder}; put it there, or add --allow-outside")
    return path


def path_of(given: object, what: str) -> Path:
    """The path of a `what`, such as "model"; BadInput where it is none, or no name of a file, such as a file's text."""
    if isinstance(given, (str, os.PathLike)):
        try:
            os.stat(given)
        except (OSError, ValueError) as error:
            if getattr(error, "errno", None) == ENAMETOOLONG:
                raise BadInput(f"{what} {shown(given)}: too long; expected the name of a file, not its text") from None
        return Path(given)
    raise BadInput(f"{what} {shown(given)}: expected the name of a file")


def read_text(path: Path, most: int = LARGEST_TEXT) -> str:
    """The text of a file of at most `most` bytes; BadInput where there is none, or more."""
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(most + 1)
        if len(data) > most:
            raise BadInput(f"{path}: larger than {most / 1e6:g} MB, the largest size of such a file")
        return data.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text; save it as UTF-8"
        raise BadInput(f"{path}: {reason}") from None


# a.b.c…: tomllib reads such keys in quadratic time
LONG_KEY = re.compile(r"""(?<![\w"'.-])(?:[\w"'-]++\s*+\.\s*+){64}""")


# a key without quotes of other characters than TOML's letters, digits, - and _
FOREIGN_KEY = re.compile(r"""[\s\[]*(?:[\w-]+\.)*([\w-]*[^\W\x00-\x7f][\w-]*)\s*[]=.]""")

KINDS = {"model": ("model/1",), "log": ("log/1",), "suite": ("suite/1",), "job": ("job/1", "job/2")}  # formats of files


def read_toml(path: Path, *kinds: str) -> dict[str, Any]:
    """A TOML document.

    Args:
        path: the file. kinds: of `KINDS`, those that are expected: the document then states a format.

    Raises:
        BadInput: it is malformed (line and column), a key has too many parts, or the format is missing; says what is
            expected.
    """
    text = read_text(path, LARGEST_DOCUMENT)
    forms = ['"energy-opt/' + '" or "energy-opt/'.join(KINDS[kind]) + f'" (a {kind})' for kind in kinds]
    example = kinds[0] if len(kinds) == 1 else "KIND"
    wanted = f"; expected TOML, format = {', '.join(forms)}: see `energy-opt --example {example}`" if kinds else ""
    if text.lstrip().startswith("<"):
        robot = "xacro" if Path(path).suffix.lower() == ".xacro" else "a URDF"
        kind = robot if "<robot" in text else "XML"
        raise BadInput(f"{path}: {kind}, not TOML{wanted}")
    if text.lstrip().startswith("{"):
        inside = '; `energy-opt run` takes results, and requests with the job inside: {"verb": "job", "job": {...}}'
        raise BadInput(f"{path}: JSON, not TOML{inside if 'job' in kinds else wanted}")
    if LONG_KEY.search(text):
        raise BadInput(f"{path}: not valid TOML: a key of more than {DEEPEST} parts")
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError also for numbers with thousands of digits
        at = re.search(r"at line (\d+)", reason := _reason(error))
        foreign = at and FOREIGN_KEY.match(text.split("\n")[int(at[1]) - 1])
        hint = f"; put the name {foreign[1]} in quotes" if foreign else ""
        raise BadInput(f"{path}: not valid TOML: {reason}{hint}{wanted}") from None
    if kinds and "format" not in document:
        raise BadInput(f"{path}: {'format is missing' if document else 'an empty file'}{wanted}")
    return document


def read_json(path: Path) -> Any:
    """A JSON document; BadInput with the position where it is malformed, a key given twice, or too deep nesting."""
    text = read_text(path, LARGEST_DOCUMENT)
    if not text.strip():
        raise BadInput(f"{path}: an empty file; expected JSON")
    try:
        document = json.loads(text, object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: not valid JSON: {_reason(error)}") from None
    level = [document] if isinstance(document, (dict, list)) else []
    for _ in range(DEEPEST):
        level = [x for item in level for x in (item.values() if isinstance(item, dict) else item)]
        level = [x for x in level if isinstance(x, (dict, list))]
        if not level:
            return document
    raise BadInput(f"{path}: nested more than {DEEPEST} levels deep")


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """A table of JSON or YAML; ValueError for a key that is given twice, of which one value would be lost."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"key {key!r} is given twice")
        found[key] = value
    return found


def _reason(error: Exception) -> str:
    """A parser's message in one line."""
    return "nested too deeply" if isinstance(error, RecursionError) else " ".join(str(error).split())


class _Loader(yaml.SafeLoader):
    """YAML with the angle tags of ROS parameter files (`!degrees 360.0`), bounded in depth and in size.

    Size counts an alias as the values that it refers to: a few lines of aliases may mean billions of values.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth, self._total = 0, 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node as PyYAML composes it; a YAMLError if a bound is exceeded."""
        alias = self.check_event(yaml.AliasEvent)
        before, self._depth = self._total, self._depth + 1
        if self._depth > DEEPEST:
            raise yaml.YAMLError(f"nested more than {DEEPEST} levels deep")
        node = super().compose_node(parent, index)
        if alias and id(node) not in self._sizes:
            raise yaml.YAMLError("an alias is inside of what it refers to")
        self._total += self._sizes[id(node)] if alias else 1
        if self._total > MOST_NODES:
            raise yaml.YAMLError(f"more than {MOST_NODES} values, aliases written out")
        self._depth -= 1
        if not alias:
            self._sizes[id(node)] = self._total - before
        return node


class _FastLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]  # none without libyaml
    """The same by libyaml: five times as fast, but without bounds; deep nesting overruns its stack: see `_tame`."""


def _table(loader: Any, node: Any) -> dict[Any, Any]:
    """A YAML table, each key once."""
    _once([(key.value, None) for key, _ in node.value if isinstance(key, yaml.ScalarNode)])
    return dict(loader.construct_mapping(node, deep=True))


EXPONENT = re.compile(r"[-+]?(\d+\.?|\d*\.\d+)[eE][-+]?\d+$")  # a number in YAML 1.2 and ROS, text in YAML 1.1
for _loader in (_Loader, _FastLoader):
    _loader.add_constructor("tag:yaml.org,2002:map", _table)
    _loader.add_implicit_resolver("tag:yaml.org,2002:float", EXPONENT, list("-+.0123456789"))
    _loader.add_constructor("!degrees", lambda loader, node: math.radians(float(str(node.value))))
    _loader.add_constructor("!radians", lambda loader, node: float(str(node.value)))


def _tame(text: str) -> bool:
    """True if a YAML text surely has no alias and fewer than `DEEPEST` levels, by indents, dashes and brackets."""
    if "*" in text or any(len(indent[0]) >= DEEPEST for indent in re.finditer(r"^[ \t?-]*", text, re.MULTILINE)):
        return False
    depth = 0
    for bracket in re.finditer(r"[\[{}\]]", text):
        depth = depth + 1 if bracket[0] in "[{" else max(depth - 1, 0)
        if depth >= DEEPEST:
            return False
    return True


def read_yaml(path: Path) -> Any:
    """A YAML document; BadInput with the position where it is malformed, or too large or deep."""
    return _yaml(path, read_text(path, LARGEST_DOCUMENT), yaml.load)


def read_yaml_documents(path: Path) -> list[Any]:
    """All documents of a YAML file, which `---` separates; empty ones are left out."""
    found = _yaml(path, read_text(path, LARGEST_DOCUMENT), lambda text, Loader: list(yaml.load_all(text, Loader)))
    return [document for document in found if document is not None]


def _yaml(path: Path, text: str, load: Callable[..., Any]) -> Any:
    try:
        return load(text, Loader=_FastLoader if _tame(text) else _Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise BadInput(f"{path}: not valid YAML: {_reason(error)}") from None


def words_of(text: str) -> list[str]:
    """The words of a list, separated by commas, spaces or both; two commas in a row leave an empty word."""
    return re.split(r"\s*,\s*|\s+", text.strip().removesuffix(","))


def is_number(value: object) -> TypeGuard[int | float]:
    """Is an entry a number that a float can hold? (TOML's integers may have thousands of digits.)"""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def finite_number(word: str, where: str, expected: str = "") -> float:
    """A word as a finite number.

    Raises:
        BadInput: it is none; the line begins with `where` and ends with what was `expected`.
    """
    tail = f"; expected {expected}" if expected else ""
    try:
        value = float("none" if "_" in word else word)  # Python reads 3_0 as 30
    except ValueError:
        raise BadInput(f"{where}: {word!r} is not a number{tail}") from None
    if not math.isfinite(value):
        raise BadInput(f"{where}: {word!r} is not finite{tail}")
    return value
