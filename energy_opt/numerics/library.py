"""Compiled libraries on disk: a private folder of the user, built aside, verified before anything is loaded.

A library is in the cache as <key>-<bytes>-<sha256>.so, put there by one rename. A file whose size or hash differs from
its name (truncated by a full disk, or changed) is removed and built again. Nothing is written through links, and
folders or files that others own or may write to are not used.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import logging
import os
import platform
import shutil
import stat
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

log = logging.getLogger(__name__)
RATE = 2e4  # [characters of C per second] approximate speed of compiling, for the estimate of the remaining time

# -O2: at -O1, GCC does not clear the wide registers before it calls `tanh` or `sin`, and each call waits for that: it
# takes 16 times as long (tests/numerics/test_lanes.py compares it with NumPy).
FLAGS = ("-O2", "-march=native", "-fPIC", "-shared")
OWN, TAG = "compiled", ".energy_opt_cache"  # the cache's folder in the named one, and the file that marks it
PATIENCE = 600.0  # [s] after this time what a build left behind is removed: it was killed
CPU_LINES = ("vendor_id", "cpu family", "model", "flags", "CPU implementer", "CPU part", "Features", "isa")


class Unusable(Exception):
    """There is no usable cache, or no library in it; the message states why in one line."""


def compiler() -> str | None:
    """The C compiler: $CC, else cc, gcc or clang; None if there is none."""
    names = [name for name in (os.environ.get("CC"), "cc", "gcc", "clang") if name]
    return next((path for name in names if (path := shutil.which(name))), None)


@lru_cache(maxsize=1)
def cpu() -> str:
    """The processor as far as -march=native depends on it: a library for another may contain illegal instructions.

    With it the C library, as one built with a newer one is not loaded.
    """
    said = [platform.machine(), platform.processor(), *platform.libc_ver()]
    try:
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").split("\n\n")[0]
    except OSError:
        return "\n".join(said)
    return "\n".join(said + [line for line in first.splitlines() if line.split(":")[0].strip() in CPU_LINES])


def folder() -> Path:
    """The folder of compiled functions: one inside $ENERGY_OPT_CACHE, or inside the user's cache folder.

    It is marked by a tag. Other files in the named folder, and a folder of that name without the tag, are never
    changed.

    Raises:
        Unusable: it cannot be created or written to, is a link, belongs to another user, or others may write to it.
    """
    try:
        named = os.environ.get("ENERGY_OPT_CACHE")
        root = os.environ.get("XDG_CACHE_HOME")
        above = (Path(named) if named else (Path(root) if root else Path.home() / ".cache") / "energy_opt").absolute()
        for out in (above, above / OWN):
            out.mkdir(parents=True, exist_ok=True, mode=0o700)
            _private(out)
        tag = above / OWN / TAG
        if not tag.is_file():
            others = any(path.name != TAG for path in (above / OWN).iterdir())
            if others and not tag.is_file():  # another thread or process may have made both in the meantime
                raise Unusable(f"{above / OWN}: not a cache of this program: it contains files, but no {TAG}")
            tag.touch(mode=0o600)
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
        raise Unusable(f"no cache folder: {error}") from None
    return above / OWN


def _private(out: Path) -> None:
    """Raise Unusable if a folder is not one that only the user may write to."""
    found = os.lstat(out)
    if not stat.S_ISDIR(found.st_mode):
        raise Unusable(f"{out}: a link or file where the cache folder should be")
    if hasattr(os, "geteuid") and found.st_uid != os.geteuid():
        raise Unusable(f"{out}: the cache folder belongs to another user")
    if found.st_mode & 0o022:
        raise Unusable(f"{out}: others may write to the cache folder; chmod 700 makes it private")
    if not os.access(out, os.W_OK | os.X_OK):
        raise Unusable(f"{out}: the cache folder cannot be written to")


def key_of(*parts: str) -> str:
    """The cache key of a source for this compiler and this processor."""
    return hashlib.sha256("\0".join([*parts, *FLAGS, cpu()]).encode()).hexdigest()[:32]


def _digest(path: Path) -> str:
    """`<bytes>-<sha256>` of a regular file of the user's own that nobody else may write to.

    Raises:
        OSError: it is no such file, or cannot be read.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    with os.fdopen(handle, "rb") as stream:
        found = os.fstat(stream.fileno())
        if not stat.S_ISREG(found.st_mode) or found.st_mode & 0o022:
            raise OSError(f"{path}: not a private file")
        if hasattr(os, "geteuid") and found.st_uid != os.geteuid():
            raise OSError(f"{path}: another user's")
        content = stream.read()
    return f"{len(content)}-{hashlib.sha256(content).hexdigest()[:32]}"


