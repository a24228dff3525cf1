"""Files of a planned trajectory for controllers: formats, rates, and plans with a margin for the written samples.

Every file is read back and judged.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from energy_opt.errors import BadInput, Infeasible, suggest
from energy_opt.formats import FORMATS, Format, franka, urscript
from energy_opt.formats.controller_program import Load, Part
from energy_opt.formats.judging import CycleJudging, Judging
from energy_opt.formats.resample import Sampled, compared, fitted, lowest, on_steps, resampled, slowed_until
from energy_opt.formats.urscript import read_program
from energy_opt.motion.judge.certificate import ALLOWED, Certificate
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Robot

STEPS = {"franka": franka.RATE, "urscript": urscript.STREAM_RATE}  # [Hz] of controllers that receive positions alone


@dataclass(frozen=True)
class Written:
    """A file that was read back and judged.

    Attributes:
        rate: samples per second, None for samples of their own.
        valid: True if its motion keeps all limits and touches nothing; worst: the limit that it uses most. text: line
            for the console on its content and sampling.
        assumed: kinds of limits without a source: it is valid under them only.
        about: further entries of its record, such as its robot. content: its bytes, if `files_from` gave it.
    """

    file: str
    format: str
    rate: float | None
    valid: bool
    worst: dict[str, object]
    text: str = ""
    assumed: tuple[str, ...] = ()
    about: Mapping[str, object] = field(default_factory=dict)
    content: bytes = field(default=b"", repr=False)

    def put(self, folder: Path) -> None:
        """Write the file into a folder."""
        (folder / self.file).write_bytes(self.content)

    def document(self) -> dict[str, object]:
        """As it is in result.json."""
        own = {name: getattr(self, name) for name in ("file", "format", "rate", "valid", "worst")}
        return {**self.about, **own, "assumed": list(self.assumed)}

    @property
    def broken(self) -> str:
        """Text on the limit that it breaks most."""
        w = self.worst
        if w["limit"] == "clearance":
            return str(w["joint"])
        value, bound = compared(w)
        return f"{w['limit']} of {w['joint']} is {value} at {w['time']:.4g} s, its bound is {bound}"

    def __str__(self) -> str:
        if not self.valid:
            return f"{self.text}; THIS FILE BREAKS A LIMIT: {self.broken}"
        under = f"; valid under assumed limits ({', '.join(self.assumed)}): give --limits" if self.assumed else ""
        return f"{self.text}{under}"


def files_from(write: Callable[[Path], Sequence[Written]]) -> tuple[Written, ...]:
    """The files that `write` puts into a folder, with their content: `put` writes them where they are wanted."""
    with tempfile.TemporaryDirectory(prefix="energy-opt-") as name:
        folder = Path(name)
        try:
            return tuple(replace(row, content=(folder / row.file).read_bytes()) for row in write(folder))
        except BadInput as error:  # the folder will be gone
            raise BadInput(str(error).replace(f"{folder}/", "")) from None


def wanted(names: Sequence[str], joints: int | None = None) -> list[Format]:
    """The formats of these names, each once.

    Args:
        joints: of the arm, where it is known.

    Raises:
        BadInput: one is not known, or not for such an arm.
    """
    for name in names:
        if name not in FORMATS:
            raise BadInput(f"--write {name!r}; known are {', '.join(FORMATS)}{suggest(name, FORMATS)}")
    if joints is not None:
        for name, module in (("franka", franka), ("urscript", urscript)):
            if name in names:
                module.check_arm(joints)
    return [FORMATS[name] for name in dict.fromkeys(names)]


def file_of(form: Format, rate: float | None, stem: str = "trajectory") -> str:
    """The file's name; that of a table at a rate [Hz] contains the rate, to differ from the judged one."""
    at = f"_{rate:g}hz" if form.name == "csv" and rate is not None else ""
    return f"{stem}{at}{form.suffix}"


def sample(trajectory: Trajectory, judge: Judging, form: Format, rate: float | None) -> tuple[Trajectory, float | None]:
    """The samples of a trajectory for a format, and their rate [Hz]: `rate`, or the controller's own.

    A rate of None means the judged samples, or for `urscript` a rate that is chosen to keep all limits.
    """
    if form.name == "franka" or (form.name == "urscript" and rate == urscript.STREAM_RATE):
        pace = STEPS[form.name]
        return on_steps(trajectory, pace, judge.scorer.robot.limits), pace
    return (trajectory, None) if rate is None else (resampled(trajectory, rate), rate)


