"""Folders of results: taken before the work begins, and written so that new and old never stand side by side."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.files import read_json, write_json
from energy_opt.results import ANSWERS, digest_of, earlier

ASIDE = ".writing-"  # prefix of temporary folders, before the number of the process that writes there


_taken: dict[Path, tuple[int, list[Path]]] = {}  # by folder: the descriptor of its lock, and the folders created for it


def take_folder(out: Path) -> None:
    """Make sure, before the work begins, that results can be written into `out`, by this process alone.

    Other processes are kept out by a lock on the folder itself, which ends with the process however that ends, or with
    `leave_folders`. On file systems without such locks the last of two runs wins, whole.

    Raises:
        BadInput: another run is writing there; or it is a file, not permitted, has an impossible name, or the disk is
            full.
    """
    out = Path(out)
    try:
        key = out.resolve()
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
    """Let others write into a folder that was taken; if it was made for that and is empty, it goes."""
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
    """The same for all of them."""
    for out in list(_taken):
        leave_folder(out)


@contextmanager
def written_whole(out: Path, last: str, old: Sequence[str] = ()) -> Iterator[Path]:
    """A folder aside, whose files take their places in `out` together when the block ends without an error.

    The file `last` says that a result is whole: an old one goes before anything else changes, the new one comes last.
    Whatever happens in between (a full disk, a kill), no part of a new result is beside the `last` of an old one,
    and what earlier runs have left goes with it, `old` names among them. A JSON `last` lists the other files:
    `files: [{name, sha256}]`.

    Raises:
        BadInput: another run is writing there; or writing failed, say because the disk is full: `out` is as it was, or
            without `last`.
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
        left = (earlier(out, last) | {out / name for name in old}) - {out / name for name in names}
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