def find(cache: Path, key: str) -> Path | None:
    """The verified library of that key; files that fail the check are removed."""
    for path in sorted(cache.glob(f"{key}-*.so")):
        try:
            if path.name == f"{key}-{_digest(path)}.so":
                return path
        except OSError:
            pass
        with suppress(OSError):  # another process may have removed it; a folder of that name is left alone
            path.unlink()
    return None


def loaded(path: Path) -> Path:
    """The path of a library that this process has loaded.

    Raises:
        Unusable: it cannot, as on a file system mounted without execution (`noexec`).
    """
    try:
        ctypes.CDLL(str(path))
    except OSError as error:
        raise Unusable(f"the node functions cannot be loaded: {error}") from None
    return path


def found_or_built(key: str, source: Callable[[], str], cc: str, flags: tuple[str, ...] = ()) -> Path:
    """The loaded library of that key, built now if it is not in the cache.

    It is built for this process alone if there is no cache, or if nothing can be loaded from it.

    Args:
        source: returns the C source, which is written only for a build. cc, flags: see `build`.

    Raises:
        Unusable: the compiler fails, or nothing can be written to, or loaded from, any folder.
    """

    def inside(cache: Path) -> Path:
        found = find(cache, key)
        if found is not None:
            return loaded(found)
        code = source()
        log.info("compiling functions, once and for all later runs", extra={"expected": len(code) / RATE})
        return loaded(build(cache, key, code, cc, flags))

    with suppress(Unusable):
        return inside(folder())
    try:
        return inside(_own_folder())
    except OSError as error:
        raise Unusable(f"no folder for the node functions: {error}") from None


@lru_cache(maxsize=1)
def _own_folder() -> Path:
    """A temporary folder for this process's libraries."""
    out = tempfile.mkdtemp(prefix="energy-opt-")
    atexit.register(shutil.rmtree, out, ignore_errors=True)
    return Path(out)


def build(cache: Path, key: str, source: str, cc: str, flags: tuple[str, ...] = ()) -> Path:
    """Compile C in a folder of its own, and put the library into the cache.

    Args:
        cache: a private folder, as `folder` gives it. key: of the library, by which it is found again.
        source: the C. cc: the compiler's path. flags: after the usual ones.

    Raises:
        Unusable: the compiler fails, or the disk is full.
    """
    sweep(cache)
    try:
        with tempfile.TemporaryDirectory(prefix="build-", dir=cache) as aside:
            code, built = Path(aside) / "nodes.c", Path(aside) / "nodes.so"
            code.write_text(source, encoding="utf-8")
            done = subprocess.run(
                [cc, *FLAGS, str(code), "-o", str(built), *flags], capture_output=True, text=True, cwd=aside
            )
            if done.returncode:
                said = done.stderr.strip().splitlines() or [f"exit {done.returncode}"]
                why = next((line for line in said if "error" in line), said[-1])
                raise Unusable(f"{cc} cannot build the node functions: {why}")
            built.chmod(0o700)
            library = cache / f"{key}-{_digest(built)}.so"
            os.replace(built, library)
            return library
    except OSError as error:
        raise Unusable(f"the node functions cannot be built: {error}") from None


def sweep(cache: Path) -> None:
    """Remove what killed builds have left behind."""
    for path in cache.glob("build-*"):
        try:
            if time.time() - os.lstat(path).st_mtime > PATIENCE:
                shutil.rmtree(path)
        except OSError:  # another process was faster
            pass
