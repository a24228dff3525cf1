"""Folders of results: which files belong to which verb.

A folder is locked before the work begins. New and old results are never mixed in it.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from energy_opt.errors import BadInput
from energy_opt.files import plain, read_json, write_json

# Files that show that a folder holds a verb's results; reports, plots and tables of several verbs have the same names.
ANSWERS = {"result.json": "optimize", "tradeoff.json": "tradeoff", "job.json": "job", "results.jsonl": "bench",
           "identify.json": "identify", "diagnosis.json": "diagnose",
           "evaluate.json": "evaluate", "place.json": "place", "passport.json": "passport"}  # fmt: skip
# suffixes of every written format
SUFFIXES = (".csv", ".yaml", ".json", ".mcap", ".goal.yaml", ".script", ".franka.csv")
# All files that each verb may write besides its answer: those of an earlier run are removed when a new one is written.
BESIDE = {
    "result.json": (*(f"trajectory{s}" for s in SUFFIXES), "trajectory_*hz.csv", "trajectory_prefixed.csv",
                    "moves.yaml", "moves.script", "plot.png", "report.html"),
    "tradeoff.json": ("tradeoff.csv", "trajectory_minimum.csv", "trajectory_cycle_minimum.csv", "plot.png",
                      "report.html"),
    "job.json": ("step_[0-9]*.csv", "cycle.csv", "cycle_*.csv", *(f"trajectory{s}" for s in SUFFIXES),
                 "trajectory_*hz.csv", "report.html"),
    "results.jsonl": ("results.parquet", "summary.json", "report.html"),
    "identify.json": ("model_method1.toml", "model_method2.toml", "plot.png", "report.html"),
    "evaluate.json": (*(f"trajectory*{s}" for s in SUFFIXES), "motion_??_????????.csv", "motion_??_????????/*"),
    "diagnosis.json": ("model.toml", "model_warm.toml", "next_motion.csv", "report.html"),
    "passport.json": ("report.html",),
    "place.json": ("map.png", "report.html", "job/*"),
}  # fmt: skip


def no_folder_in_the_way(out: Path, own: str) -> None:
    """Refuse, before the work begins, an `out` with a folder where the verb that writes `own` puts a file.

    Raises:
        BadInput: names it.
    """
    for name in (own, *BESIDE.get(own, ())):
        for path in Path(out).glob(name):
            if path.is_dir():
                raise BadInput(f"{path}: a folder where a file is to be written; move it, or choose another --out")


def files_of_earlier_runs(out: Path, own: str) -> set[Path]:
    """Files in `out` that earlier runs of the verb that writes `own`, or of others with an answer there, have left.

    These are all files that such a verb may write, and files that an answer lists if their digest still agrees.
    """
    out, found = Path(out), set()
    for answer in {own, *(name for name in ANSWERS if (out / name).is_file())}:
        found |= {path for name in (answer, *BESIDE.get(answer, ())) for path in out.glob(name) if not path.is_dir()}
        found |= {
            out / name for name, digest in (listed_files(out / answer) or {}).items() if digest == digest_of(out / name)
        }
    return found


def listed_files(answer: Path) -> dict[str, str] | None:
    """The files that an answer lists, and their digests; None where it has no such list."""
    if answer.suffix != ".json" or not answer.is_file():
        return None
    try:
        document = read_json(answer)
    except BadInput:
        return None
    records = document.get("files") if isinstance(document, dict) else None
    if not isinstance(records, list):
        return None
    own = {str(row.get("name")): str(row.get("sha256")) for row in records if isinstance(row, dict)}
    return {name: digest for name, digest in own.items() if not {"..", "/"} & set(Path(name).parts)}


def wrote(answer: Path, file: Path) -> bool:
    """True if a file beside an answer is the result's own: listed with its digest, or named so if there is no list."""
    listed = listed_files(answer)
    if listed is None:
        return any(fnmatch(file.name, pattern) for pattern in BESIDE[answer.name])
    return file.name in listed and listed[file.name] == digest_of(file)