def sampled(trajectory: Trajectory, judge: Judging, form: Format, rate: float | None) -> Sampled:
    """The trajectory as a format gets it: at the rate, or one that its controller asks for, within all limits."""
    got, pace = sample(trajectory, judge, form, rate)
    if pace is not None and pace == STEPS.get(form.name):
        slower = slowed_until(
            trajectory, lambda t: judge.at_steps(t, pace), lambda slow: sample(slow, judge, form, rate)[0]
        )
        return Sampled(got if slower is None else slower, pace, not_used(rate, pace))
    if rate is not None:
        return fitted(trajectory, rate, judge)
    if form.name == "urscript":
        found = lowest(trajectory, judge)
        if found == urscript.STREAM_RATE:  # at this rate the program sends positions, without quintics between them
            return sampled(trajectory, judge, form, found)
        if found is not None:
            return Sampled(resampled(trajectory, found), found)
    return Sampled(trajectory, None)


def not_used(rate: float | None, pace: float) -> str:
    """Why a file has the controller's own rate `pace` [Hz], if another one was requested."""
    return "" if rate in (None, pace) else f"the controller always runs at {pace:g} Hz: --rate {rate:g} is not used"


def write(
    trajectory: Trajectory,
    judge: Judging,
    formats: Sequence[Format],
    out: Path,
    rate: float | None = None,
    prefix: str = "",
    payload: Load | None = None,
) -> list[Written]:
    """Write a judged trajectory in several formats into a folder; each file is read back and judged.

    Args:
        rate: samples per second, None for the judged samples themselves. The 1 kHz of `franka` is its own; `urscript`
            takes the lowest of the usual rates that holds all limits where none is given.
        prefix: of the joints' names in the files.
        payload: what a program sets: mass [kg] and its centre [m] in the tool's frame; None: nothing.
    """
    files = []
    for form in formats:
        got = sampled(trajectory, judge, form, rate)
        stem = "trajectory"
        if form.name == "csv" and got.rate is None:  # trajectory.csv exists already, with the robot's own names
            if not prefix:
                continue
            stem += "_prefixed"
        path, chosen = out / file_of(form, got.rate, stem), got.trajectory
        if chosen is not trajectory and form.name not in STEPS:
            chosen = judge.scorer.filled(chosen)
        named = replace(chosen, joints=tuple(prefix + joint for joint in chosen.joints))
        if form.name == "urscript":
            urscript.write_program([Part(named, payload=payload)], path)
        else:
            form.write(named, path)
        files.append(read_back(path, form, got, judge, prefix, trajectory))
    return files


def read_back(path: Path, form: Format, got: Sampled, judge: Judging, prefix: str, trajectory: Trajectory) -> Written:
    """Read a file and judge its content.

    Args:
        path: the file. form: its format. got: the samples that were written. judge: of the motion.
        prefix: of the joints' names in the file. trajectory: the motion that the samples are of.
    """
    samples = form.read(path).of(judge.scorer.robot.joints, prefix)
    if samples.steps is not None:
        certificate = judge.at_steps(samples.trajectory(), samples.steps)
    elif isinstance(judge, CycleJudging) and form.name == "urscript":
        certificate = judge.of_parts(read_program(path))
    else:
        certificate = judge(samples.trajectory())
    how = "quintic between points" if samples.steps is None else "positions from step to step"
    text = _text(form, got, judge, trajectory, how)
    worst, assumed = worst_of(certificate), assumed_kinds(judge.scorer.robot)
    return Written(path.name, form.name, got.rate, certificate.valid, worst, text, assumed)


def assumed_kinds(robot: Robot) -> tuple[str, ...]:
    """Kinds of limits that no file states for some joint of the robot."""
    return tuple(kind for kind in ("velocity", "acceleration", "jerk") if "assumed" in robot.sources[kind])


def warnings_on(files: Sequence[Written], rate: float | None) -> list[str]:
    """Warnings on files that break a limit, or that have another rate than the requested one [Hz; None: none]."""
    return [f"{row.file}: {row}" for row in files if not row.valid or rate not in (None, row.rate)]


def unchanged(path: Path, form: Format, judged: Trajectory, certificate: Certificate, robot: Robot) -> Written:
    """A file of judged samples: valid if it holds them to the last bit.

    Args:
        path: the file. form: its format. judged: the samples. certificate: theirs. robot: the arm.
    """
    again = form.read(path).of(judged.joints).trajectory()
    same = all(
        np.array_equal(getattr(again, name), getattr(judged, name))
        for name in ("time", "position", "velocity", "acceleration")
    )
    worst, assumed = worst_of(certificate), assumed_kinds(robot)
    return Written(path.name, form.name, None, same and certificate.valid, worst, form.text, assumed)


