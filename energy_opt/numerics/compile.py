"""Compiled node functions: generated C, built once per content, in a cache that belongs to the user alone.

The cache's key is a hash of the functions, the compiler, the flags and the processor, so a changed robot or model
structure, or another machine with the same home, never gets an old binary. Two processes at once may build the same
twice. `auto` never compiles: it uses what is in the cache. Compiling takes 4 to 17 s and then saves a tenth to a fifth
of a move's time, so only hundreds of moves are worth it (`benchmarks/compiled.py`). If there is no home, or the cache
cannot be used, `auto` continues without it, and `always` compiles for this process alone.
"""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

import casadi as ca

from energy_opt.errors import BadInput
from energy_opt.numerics import lanes, library
from energy_opt.numerics.lanes import Compiled

log = logging.getLogger(__name__)
RATE = 2e4  # [characters of C per second] approximate speed of compiling, for the estimate of the remaining time
POLICIES = ("auto", "always", "never")

Source = Callable[[], str]  # returns the C source, which is written only for a build


def compiler() -> str | None:
    """The C compiler: $CC, else cc, gcc or clang; None if there is none."""
    names = [name for name in (os.environ.get("CC"), "cc", "gcc", "clang") if name]
    return next((path for name in names if (path := shutil.which(name))), None)


def _source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("nodes.c")
    for function in functions:
        generator.add(function)
    return str(generator.dump())


@lru_cache(maxsize=1)
def _own_folder() -> Path:
    """A temporary folder for this process's libraries."""
    out = tempfile.mkdtemp(prefix="energy-opt-")
    atexit.register(shutil.rmtree, out, ignore_errors=True)
    return Path(out)


def library_of(source: str, flags: tuple[str, ...]) -> Path | None:
    """The library of a C source, built now if it is not in the cache; None without a compiler.

    Raises:
        BadInput: the compiler fails, or nothing can be written anywhere.
    """
    cc = compiler()
    return None if cc is None else _always(lambda: source, cc, library.key_of(source, cc, *flags), flags)


def _always(source: Source, cc: str, key: str, flags: tuple[str, ...] = ()) -> Path:
    """The library, built now if it is not in the cache.

    Raises:
        BadInput: the compiler fails, or nothing can be written anywhere.
    """

    def inside(cache: Path) -> Path:
        found = library.find(cache, key)
        if found is not None:
            return found
        code = source()
        log.info("compiling functions, once and for all later runs", extra={"expected": len(code) / RATE})
        return library.build(cache, key, code, cc, flags)

    try:
        try:
            return inside(library.folder())
        except library.Unusable:
            return inside(_own_folder())
    except (library.Unusable, OSError) as error:
        raise BadInput(f"--compile always: {error}") from None


def _cached(key: str) -> Path | None:
    """The library if it is in the cache."""
    try:
        return library.find(library.folder(), key)
    except (library.Unusable, OSError):
        return None


def compiled(functions: Sequence[ca.Function], policy: str = "auto") -> tuple[list[ca.Function] | list[Compiled], bool]:
    """The functions for `numerics.batch`, compiled where the policy and the machine allow; and whether they are.

    Args:
        policy: "always" builds now, "never" uses no compiled functions, "auto" as the module says.

    Raises:
        BadInput: an unknown policy, or "always" without a compiler.
    """
    if policy not in POLICIES:
        raise BadInput(f"--compile {policy!r}; expected one of {', '.join(POLICIES)}")
    cc = compiler()
    if policy == "never" or (cc is None and policy == "auto"):
        return list(functions), False
    if cc is None:
        raise BadInput("--compile always: no C compiler found (cc, gcc or clang, or name one in CC)")
    how = Path(lanes.__file__).read_text(encoding="utf-8")
    key = library.key_of(*(function.serialize() for function in functions), how, cc, ca.CasadiMeta.version())

    def source() -> str:
        return lanes.source_of(functions, _source(functions))

    found = _always(source, cc, key) if policy == "always" else _cached(key)
    if found is None:
        return list(functions), False
    return [Compiled.of(function, found) for function in functions], True
