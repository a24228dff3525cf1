"""Compiled node functions: generated C, built once per content, in a cache that belongs to the user alone.

The cache's key is a hash of the functions, the compiler, the flags and the processor, so a changed robot or model
structure, or another machine with the same home, never gets an old binary. Two processes at once may build the same
twice. `auto` never compiles: it uses what is in the cache. Compiling takes 4 to 17 s and then saves a tenth to a fifth
of a move's time, so only hundreds of moves are worth it (`benchmarks/compiled.py`). If there is no home, or the cache
cannot be used, `auto` continues without it, and `always` compiles for this process alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from energy_opt.errors import BadInput
from energy_opt.numerics import lanes, library
from energy_opt.numerics.lanes import Compiled
from energy_opt.numerics.native import LANES

POLICIES = ("auto", "always", "never")


def _source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("nodes.c")
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def _cached(key: str) -> Path | None:
    """The library if it is in the cache and can be loaded."""
    try:
        found = library.find(library.folder(), key)
        return None if found is None else library.loaded(found)
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
    cc = library.compiler()
    if policy == "never" or (cc is None and policy == "auto"):
        return list(functions), False
    if cc is None:
        raise BadInput("--compile always: no C compiler found (cc, gcc or clang, or name one in CC)")
    how = Path(lanes.__file__).read_text(encoding="utf-8")
    key = library.key_of(*(f.serialize() for f in functions), how, str(LANES), cc, ca.CasadiMeta.version())

    def source() -> str:
        return lanes.source_of(functions, _source(functions))

    try:
        found = library.found_or_built(key, source, cc) if policy == "always" else _cached(key)
    except library.Unusable as error:
        raise BadInput(f"--compile always: {error}") from None
    if found is None:
        return list(functions), False
    return [Compiled.of(function, found) for function in functions], True