def worst_of(certificate: Certificate) -> dict[str, object]:
    """The limit that is used most, or the clearance that is not proven."""
    if certificate.within_limits and not certificate.valid:
        return {"limit": "clearance", "joint": str(certificate.clearance), "time": None, "value": None, "bound": None}
    return certificate.worst


def _text(form: Format, got: Sampled, judge: Judging, trajectory: Trajectory, how: str) -> str:
    """One line on a written file: format, rate and how it is followed, slowing, and why."""
    text = f"{form.text}, " + ("as judged" if got.rate is None else f"{got.rate:g} Hz, {how}")
    if form.name == "urscript" and urscript.named_otherwise(trajectory.joints):
        text += "; the joints are not named as a UR's: check that this arm is one"
    longer = got.trajectory.duration / trajectory.duration - 1
    if longer > 1e-6:
        joules = judge.joules(got.trajectory) - judge.joules(trajectory)
        text += f"; slowed by {100 * longer:.2g} % to {got.trajectory.duration:.6g} s, {joules:+.3g} J"
    return text + (f"; {got.why}" if got.why else "")


ROUNDS = 6  # most plans with tightened bounds
STEP = 1.2  # factor on the excess by which a bound is tightened: peaks move with the plan
SHOWN = 0.9995  # shares of a bound above this are not mentioned
NEAR = 1e-2  # largest excess over a bound in samples of a plan that is then slowed
LEAST = 0.5  # least share of a bound: if samples need less, the rate is too low for the motion

Shares = dict[str, float]  # shares of the limits' bounds, by the limits' names
Answer = TypeVar("Answer")


def certificates(
    trajectory: Trajectory, judge: Judging, formats: Sequence[Format], rate: float | None
) -> list[Certificate]:
    """Certificates of the samples for every format, before slowing; none if all files have the judged samples.

    Args:
        trajectory: the motion. judge: of the motion. formats: that are asked for.
        rate: [Hz] of the samples; None: those of the plan, or the controller's own.
    """
    known: dict[tuple[float, bool], Certificate] = {}
    for form in formats:
        got, pace = sample(trajectory, judge, form, rate)
        stepped = pace == STEPS.get(form.name)
        if pace is not None and (pace, stepped) not in known:
            known[pace, stepped] = judge.at_steps(got, pace) if stepped else judge(got)
    return list(known.values())


def with_room(
    answer: Answer,
    certificates: Callable[[Answer], list[Certificate]],
    again: Callable[[Shares], Answer],
    rounds: int = ROUNDS,
) -> tuple[Answer, Shares]:
    """The answer, or one that is planned again so that the samples of its motion keep all limits.

    Between samples, a controller's quintics may exceed a bound that the plan uses fully. So the bound is tightened by
    STEP times the excess, and the motion is planned again, `rounds` times at most.

    Args:
        answer: the plan.
        certificates: of the samples of an answer.
        again: plans with these shares of the limits' bounds; raises Infeasible if that is not possible.

    Returns:
        The answer whose samples break limits least, and its shares; the given answer and no shares if none is good
            enough.
    """
    shares: Shares = {}
    found = certificates(answer)
    given, best, least = answer, (answer, dict(shares)), _broken(found)
    for _ in range(rounds):
        if not ALLOWED < least < float("inf") or not all(certificate.clear for certificate in found):
            break
        over = [(place.excess or 0.0, place.limit) for certificate in found for place in certificate.found]
        over = [(excess, limit) for excess, limit in sorted(over) if excess > 0.1 * ALLOWED]
        # of several certificates, the largest excess of a limit comes last, and counts alone
        shares |= {limit: shares.get(limit, 1.0) / (1 + STEP * excess + 2 * ALLOWED) for excess, limit in over}
        if min(shares.values(), default=1.0) < LEAST:
            break
        try:
            answer = again(dict(shares))
        except Infeasible:
            break
        found = certificates(answer)
        if _broken(found) < least:
            best, least = (answer, dict(shares)), _broken(found)
    return best if least < NEAR else (given, {})


def said(shares: Mapping[str, float], joules: float) -> str:
    """Sentence on the margin in the limits and its cost in energy; empty if there is none."""
    if not shares:
        return ""
    less = {name: share for name, share in shares.items() if share < SHOWN} or shares
    used = ", ".join(f"{name.replace('_', ' ')} at most {100 * share:.4g} %" for name, share in less.items())
    return f"planned with a margin for the written samples ({used} of its bound): {joules:+.3g} J"


def _broken(certificates: Sequence[Certificate]) -> float:
    """The largest violation of all certificates."""
    return max((certificate.violation for certificate in certificates), default=0.0)
