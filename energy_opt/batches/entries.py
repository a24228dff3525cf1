"""The entries of a suite's table, each checked; faults are collected, so that one reading names them all."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from energy_opt.batches.faults import Faults, Files, is_number
from energy_opt.batches.surroundings import KEYS, Surroundings, read_surroundings
from energy_opt.batches.task import MODES, OBJECTIVES, Duration, RobotSource
from energy_opt.errors import BadInput
from energy_opt.files import read_text
from energy_opt.power import PowerModel, load_model
from energy_opt.power.known import NAMED, is_named
from energy_opt.robot import Robot, known_robots

MEAN = "mean"  # the mean of source-method-2 and careful, which every verb plans under where no model is given
LISTS = {
    "robots": [],
    "modes": ["reshape"],
    "durations": ["1.5x"],
    "payloads": [],
    "models": [MEAN],
    "objectives": ["energy"],
}
NAMES = (*LISTS, "moves", "random", "limits", "lock", "settings", *KEYS)
OF_POSES = ("start_pose", "goal_pose", "via_pose", "free", "pose_tolerance")
_MOVE = ("name", "start", "goal", "via", "path", "durations", *OF_POSES)


@dataclass(frozen=True)
class Group:
    """A checked table: whose product is a list of moves.

    moves are (name, table, own durations), random ones (count, seed, range).
    """

    robots: list[tuple[RobotSource, Robot]]
    moves: list[tuple[str, Mapping[str, Any], list[Duration]]]
    random: list[tuple[int, int, float]]
    modes: list[Literal["retime", "reshape"]]
    timings: list[Duration]
    payloads: list[tuple[float, ...]]
    models: list[tuple[str, PowerModel | None]]
    objectives: list[str]
    settings: tuple[tuple[str, Any], ...]
    surroundings: Surroundings


def read_group(table: Mapping[str, Any], files: Files, faults: Faults) -> Group:
    """Check a table; what is faulty is named in `faults` and left out."""
    values = {key: _as_list(table.get(key, default)) for key, default in LISTS.items()}
    if "robots" not in table:
        faults.add("robots", "missing; give names or URDF files")
    for key, value in values.items():
        if key in table and not value:
            faults.add(key, "is empty")
    limits = _file(table["limits"], "limits", files, faults) if "limits" in table else None
    lock = _lock(table.get("lock", {}), faults)
    return Group(
        robots=[r for item in values["robots"] if (r := _robot(item, limits, lock, files, faults))],
        moves=_moves(table.get("moves", []), faults),
        random=_random(table.get("random", []), faults),
        modes=[mode for mode in MODES if mode in _words(values["modes"], "modes", MODES, faults)],
        timings=_timings(values["durations"], "durations", faults),
        payloads=[p for item in values["payloads"] if (p := _payload(item, faults)) is not None] or [()],
        models=[m for item in values["models"] if (m := _model(item, files, faults))],
        objectives=_words(values["objectives"], "objectives", OBJECTIVES, faults),
        settings=_settings(table.get("settings", {}), faults),
        surroundings=read_surroundings(table, files, faults),
    )


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _file(name: Any, key: str, files: Files, faults: Faults) -> Path | None:
    try:
        if not isinstance(name, str) or not files.path(name, key).is_file():
            raise BadInput(f"{name!r} is not a file beside the suite")
        return files.path(name, key)
    except BadInput as error:
        faults.add(key, str(error))
        return None


def _words(values: list[Any], key: str, known: tuple[str, ...], faults: Faults) -> list[str]:
    for value in values:
        if value not in known:
            faults.add(key, f"{value!r}; expected {', '.join(known)}")
    return [value for value in values if value in known]


def _timings(values: list[Any], key: str, faults: Faults) -> list[Duration]:
    out = []
    for value in values:
        try:
            out.append(Duration.parse(value))
        except BadInput as error:
            faults.add(key, str(error))
    return out


def _robot(
    name: Any, limits: Path | None, lock: tuple[tuple[str, float], ...], files: Files, faults: Faults
) -> tuple[RobotSource, Robot] | None:
    try:
        text = None if limits is None else read_text(limits)
        if name in known_robots():
            source = RobotSource(name, None, text, lock)
        elif isinstance(name, str) and files.path(name, "robots").is_file():
            file = files.path(name, "robots")
            source = RobotSource(file.stem, read_text(file), text, lock, str(file.resolve()))
        else:
            raise BadInput(f"{name!r} is neither a file beside the suite nor one of {', '.join(known_robots())}")
        return source, source.load()
    except BadInput as error:
        faults.add("robots", str(error))
        return None


def _lock(table: Any, faults: Faults) -> tuple[tuple[str, float], ...]:
    if not isinstance(table, Mapping) or not all(is_number(value) for value in table.values()):
        faults.add("lock", f"{table!r} is not a table of joint positions")
        return ()
    return tuple(sorted((name, float(value)) for name, value in table.items()))


def _payload(value: Any, faults: Faults) -> tuple[float, ...] | None:
    """Mass [kg] and com [m] as (4,), from a number, "MASS[,CX,CY,CZ]" or a list of the same."""
    parts = value.split(",") if isinstance(value, str) else _as_list(value)
    try:
        numbers = tuple(float(part) for part in parts if not isinstance(part, bool))
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) not in (1, 4) or not all(map(is_number, numbers)) or numbers[0] < 0:
        faults.add("payloads", f'{value!r}; expected a mass in kg, or "MASS,CX,CY,CZ" with the centre of mass in m')
        return None
    return numbers if len(numbers) == 4 else (numbers[0], 0.0, 0.0, 0.0)


def _model(name: Any, files: Files, faults: Faults) -> tuple[str, PowerModel | None] | None:
    """A model's name and, of a file, the model; those known by name are made for each robot."""
    try:
        if isinstance(name, str) and (name == MEAN or is_named(name)):
            return name, None
        if isinstance(name, str) and files.path(name, "models").is_file():
            return Path(name).name if Path(name).is_absolute() else name, load_model(files.path(name, "models"))
        raise BadInput(f"{name!r} is neither a model file beside the suite nor one of {', '.join([MEAN, *NAMED])}")
    except BadInput as error:
        faults.add("models", str(error))
        return None


