"""The C files of this folder, compiled once, kept in the cache, called by ctypes; None without a compiler.

The machine's C compiler builds them side by side in one to two seconds; Numba would take fifteen. A quadratic program
of 56 unknowns takes 0.2 ms, in NumPy 5 ms; one of 294 unknowns 1 to 3 ms, with the library PIQP 18 to 38 ms.
"""

from __future__ import annotations

import ctypes
import re
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from energy_opt.numerics import interior
from energy_opt.numerics import library as libraries

LOCAL = 6  # control points of a window
LANES = 8  # points at once: doubles in the widest registers
FLAGS = (
    "-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math", "-fassociative-math", "-fno-signed-zeros", "-lm",
)  # fmt: skip
# GCC vectorises as with -O3 but leaves out its slow passes: a build takes half the time, and the functions are as fast.
# Clang does not know these words.
LEVELS = ("-O2", "-ftree-vectorize", "-fvect-cost-model=dynamic", "-finline-functions", "-fno-ivopts"), ("-O3",)
DEFINED = (
    "BARRIER", "BEGIN_BOX", "BEGIN_ROW", "STUCK", "CLOSE", "STEPS", "PRIMAL", "DUAL", "LEAST_DAMPING", "MOST_DAMPING",
    "HOPELESS",
)  # fmt: skip
# One library for each module that calls it, so that several compilers run at once. All begin with `common.c`.
FILES = {"quadratic": ("banded.c",), "hulls": ("clouds.c", "hulls.c"), "vectors": ("program.c",)}
INTEGERS = ("first", "joint", "wide_first", "place", "place_first")
NUMBERS = ("coefficient", "wide", "gradient", "basis", "border")


class Matrix(ctypes.Structure):
    """The constraints of `quadratic` in the layout of the C functions."""

    _fields_ = (
        [(name, ctypes.c_int64) for name in ("n", "one", "wides", "placed", "places", "borders")]
        + [(name, ctypes.c_void_p) for name in (*INTEGERS, *NUMBERS, "scratch", "by_site")]
        + [("sites", ctypes.c_int64)]
    )


class Clouds(ctypes.Structure):
    """Sets of points in the layout of the C functions: coordinates, and where each set begins."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("x", "y", "z", "first")]


class Hulls(ctypes.Structure):
    """Convex pieces on links in the layout of the C functions."""

    _fields_ = [("points", Clouds)] + [(name, ctypes.c_void_p) for name in ("link", "radius", "middle", "half", "face")]


class Motion(ctypes.Structure):
    """Frames of links at configurations, and how far joints move them, in the layout of the C functions."""

    _fields_ = [
        (name, ctypes.c_void_p) for name in ("rotation", "origin", "axis", "far", "reach", "coupling", "slides")
    ] + [("joints", ctypes.c_int64), ("own", ctypes.c_int64)]


class Pairs(ctypes.Structure):
    """Pairs of bodies in the layout of the C functions."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("a", "b", "moves", "planar", "corners", "wanted")] + [
        ("count", ctypes.c_int64)
    ]


def pointer(x: np.ndarray) -> ctypes.c_void_p:
    """Address of the first entry of a contiguous, writable array; four times as fast as NumPy's own attribute.

    Raises:
        ValueError: the array is not contiguous.
        TypeError: it is read-only.
    """
    return ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(x)) if x.size else None)  # type: ignore[arg-type]


@cache
def library(part: str) -> ctypes.CDLL | None:
    """The compiled functions of a part; None without a compiler, or if it fails."""
    return started(part).result()


def begin() -> None:
    """Begin to find or build all libraries, beside the imports of a run."""
    for part in FILES:
        started(part)


@cache
def started(part: str) -> Future[ctypes.CDLL | None]:
    """The library of a part, which is found or built beside the caller.

    The thread ends with its work: one that waits for more would be missing in a forked process.
    """
    builder = ThreadPoolExecutor(1)
    found = builder.submit(_found_or_built, part)
    builder.shutdown(wait=False)
    return found


@cache
def operations() -> tuple[str, ...]:
    """CasADi's names of the operations that `program.c` knows; an operation's number there is its place here."""
    return tuple(dict.fromkeys(re.findall(r"OP_[A-Z0-9_]+", _text("program.c"))))


def _text(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _found_or_built(part: str) -> ctypes.CDLL | None:
    constants = {"LOCAL": LOCAL, "LANES": LANES} | {name: getattr(interior, name) for name in DEFINED}
    constants |= {name: number for number, name in enumerate(operations())}
    source = "".join(f"#define {name} {value!r}\n" for name, value in constants.items())
    source += "".join(map(_text, ("common.c", *FILES[part])))
    cc = libraries.compiler()
    if cc is None:
        return None
    for level in LEVELS:
        flags = *level, *FLAGS
        with suppress(libraries.Unusable, OSError):
            key = libraries.key_of(source, cc, *flags)
            return ctypes.CDLL(str(libraries.found_or_built(key, lambda: source, cc, flags)))
    return None
