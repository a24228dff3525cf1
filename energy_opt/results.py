"""What every verb returns, and which files of a folder are whose."""

from __future__ import annotations

import hashlib
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, Self

from energy_opt.errors import BadInput
from energy_opt.files import read_json, to_json

# Files that show that a folder holds a verb's results; reports, plots and tables of several verbs have the same names.
ANSWERS = {"result.json": "optimize", "tradeoff.json": "tradeoff", "job.json": "job", "results.jsonl": "bench",
           "identify.json": "identify", "diagnosis.json": "diagnose",
           "evaluate.json": "evaluate", "place.json": "place", "passport.json": "passport"}  # fmt: skip
# suffixes of every written format
SUFFIXES = (".csv", ".yaml", ".json", ".mcap", ".goal.yaml", ".script", ".franka.csv")
# All files that each verb may write besides its answer: those of an earlier run are removed when a new one is written.
BESIDE = {
    "result.json": (*(f"trajectory{s}" for s in SUFFIXES), "trajectory_*hz.csv", "moves.yaml", "moves.script",
                    "plot.png", "report.html"),
    "tradeoff.json": ("tradeoff.csv", "trajectory_minimum.csv", "trajectory_cycle_minimum.csv", "plot.png",
                      "report.html"),
    "job.json": ("step_[0-9]*.csv", "cycle.csv", "cycle_*.csv", *(f"trajectory{s}" for s in SUFFIXES),
                 "trajectory_*hz.csv", "report.html"),
    "results.jsonl": ("results.parquet", "summary.json", "report.html"),
    "identify.json": ("model_method1.toml", "model_method2.toml", "plot.png", "report.html"),
    "evaluate.json": tuple(f"trajectory*{s}" for s in SUFFIXES),
    "diagnosis.json": ("model.toml", "next_motion.csv", "report.html"),
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


def earlier(out: Path, own: str) -> set[Path]:
    """Files in `out` that earlier runs of the verb that writes `own`, or of others with an answer there, have left.

    These are all that such a verb may write, and what an answer lists with its digest while that is still so.
    """
    out, found = Path(out), set()
    for answer in {own, *(name for name in ANSWERS if (out / name).is_file())}:
        found |= {path for name in (answer, *BESIDE.get(answer, ())) for path in out.glob(name) if not path.is_dir()}
        found |= {
            out / name for name, digest in (listed(out / answer) or {}).items() if digest == digest_of(out / name)
        }
    return found


def listed(answer: Path) -> dict[str, str] | None:
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
    records = [record for record in records if isinstance(record, dict)]
    own = {str(row.get("name")): str(row.get("sha256")) for row in records}
    return {name: digest for name, digest in own.items() if Path(name).name == name}


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
        files = listed(answer)
        if answer.suffix == ".json" and files is None:
            faults.append(f"{answer}: lists no files with digests, so the other files cannot be checked")
        for name, digest in (files or {}).items():
            found = digest_of(answer.parent / name)
            if found != digest:
                what = "is missing" if found is None else "is not the file that was written"
                faults.append(f"{answer.parent / name}: {what} with {answer.name} (by its SHA-256)")
        foreign = earlier(out, answer.name) - {answer.parent / name for name in (*(files or ()), *ANSWERS)}
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


def exit_of(interrupted: bool, good: bool) -> int:
    """The command line's exit code of an answer: 130 where it was interrupted, 0 where it is good, else 4."""
    return 130 if interrupted else 0 if good else 4


class Found:
    """What a verb found.

    Each result class has a `document`. It overrides `kept`, which writes its files, where it has any, and `text`
    where a terminal shows a table of it.
    """

    document: Any  # the content of its JSON file, or a method that returns it

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        return 0

    def to_json(self) -> str:
        """The document as JSON text."""
        return to_json(self.document() if callable(self.document) else self.document)

    def text(self, out: Path) -> str:
        """What the command prints of a result that is saved in `out`; empty where its messages said all."""
        return ""

    def save(self, out: str | PathLike[str]) -> Path:
        """Write its files into the folder `out`, whole or not at all; returns the folder."""
        self.kept(Path(out))
        return Path(out)

    def kept(self, out: Path) -> Self:
        """Write its files into the folder `out`; returns the same with what is known of them."""
        return self

    def _repr_html_(self) -> str:
        lines = self.text(Path(".")).splitlines() or str(self).splitlines()
        return f"<pre>{escape(chr(10).join(line for line in lines if line != 'files in .'))}</pre>"