def _moves(tables: Any, faults: Faults) -> list[tuple[str, Mapping[str, Any], list[Duration]]]:
    if not isinstance(tables, list) or not all(isinstance(row, Mapping) for row in tables):
        faults.add("moves", "is not a list of [[moves]] tables")
        return []
    out = []
    for number, row in enumerate(tables, start=1):
        name = row.get("name", f"move{number:02d}")
        where = f"moves {number}"
        before = len(faults.lines)
        if not isinstance(name, str) or not name:
            faults.add(f"{where}.name", f"{name!r} is not a name")
        for key in row:
            if key not in _MOVE:
                faults.add(f"{where}.{key}", f"unknown key; a move has {', '.join(_MOVE)}")
        for key in ("start", "goal"):
            if (key in row or f"{key}_pose" in row) == ("path" in row) or (key in row and f"{key}_pose" in row):
                faults.add(f"{where}.{key}", "a move has start and goal, or a path" if key in row else "missing")
        if not isinstance(row.get("via", []), list):
            faults.add(f"{where}.via", "is not a list of points")
        timings = _timings(_as_list(row["durations"]), f"{where}.durations", faults) if "durations" in row else []
        if len(faults.lines) == before:
            out.append((str(name), row, timings))
    return out


def _random(value: Any, faults: Faults) -> list[tuple[int, int, float]]:
    out = []
    for number, row in enumerate(_as_list(value), start=1):
        where = "random" if isinstance(value, Mapping) else f"random {number}"
        if not isinstance(row, Mapping):
            faults.add(where, f"{row!r}; expected {{ count, seed, range }}")
            continue
        for key in row:
            if key not in ("count", "seed", "range"):
                faults.add(f"{where}.{key}", "unknown key; random has count, seed and range")
        count, seed, share = row.get("count"), row.get("seed", 0), row.get("range", 0.6)
        if not isinstance(count, int) or isinstance(count, bool) or count < 1:
            faults.add(f"{where}.count", f"{count!r}; expected a whole number above 0")
        elif not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
            faults.add(f"{where}.seed", f"{seed!r}; expected a whole number, 0 or above")
        elif not is_number(share) or not 0 < share <= 1:
            faults.add(f"{where}.range", f"{share!r}; expected a share of the joints' ranges above 0, at most 1")
        else:
            out.append((count, seed, float(share)))
    return out


def _settings(table: Any, faults: Faults) -> tuple[tuple[str, Any], ...]:
    from energy_opt.motion import Settings

    known = [f.name for f in dataclasses.fields(Settings) if f.name not in ("objective", "compile")]
    if not isinstance(table, Mapping):
        faults.add("settings", f"{table!r} is not a table")
        return ()
    for key in table:
        if key not in known:
            faults.add(f"settings.{key}", f"unknown setting; known: {', '.join(known)}")
    try:
        Settings(**{key: value for key, value in table.items() if key in known})
    except (BadInput, TypeError, ValueError) as error:
        faults.add("settings", str(error))
    plain = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    return tuple(sorted((key, value) for key, value in plain.items() if key in known))
