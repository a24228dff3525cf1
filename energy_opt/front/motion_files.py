"""Motions that a caller from Python holds in memory, as files that verbs read and that requests name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from energy_opt import formats
from energy_opt.errors import BadInput, shown
from energy_opt.evaluations.source import ANSWERS
from energy_opt.files import path_of, write_json
from energy_opt.folders import digest_of, written_whole
from energy_opt.front.desk import Answered
from energy_opt.motion.trajectory import Trajectory


def trajectory_of(given: Any) -> Any:
    """The trajectory of a result; anything else as it is."""
    return getattr(given, "trajectory", given)


def put_motions(given: Iterable[Any], folder: Path, prefix: str = "") -> tuple[str, ...]:
    """Write the motions that are no files into `folder`; return the names of all files.

    A result of `optimize` or `job` becomes a folder with what `evaluate` reads of it, any other motion a table. The
    names contain a digest: a file of another motion is never taken for it.

    Args:
        given: files, trajectories and results. prefix: of the joints' names in a table.

    Raises:
        BadInput: something else is given.
    """
    names = []
    for k, each in enumerate(given, start=1):
        if isinstance(each, (str, PathLike)):
            names.append(str(path_of(each, "FILE")))
            if re.match(r"motion_\d\d_[0-9a-f]{8}\b", names[-1]) and not Path(each).exists():
                raise BadInput(
                    f"{each}: no file of this motion from memory; save it as one, or save the result of evaluate and "
                    "repeat its folder"
                )
            continue
        motion = trajectory_of(each)
        if not isinstance(motion, Trajectory):
            raise BadInput(f"{shown(each)}: expected files, trajectories, or results of optimize or job")
        table = folder / "motion.csv"
        answer = each.request.answer if isinstance(each, Answered) else ""
        own = replace(motion, joints=tuple(("" if answer else prefix) + joint for joint in motion.joints))
        formats.write(own, table)
        name = f"motion_{k:02d}_{(digest_of(table) or '')[:8]}"
        if answer in ANSWERS:
            with written_whole(folder / name, answer) as aside:
                table.rename(aside / ANSWERS[answer])
                write_json(aside / answer, each.document())
            names.append(f"{name}/{ANSWERS[answer]}")
        else:
            table.rename(folder / f"{name}.csv")
            names.append(f"{name}.csv")
    return tuple(names)


@contextmanager
def motion_files(given: Iterable[Any], prefix: str = "") -> Iterator[tuple[Path, tuple[str, ...], list[Path]]]:
    """For the block: a folder with the motions that are no files, names of all as `put_motions` gives, their files."""
    with TemporaryDirectory(prefix="energy_opt-") as name:
        folder = Path(name)
        try:
            names = put_motions(given, folder, prefix)
            yield folder, names, [folder / each if (folder / each).is_file() else Path(each) for each in names]
        except BadInput as error:
            if name not in str(error):
                raise
            said = re.sub(rf"{re.escape(name)}/motion_(\d+)_[^:, ]*", r"trajectory \1", str(error))
            raise BadInput(said) from None
