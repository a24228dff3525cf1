"""Every reader against damaged files: exit 0, 2, 3 or 4, one line a fault, in bounded time; whatever hypothesis makes.

`damaged/` keeps files that once broke a reader, as text; `nightly` runs twenty times as many made-up ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from machine import allowed

from energy_opt.cli import faults
from energy_opt.cli.main import EXAMPLES, example, main

KEPT = sorted((Path(__file__).parents[1] / "damaged").iterdir())
SUFFIXES = {"model": "toml", "log": "toml", "suite": "toml", "job": "toml", "limits": "yaml", "scene": "yaml"}
TABLE = "time," + ",".join(f"joint{k}.position" for k in range(1, 7)) + "\n0,0,1,-1,0,0,0\n0.5,0.1,1,-1,0,0,0\n"
MESSAGE = (
    '{"joint_names": ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"], "points": [{"positions": '
    '[0, 1, -1, 0, 0, 0], "time_from_start": {"sec": 0, "nanosec": 0}}, {"positions": [0.1, 1, -1, 0, 0, 0], '
    '"time_from_start": {"sec": 2, "nanosec": 5}}]}'
)
SCENE_TEXT = "cell\n* box\n1\nbox\n0.1 0.2 0.3\n1 1 1\n0 0 0 1\n0 0 0 0\n.\n"
URDF = (
    '<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
    'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
    '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint></robot>'
)
TEXTS = {f"{kind}.{SUFFIXES[kind]}": example(kind) for kind in EXAMPLES} | {
    "table.csv": TABLE, "message.json": MESSAGE, "text.scene": SCENE_TEXT, "robot.urdf": URDF,
}  # fmt: skip
NOISE = st.sampled_from(
    ["", "\0", "nan", "inf", "-1", "1e300", "1e-300", "true", '"x"', "[]", "{}", "[[[[", "]", "\n", ",", "=", ":", "'",
     "../../x", "9" * 400, "\\", "<", "$\\frac$", "&a", "*a", "!!python/object", "\ufeff", "é", "\t", "0", "- ", "#",
     "<!ENTITY x 'y'>", "&x;", "18446744073709551616", "2020-01-01", "null", "~", "1:30", "time", "a" * 300]
)  # fmt: skip


@pytest.fixture(autouse=True)
def _nothing_unforeseen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("energy_opt.cli.main.as_error", _strict(faults.as_error))


def _strict(foreseen: Callable[[Exception], Exception]) -> Callable[[Exception], Exception]:
    """The last net, torn: what only it catches is a fault of the program."""

    def as_error(error: Exception) -> Exception:
        found = foreseen(error)
        if isinstance(found, faults.Unforeseen):
            raise AssertionError("unforeseen") from error
        return found

    return as_error


def checked(file: Path, capsys: pytest.CaptureFixture[str], *words: str) -> int:
    """`check` of a file: its exit code; it says something where it is not 0, and takes its time within bounds."""
    begin = time.process_time()
    code = main(["check", str(file), "--self-collision", "off", "--quiet", *words])
    said = capsys.readouterr()
    assert code in (0, 2) and "Traceback" not in said.err
    assert bool(said.err.strip()) == (code == 2), said.err
    assert all(line.startswith("energy-opt: ") for line in said.err.splitlines()) and not said.out
    assert time.process_time() - begin < allowed(5)
    return code


@pytest.mark.parametrize("file", KEPT, ids=lambda file: file.name)
def test_kept_damaged_files_are_refused(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--robot", "z1"] if file.suffix in (".csv", ".json") else []
    assert checked(file, capsys, *words) == 2


def test_damage_that_is_too_large_to_keep_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head = 'format = "energy-opt/model/1"\nrobot = "panda"\n'
    large = {
        "key.toml": ".".join(["a"] * 100_000) + " = 1",
        "deep.toml": "a = " + "[" * 3000 + "]" * 3000,
        "digits.toml": head + "x = " + "9" * 4400,
        "power.toml": head + '[[effect]]\nname = "standby"\npower = 1' + "0" * 400,
        "deep.yaml": "\n".join(" " * k + "a:" for k in range(3000)),
        "brackets.yaml": "[" * 3000 + "]" * 3000,
        "bomb.yaml": "a: &a [x,x,x,x,x,x,x,x,x]\n"
        + "".join(f"{b}: &{b} [{','.join(['*' + a] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)),
        "deep.json": "[" * 3000 + "]" * 3000,
        "digits.json": '{"joint_names": ["joint1"], "points": [{"positions": [' + "9" * 4400 + "]}]}",
        "field.csv": "time,joint1.position\n" + "9" * 200_000 + ",0\n",
    }
    for name, text in large.items():
        (tmp_path / name).write_text(text)
        assert checked(tmp_path / name, capsys, "--robot", "z1") == 2, name


def _cases(count: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return settings(
        max_examples=count, deadline=None, database=None, derandomize=True,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn) -> tuple[str, str]:
    """A file that works, with up to four places cut out, doubled, or replaced by noise; or noise alone."""
    name = draw(st.sampled_from(sorted(TEXTS)))
    text = TEXTS[name] if draw(st.integers(0, 19)) else draw(st.text(max_size=60))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.sampled_from([0, 1, 1, 2, 5, 10, 40])))
        piece = draw(st.one_of(NOISE, st.just(text[start:end] * 2), st.text(max_size=8)))
        text = text[:start] + piece + text[end:]
    return name, text


def _one(case: tuple[str, str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, text = case
    file = folder / ("log.toml" if name.startswith("log") else name)
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    checked(file, capsys, *(["--robot", "z1"] if name.endswith((".csv", ".json")) else []))


@_cases(150)
@given(case=damaged())
def test_readers_hold(case: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _one(case, tmp_path, capsys)


@pytest.mark.nightly
@_cases(10_000)
@given(case=damaged())
def test_readers_hold_all_night(case: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _one(case, tmp_path, capsys)
