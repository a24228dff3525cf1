"""The tables of a suite file: the allowed values of each key, converted to SI units."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, StrictBool, StrictStr, field_validator, model_validator

from energy_opt.batches.task import MODES, OBJECTIVES, Duration
from energy_opt.errors import BadInput
from energy_opt.files import is_number
from energy_opt.schema import Name, Number, Table, reads

MEAN = "mean"  # the mean of source-method-2 and careful, the default of every verb
OF_POSES = ("start_pose", "goal_pose", "via_pose", "free", "pose_tolerance")
Payload = tuple[float, ...]  # mass [kg] and centre of mass (3) [m]; empty for the model's own


def _payload(value: Any) -> Payload:
    """(4,) from a number, "MASS[,CX,CY,CZ]" or a list of the same."""
    parts = value.split(",") if isinstance(value, str) else _listed(value)
    try:
        numbers = tuple(float(part) for part in parts if not isinstance(part, bool))
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) not in (1, 4) or not all(map(is_number, numbers)) or numbers[0] < 0:
        raise BadInput('expected a mass in kg, or "MASS,CX,CY,CZ" with the centre of mass in m')
    return numbers if len(numbers) == 4 else (numbers[0], 0.0, 0.0, 0.0)


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


Listed = BeforeValidator(_listed)  # one value counts as a list of one
Filled = Field(min_length=1)
Timings = Annotated[list[Annotated[Duration, reads(Duration.parse)]], Listed]


class MoveTable(Table):
    """One [[moves]] table; ends may be joint positions, poses of the tool, or those of a path's file."""

    name: Name | None = None
    start: Any = None
    goal: Any = None
    via: list[Any] = []
    path: StrictStr | None = None
    durations: Timings = []
    start_pose: Any = None
    goal_pose: Any = None
    via_pose: list[Any] = []
    free: Any = ()
    pose_tolerance: Any = None

    @model_validator(mode="after")
    def _ends(self) -> Self:
        """A move has a start and a goal (each as joint positions or as a pose), or a path."""
        for key in ("start", "goal"):
            given = [x for x in (key, f"{key}_pose", "path") if getattr(self, x) is not None]
            if not given:
                raise ValueError(f"{key} is missing")
            if len(given) > 1:
                raise ValueError(f"{' and '.join(given)} are given; a move has start and goal, or a path")
        return self

    @property
    def posed(self) -> bool:
        """True if an end or a via point is a pose of the tool."""
        return bool(self.model_fields_set.intersection(OF_POSES))


class RandomTable(Table):
    """Random moves: their number, seed, and share of the joints' ranges."""

    count: Annotated[int, Field(strict=True, gt=0)]
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    range: Annotated[Number, Field(gt=0, le=1)] = 0.6


class CellTable(Table):
    """The cell of the moves, as in `CellRequest`; files are named relative to the suite."""

    self_collision: StrictBool | None = None
    planner: StrictStr | None = None
    tool: StrictStr | None = None
    floor: Number | None = None
    clearance: Number | None = None
    base: list[Number] | None = None
    payload_size: list[Number] | None = None
    package_dirs: list[StrictStr] | None = None
    scene: StrictStr | None = None
    srdf: StrictStr | None = None


class GroupTable(CellTable):
    """A product of lists: the top level of a suite, or one of its [[groups]] on top of that."""

    robots: Annotated[list[StrictStr], Listed, Filled]
    modes: Annotated[list[Literal["retime", "reshape"]], Listed, Filled] = ["reshape"]
    durations: Annotated[Timings, Filled] = [Duration(multiple=1.5)]
    payloads: Annotated[list[Annotated[Payload, reads(_payload)]], Listed, Filled] = [()]
    models: Annotated[list[StrictStr], Listed, Filled] = [MEAN]
    objectives: Annotated[list[Literal[OBJECTIVES]], Listed, Filled] = ["energy"]  # type: ignore[valid-type]
    moves: list[MoveTable] = []
    random: Annotated[list[RandomTable], Listed] = []
    limits: StrictStr | None = None
    lock: dict[str, Number] = {}
    settings: dict[str, Any] = {}

    @field_validator("modes")
    @classmethod
    def _in_order(cls, modes: list[str]) -> list[str]:
        return [mode for mode in MODES if mode in modes]

    @field_validator("settings")
    @classmethod
    def _of_the_solver(cls, given: dict[str, Any]) -> dict[str, Any]:
        """Settings that the solver knows, with lists as tuples."""
        from energy_opt.motion import Settings

        known = [f.name for f in dataclasses.fields(Settings) if f.name not in ("objective", "compile")]
        for key in given:
            if key not in known:
                raise ValueError(f"{key}: unknown setting; known: {', '.join(known)}")
        try:
            Settings(**given)
        except (BadInput, TypeError) as error:
            raise ValueError(str(error)) from None
        return {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