def digest_of(path: Path) -> str | None:
    """SHA-256 of a file's content; None where there is no file to be read."""
    try:
        with Path(path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return None


def faults_of_results(out: Path) -> list[str] | None:
    """What differs between a folder and the files that its answers list; None where it holds no such answer."""
    answers = [Path(out) / name for name in ANSWERS if (Path(out) / name).is_file()]
    faults = []
    for answer in answers:
        files = listed_files(answer)
        if answer.suffix == ".json" and files is None:
            faults.append(f"{answer}: lists no files with digests, so the other files cannot be checked")
        for name, digest in (files or {}).items():
            found = digest_of(answer.parent / name)
            if found != digest:
                what = "is missing" if found is None else "is not the file that was written"
                faults.append(f"{answer.parent / name}: {what} with {answer.name} (by its SHA-256)")
        own = {answer.parent / name for name in (*(files or ()), *ANSWERS)}
        foreign = files_of_earlier_runs(out, answer.name) - own
        if files is not None and len(answers) == 1:
            faults += [f"{path}: not of the motion that {answer.name} describes" for path in sorted(foreign)]
    return faults if answers else None


def no_other_verb(out: Path, own: str) -> None:
    """Refuse a folder with the results of another verb than that which writes `own`.

    Raises:
        BadInput: there are such results.
    """
    for name, verb in ANSWERS.items():
        if name != own and (Path(out) / name).is_file():
            raise BadInput(f"{out} holds the results of {verb} ({name}); choose another --out, or add --force")


def no_foreign_files(out: Path, own: str) -> None:
    """Refuse a folder with files that a new result would replace, although no earlier result there lists them.

    Where an earlier result has no list, all files with the names of its files count as its own.

    Raises:
        BadInput: names one of these files.
    """
    out = Path(out)
    lists = [listed_files(out / name) for name in ANSWERS if (out / name).is_file()]
    if None in lists:
        return
    known = {*ANSWERS, *(name for files in lists for name in files or ())}
    for path in sorted(files_of_earlier_runs(out, own)):
        if path.parent == out and path.name not in known:
            raise BadInput(
                f"{path}: would be replaced, and no result in {out} lists it; move it, choose another --out, or add "
                "--force"
            )


ASIDE = ".writing-"  # prefix of temporary folders, before the number of the process that writes there

_taken: dict[Path, tuple[int, list[Path]]] = {}  # by folder: the descriptor of its lock, and the folders created for it


def take_folder(out: Path) -> None:
    """Make sure, before the work begins, that results can be written into `out`, by this process alone.

    A lock on the folder keeps other processes out. The lock ends with `leave_folders`, or when the process ends for any
    reason. On file systems without such locks, the complete result of the later run remains.

    Raises:
        BadInput: another run is writing there, it is a file, forbidden, or has no possible name, or the disk is full.
    """
    out = Path(out)
    try:
        key = out.resolve()
        if key in _taken and not out.is_dir():  # removed or renamed during the work, whose result is not lost for that
            os.close(_taken.pop(key)[0])
        if key not in _taken:
            _taken[key] = _locked(out)
        with tempfile.TemporaryFile(dir=out) as stream:
            stream.write(bytes(4096))
    except BlockingIOError:
        raise BadInput(f"{out}: another run is writing here; wait for its end, or choose another --out") from None
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        leave_folder(out)
        raise BadInput(f"--out {out}: cannot be written: {_reason(error)}") from None


def _locked(out: Path) -> tuple[int, list[Path]]:
    """A descriptor that locks a folder, and the folders created for it, innermost first."""
    while True:
        created = [folder for folder in (out, *out.parents) if not folder.exists()]
        out.mkdir(parents=True, exist_ok=True)
        handle = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise
        except OSError:  # no locks on this file system
            pass
        if out.exists() and os.path.samestat(os.fstat(handle), out.stat()):
            return handle, created
        os.close(handle)  # another run, which wrote nothing, has just removed the folder


def leave_folder(out: Path) -> None:
    """Unlock a folder. Remove it if this process created it and it is still empty."""
    try:
        handle, created = _taken.pop(Path(out).resolve())
    except (KeyError, OSError, ValueError):
        return
    for folder in created:
        try:
            folder.rmdir()
        except OSError:  # the folder is not empty
            break
    os.close(handle)


def leave_folders() -> None:
    """Unlock all folders of this process, as `leave_folder` does."""
    for out in list(_taken):
        leave_folder(out)


SAME_ANSWER = ("verb", "version", "command", "folder")  # entries that may differ between equal requests


def guard(file: Path, request: Mapping[str, Any], force: bool) -> None:
    """Refuse to overwrite the answer to another request, unless forced.

    A file that says "infeasible" is no answer to keep.

    Args:
        file: the answer's file in the folder of results. request: the document of the new request. force: overwrite.

    Raises:
        BadInput: the file holds the answer to another request (the message says what differs), another verb's results
            are in the folder, a file that the request names or that no result lists would be replaced, the folder
            cannot be written, or another run writes there.
    """
    take_folder(file.parent)
    no_folder_in_the_way(file.parent, file.name)
    if force:
        return
    no_other_verb(file.parent, file.name)
    replaced = {str(path.resolve()) for path in files_of_earlier_runs(file.parent, file.name)}
    for value in plain(request).values():
        for word in value if isinstance(value, list) else [value]:
            if isinstance(word, str) and os.path.realpath(word) in replaced:
                raise BadInput(f"{word}: would be replaced by a result; choose another --out, or add --force")
    no_foreign_files(file.parent, file.name)
    if not file.is_file():
        return
    try:
        document = read_json(file)
    except BadInput:
        return
    held = document.get("request")
    if not isinstance(held, dict) or document.get("status") == "infeasible":
        return
    # an empty entry means the same as none; 0 and False do not
    old, new = ({k: v for k, v in each.items() if v not in (None, "", [], {})} for each in (held, plain(request)))
    differ = sorted(key for key in {*old, *new} - {*SAME_ANSWER} if old.get(key) != new.get(key))
    if differ:
        raise BadInput(
            f"{file.parent} holds the result of another request ({', '.join(differ)}); "
            "choose another --out, or overwrite it with --force"
        )


@contextmanager
def written_whole(out: Path, last: str, old: Sequence[str] = ()) -> Iterator[Path]:
    """Yield a temporary folder; its files are moved to `out` together when the block ends without an error.

    The file `last` marks a complete result. An old `last` is removed first, with all files of earlier runs and those
    named in `old`. The new `last` is written at the end. So after a full disk or a kill, no part of a new result is
    beside an old `last`. A JSON `last` lists the other files: `files: [{name, sha256}]`.

    Raises:
        BadInput: another run writes there, or writing failed, for example because the disk is full. Then `out` is
            unchanged, or has no `last`.
    """
    out = Path(out)
    aside, known = None, out.resolve() in _taken
    take_folder(out)
    try:
        _sweep(out)
        aside = Path(tempfile.mkdtemp(prefix=f"{ASIDE}{os.getpid()}-", dir=out))
        yield aside
        names = sorted((p.relative_to(aside) for p in aside.rglob("*") if p.is_file()), key=lambda p: str(p) == last)
        _list_files(aside, last, names)
        for name in names:
            if (out / name).is_dir():
                raise BadInput(f"{out / name}: a folder where a file is to be written; nothing in {out} was changed")
        left = (files_of_earlier_runs(out, last) | {out / name for name in old}) - {out / name for name in names}
        with _undisturbed():
            (out / last).unlink(missing_ok=True)
            for path in sorted(left, key=lambda path: path.name not in ANSWERS):
                path.unlink(missing_ok=True)
            for name in names:
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(aside / name, out / name)
    except OSError as error:
        raise BadInput(f"{out}: cannot be written: {_reason(error)}; nothing in it was changed") from None
    finally:
        if aside is not None:
            shutil.rmtree(aside, ignore_errors=True)
        if not known:
            leave_folder(out)


def _list_files(aside: Path, last: str, names: Sequence[Path]) -> None:
    """Put the names and digests of the other files into the document that comes last."""
    if not last.endswith(".json") or not (aside / last).is_file():
        return
    records = [{"name": str(name), "sha256": digest_of(aside / name)} for name in names if str(name) != last]
    write_json(aside / last, {**read_json(aside / last), "files": records})


def _sweep(out: Path) -> None:
    """Remove temporary folders of killed runs."""
    for folder in out.glob(f"{ASIDE}*"):
        process = folder.name.removeprefix(ASIDE).partition("-")[0]
        try:
            os.kill(int(process), 0)
        except ProcessLookupError:
            shutil.rmtree(folder, ignore_errors=True)
        # another user's process is alive, or the folder has a foreign name
        except (OSError, ValueError, OverflowError):
            pass


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Delay Ctrl-C until the block has ended; in other threads than the main one it never arrives."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pressed: list[int] = []
    before = signal.signal(signal.SIGINT, lambda *_: pressed.append(1))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if pressed and before is not signal.SIG_IGN:
            signal.raise_signal(signal.SIGINT)


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
