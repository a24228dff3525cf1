"""Compressed parts of bags, unpacked within bounds: the size that a file states is not trusted.

The library unpacks each part at once, whatever its size. Inside `bounded` its decompressors are replaced by ones that
stop at a bound for each part and at one for the whole bag.
"""

from __future__ import annotations

import bz2
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from energy_opt.errors import BadInput

LARGEST_PART = 64 * 10**6  # [bytes] largest chunk or message; recorders write chunks of 1 to 16 MB
LEAST, RATIO = (
    256 * 10**6,
    20,
)  # a bag may unpack to LEAST bytes or RATIO times its size; joint states pack 3 to 10 fold


class Budget:
    """Number of bytes of a bag that may still be unpacked."""

    def __init__(self, path: Path, size: int) -> None:
        self._path, self._left = path, max(LEAST, RATIO * size)

    @property
    def part(self) -> int:
        """Largest size [bytes] of one part."""
        return min(LARGEST_PART, self._left)

    def take(self, count: int, most: int | None = None) -> None:
        """Note that `count` bytes were unpacked, at most `most` of them allowed."""
        if count > (self._left if most is None else most):
            raise BadInput(f"{self._path}: unpacks to far more than it holds; cut out the part that matters")
        self._left -= count

    def unpack(self, new: Callable[[], Any], data: bytes) -> bytes:
        """All frames in `data`, each by a decompressor that `new` makes."""
        out, most = [], self.part
        while data:
            frame = new()
            out.append(frame.decompress(data, max_length=most + 1))
            self.take(len(out[-1]), most)
            most -= len(out[-1])
            if not frame.eof:
                raise BadInput(f"{self._path}: a compressed part of it is cut off")
            data = frame.unused_data or b""
        return b"".join(out)


class _Counted:
    """A compressed file that is open for reading, counted as it is read."""

    def __init__(self, stream: Any, budget: Budget) -> None:
        self._stream, self._budget = stream, budget

    def __enter__(self) -> _Counted:
        return self

    def __exit__(self, *what: object) -> None:
        self._stream.close()

    def read(self, count: int = -1) -> bytes:
        """At most `count` bytes."""
        found: bytes = self._stream.read(min(count, LARGEST_PART) if count >= 0 else LARGEST_PART)
        self._budget.take(len(found))
        return found


@contextmanager
def bounded(path: Path, size: int, first: ModuleType, second: ModuleType, mcap: ModuleType) -> Iterator[None]:
    """Context in which the library unpacks within bounds.

    Args:
        size: of the bag's files, bytes.
        first, second, mcap: the library's readers of ROS 1, of ROS 2, and of MCAP files.
    """
    import lz4.frame

    budget, zstd = Budget(path, size), second.zstd
    lz4_frame, zstd_frame = lz4.frame.LZ4FrameDecompressor, zstd.ZstdDecompressor
    ours = (
        (mcap, "DECOMPRESSORS", {"": lambda data, _: data, "lz4": lambda data, _: budget.unpack(lz4_frame, data),
                                 "zstd": lambda data, _: budget.unpack(zstd_frame, data)}),
        (first, "decompressors", {"none": lambda data: data, "lz4": lambda data: budget.unpack(lz4_frame, data),
                                  "bz2": lambda data: budget.unpack(bz2.BZ2Decompressor, data)}),
        (second, "zstd", SimpleNamespace(
            open=lambda stream, mode: _Counted(zstd.open(stream, mode), budget),
            decompress=lambda data: budget.unpack(zstd_frame, data))),
    )  # fmt: skip
    before = [getattr(module, name) for module, name, _ in ours]
    for module, name, value in ours:
        setattr(module, name, value)
    try:
        yield
    finally:
        for (module, name, _), value in zip(ours, before, strict=True):
            setattr(module, name, value)
