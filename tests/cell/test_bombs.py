"""Files that unpack to far more than they hold are refused as they are read, in little memory and time."""

from __future__ import annotations

import bz2
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from machine import allowed
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2 import reader as reader2
from rosbags.typesys import Stores, get_typestore

from energy_opt.batches.records import COLUMNS

ZEROS, TIMES = bytes(1 << 24), 250  # 4 GB in all
KIND = "trajectory_msgs/msg/JointTrajectory"


def frames(pack: Callable[[bytes], bytes]) -> bytes:
    """A few kilobytes that unpack to all the zeros, frame after frame."""
    return pack(ZEROS) * TIMES


def zstd(data: bytes) -> bytes:
    return bytes(reader2.zstd.compress(data))


def bag2(folder: Path, plugin: StoragePlugin, mode: CompressionMode | None = None) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(folder / "bag", version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/plan", KIND, typestore=store)
        writer.write(connection, 0, bytes(64))
    return folder / "bag"


def of_a_file(folder: Path) -> Path:
    """A database that was packed whole."""
    bag = bag2(folder, StoragePlugin.SQLITE3, CompressionMode.FILE)
    next(bag.glob("*.zstd")).write_bytes(frames(zstd))
    return bag


def of_a_message(folder: Path) -> Path:
    """A message that was packed alone."""
    import sqlite3
    from contextlib import closing

    bag = bag2(folder, StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    with closing(sqlite3.connect(next(bag.glob("*.db3")))) as connection, connection as base:
        base.execute("UPDATE messages SET data = ?", (frames(zstd),))
    return bag


def of_a_chunk(compression: str, pack: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        path, data = folder / "bomb.mcap", frames(pack)
        size = (TIMES * len(ZEROS)).to_bytes(8, "little")
        chunk = bytes(16) + size + bytes(4) + len(compression).to_bytes(4, "little") + compression.encode()
        chunk += len(data).to_bytes(8, "little") + data
        header = b"\x01" + (12).to_bytes(8, "little") + b"\x04\0\0\0ros2" + bytes(4)
        end = b"\x0f" + (4).to_bytes(8, "little") + bytes(4) + b"\x02" + (20).to_bytes(8, "little") + bytes(20)
        magic = b"\x89MCAP0\r\n"
        path.write_bytes(magic + header + b"\x06" + len(chunk).to_bytes(8, "little") + chunk + end + magic)
        return path

    return made


def of_ros1(compression: Writer1.CompressionFormat, pack: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        store, path = get_typestore(Stores.ROS1_NOETIC), folder / "bomb.bag"
        writer = Writer1(path)
        writer.set_compression(compression)
        writer.compressor = lambda data: frames(pack)
        with writer:
            connection = writer.add_connection("/plan", KIND, typestore=store)
            writer.write(connection, 0, bytes(64))
        return path

    return made


def of_results(folder: Path) -> Path:
    """A table of a hundred million empty rows."""
    types = {"string": pa.string(), "double": pa.float64(), "int64": pa.int64()}
    table = pa.table({name: pa.nulls(10**6, types[kind]) for name, kind in COLUMNS.items()})
    with pq.ParquetWriter(folder / "results.parquet", table.schema) as writer:
        for _ in range(2):
            writer.write_table(table)
    return folder / "results.parquet"


BOMBS = {
    "mcap, zstd": (of_a_chunk("zstd", zstd), ("check",)),
    "mcap, lz4": (of_a_chunk("lz4", lz4.frame.compress), ("check",)),
    "db3, file": (of_a_file, ("check",)),
    "db3, message": (of_a_message, ("check", "--robot", "panda")),
    "ros1, lz4": (of_ros1(Writer1.CompressionFormat.LZ4, lz4.frame.compress), ("check", "--robot", "panda")),
    "ros1, bz2": (of_ros1(Writer1.CompressionFormat.BZ2, bz2.compress), ("check", "--robot", "panda")),
    "parquet": (of_results, ("bench", "--compare")),
}


MEASURED = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:]).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_maxrss, used.ru_utime + used.ru_stime)
sys.exit(code)
"""


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[] if k == "mcap, zstd" else pytest.mark.slow) for k in BOMBS])
def test_bombs_are_refused(kind: str, tmp_path: Path) -> None:
    make, words = BOMBS[kind]
    bomb = make(tmp_path)
    files = [bomb, bomb] if "--compare" in words else [bomb]
    # a small process in between: a child's peak counts the memory of what it was forked from
    run = subprocess.run(
        [sys.executable, "-c", MEASURED, sys.executable, "-m", "energy_opt", *words, *map(str, files)],
        cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert run.returncode == 2 and "unpacked size" in run.stderr, run.stderr
    kilobytes, seconds = map(float, run.stdout.splitlines()[-1].split())
    assert kilobytes < 500_000 and seconds < allowed(10)
    assert sum(p.stat().st_size for p in tmp_path.rglob("*")) < 10**8
