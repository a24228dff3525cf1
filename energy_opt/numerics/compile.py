"""Compiled node functions: generated C, built once per content, kept in a private cache.

The cache's key is a hash of the C source, the compiler and the flags, so a changed robot or model structure can never
meet an old binary. A library is built aside and renamed into place: two processes at once do double work at worst.
`auto` never waits for the compiler: it uses what the cache holds, and asks for a build in the background once the same
functions have been wanted before, or builds at once where a batch says that it pays.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from energy_opt.errors import BadInput

FLAGS = ("-O1", "-march=native", "-fPIC", "-shared")
POLICIES = ("auto", "always", "never")


def cache_folder() -> Path:
    """Where compiled functions are kept: $ENERGY_OPT_CACHE, else the user's cache folder; private to the user."""
    root = os.environ.get("ENERGY_OPT_CACHE")
    base = Path(root) if root else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "energy_opt"
    base.mkdir(parents=True, exist_ok=True, mode=0o700)
    return base


def compiler() -> str | None:
    """The C compiler: $CC, else cc, gcc or clang; None where there is none."""
    names = [name for name in (os.environ.get("CC"), "cc", "gcc", "clang") if name]
    return next((path for name in names if (path := shutil.which(name))), None)


def _source(functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator("nodes.c")
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def _library(source: str, cc: str) -> Path:
    content = "\0".join([source, cc, *FLAGS, ca.CasadiMeta.version()])
    return cache_folder() / f"{hashlib.sha256(content.encode()).hexdigest()[:32]}.so"


def _build(source: str, cc: str, library: Path) -> None:
    """Compile `source` and rename the result to `library`."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code, built = Path(folder) / "nodes.c", Path(folder) / "nodes.so"
        code.write_text(source)
        done = subprocess.run([cc, *FLAGS, str(code), "-o", str(built)], capture_output=True, text=True)
        if done.returncode:
            raise BadInput(f"{cc} cannot build the node functions: {done.stderr.strip().splitlines()[-1:]}")
        os.replace(built, library)


def _build_in_background(source: str, cc: str, library: Path) -> None:
    """Start a build that outlives this process; whoever wants the functions next finds them."""
    code = library.with_suffix(".c")
    if code.exists():  # somebody builds it already, or it failed before
        return
    code.write_text(source)
    script = "import sys; from energy_opt.numerics.compile import build_file; build_file(*sys.argv[1:])"
    quiet = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_RDWR, 0) for fd in (0, 1, 2)]
    words = [sys.executable, "-c", script, str(code), cc, str(library)]
    os.posix_spawn(sys.executable, words, os.environ, file_actions=quiet, setpgroup=0)


def build_file(code: str, cc: str, library: str) -> None:
    """Build a source file that was left in the cache; the source goes when the library is there."""
    _build(Path(code).read_text(encoding="utf-8"), cc, Path(library))
    Path(code).unlink(missing_ok=True)


def compiled(
    functions: Sequence[ca.Function], policy: str = "auto", batch: bool = False
) -> tuple[list[ca.Function], bool]:
    """The functions, compiled where the policy and the machine allow; and whether they are.

    Args:
        policy: "always" builds now, "never" keeps CasADi's virtual machine, "auto" as the module says.
        batch: many moves are coming; then "auto" builds now.

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
    source = _source(functions)
    library = _library(source, cc)
    if not library.exists():
        if policy == "auto" and not batch:
            seen = library.with_suffix(".seen")
            if seen.exists():
                _build_in_background(source, cc, library)
            seen.touch()
            return list(functions), False
        _build(source, cc, library)
    return [ca.external(function.name(), str(library)) for function in functions], True
