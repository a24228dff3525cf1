"""Numba functions whose machine code is kept in the package's own cache folder, never beside the installed files."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba

from energy_opt.numerics import library

FAST = {"contract", "reassoc", "nsz", "arcp"}  # infinities and NaN keep their meaning


@lru_cache(maxsize=1)
def _folder() -> str:
    """The cache folder; where there is none, a folder of this process that is deleted at its end."""
    try:
        return str(library.folder() / "numba")
    except library.Unusable:
        _folder.own = tempfile.TemporaryDirectory(prefix="energy-opt-")  # type: ignore[attr-defined]
        return str(_folder.own.name)  # type: ignore[attr-defined]


def jit(function: Callable[..., Any]) -> Any:
    """The function compiled when it is first called; later processes load what this one compiled."""
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = _folder()  # type: ignore[attr-defined]
    try:
        return numba.njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]
