"""Files: whole or absent when written; the fault named with row and column when read."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from energy_opt.errors import BadInput
from energy_opt.files import read_json, read_toml, read_yaml, replacing, to_json, write_text
from energy_opt.tables import read_table, write_table


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), replacing(path) as aside:
        aside.write_text("half of the n")
        raise RuntimeError("power cut")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]  # nothing is left lying about


def test_files_have_the_users_permissions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process's mask, which all threads share, was cleared for a moment to read it."""
    usual = os.umask(0o027)
    with monkeypatch.context() as patched:
        patched.setattr(os, "umask", None)
        write_text(tmp_path / "a", "x")
    os.umask(usual)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640 and len(list(tmp_path.iterdir())) == 1


def test_a_name_that_the_locale_cannot_encode_is_not_called_outside() -> None:
    """A set with umlauts in a file's name, on a machine whose locale is C."""
    code = "from energy_opt.files import inside; inside('.', 'l\\u00e4uft.csv')"
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | plain)
    assert "BadInput: 'l\\xe4uft.csv': not text in this locale's encoding" in done.stderr, done.stderr


def test_folders_are_made_and_refusals_are_clear(tmp_path: Path) -> None:
    write_text(tmp_path / "a" / "b" / "c.txt", "x")
    assert (tmp_path / "a/b/c.txt").read_text() == "x"
    with pytest.raises(BadInput, match="cannot be written"):
        write_text(tmp_path / "a/b/c.txt/d.txt", "x")


def test_json_is_strict() -> None:
    value = {
        "a": np.array([1.0, np.nan]),
        "b": np.float64(np.inf),
        "c": np.int64(3),
        "d": np.bool_(True),
        "e": Path("x"),
    }
    assert json.loads(to_json(value)) == {"a": [1.0, None], "b": None, "c": 3, "d": True, "e": "x"}


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_tables_keep_every_digit(tmp_path: Path, numbers: list[float]) -> None:
    path = tmp_path / "table.csv"
    write_table(path, ["time", "x"], [np.arange(len(numbers), dtype=float), np.array(numbers)])
    np.testing.assert_array_equal(read_table(path)["x"], numbers)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "row 1: no header"),
        ("time,x\n", "row 2: no data"),
        ("time,x,x\n0,1,2\n", "row 1: column 'x' is given twice"),
        ("time,x\n0,1\n1\n", "row 3: 1 cells, the header has 2"),
        ("time,x\n0,1\n1,two\n", "row 3, column x: 'two' is not a number"),
        ("time,x\n0,1\nnan,2\n", "row 3, column time: 'nan' is not finite"),
        ("time,x\n0,inf\n", "row 2, column x: 'inf' is not finite"),
        ("time,x\n0,\n", "row 2, column x: '' is not a number"),
    ],
)
def test_faults_in_tables_are_named(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=r"table\.csv: ") as caught:
        read_table(path)
    assert says in str(caught.value)


def test_columns_of_text_are_left_out(tmp_path: Path) -> None:
    """Recorders add dates and labels; one bad cell among numbers is still a fault, and so is an empty column."""
    path = tmp_path / "table.csv"
    path.write_text("_id,time,phase,x\n2021:10:05,0,go,1\n2021:10:06,1,stop,2\n")
    assert {name: x.tolist() for name, x in read_table(path).items()} == {"time": [0, 1], "x": [1, 2]}
    path.write_text("phase\ngo\nstop\n")
    with pytest.raises(BadInput, match="row 2, column phase: 'go' is not a number"):
        read_table(path)


def test_spreadsheets_habits_are_understood(tmp_path: Path) -> None:
    """A byte-order mark, spaces after commas, Windows line ends and a blank last line are no faults."""
    path = tmp_path / "table.csv"
    path.write_bytes(b"\xef\xbb\xbftime, x\r\n0, 1.5\r\n1, 2.5\r\n\r\n")
    table = read_table(path)
    np.testing.assert_array_equal(table["x"], [1.5, 2.5])
    np.testing.assert_array_equal(table["time"], [0, 1])


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="No such file"):
        read_table(tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(BadInput, match="not UTF-8"):
        read_table(tmp_path / "binary.csv")


def test_yaml_angles(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("a: !degrees 180.0\nb: !radians 2\n")
    assert read_yaml(path) == {"a": pytest.approx(np.pi), "b": 2.0}
    path.write_text("a: !degrees many\n")
    with pytest.raises(BadInput, match="not valid YAML"):
        read_yaml(path)
    path.write_text("a: !!python/object/apply:os.getcwd []\n")  # nothing is ever run
    with pytest.raises(BadInput, match="not valid YAML"):
        read_yaml(path)


BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 10)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("x.yaml", BOMB, "aliases written out"),
        ("x.yaml", "a: &a [1, *a]\n", "inside of what it refers to"),
        ("x.yaml", "[" * 20000, "nested more than 64 levels"),
        ("x.yaml", f"a: {'9' * 5000}", "not valid YAML"),
        ("x.yaml", "a: 1\n" * 7_000_000, "larger than 32 MB"),
        ("x.json", "[" * 20000 + "]" * 20000, "nested"),
        ("x.json", '{"a":' * 100 + "1" + "}" * 100, "nested more than 64 levels"),
        ("x.json", "9" * 5000, "not valid JSON"),
        ("x.toml", f"a = {'9' * 5000}", "not valid TOML"),
        ("x.toml", "a = " + "[" * 20000, "not valid TOML"),
        ("x.csv", "time,a\n0," + "1" * 200_000, "not a table"),
    ],
)
def test_files_that_would_not_end_are_refused(tmp_path: Path, name: str, text: str, says: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    reader = {"x.yaml": read_yaml, "x.json": read_json, "x.toml": read_toml, "x.csv": read_table}[name]
    with pytest.raises(BadInput, match=says) as caught:
        reader(path)
    assert "\n" not in str(caught.value)


def test_a_key_given_twice_is_refused(tmp_path: Path) -> None:
    """The last value had been taken, and the other one lost without a word."""
    request, limits = tmp_path / "request.json", tmp_path / "joint_limits.yaml"
    request.write_text('{"verb": "optimize", "duration": 2, "duration": 5}')
    with pytest.raises(BadInput, match="key 'duration' is given twice"):
        read_json(request)
    for end in ("", "\n*all : 3"):  # without and with an alias there are two parsers
        limits.write_text(f"x: &all y\njoint_limits:\n  j: {{max_velocity: 1}}\n  j: {{max_velocity: 9}}{end}\n")
        with pytest.raises(BadInput, match="key 'j' is given twice"):
            read_yaml(limits)
    limits.write_text("usual: &usual {a: 1, b: 2}\nj: {<<: *usual, b: 3}\n")
    assert read_yaml(limits)["j"] == {"a": 1, "b": 3}


def test_numbers_with_an_exponent_and_without_a_point_are_numbers(tmp_path: Path) -> None:
    """As in YAML 1.2, and as ROS reads them; YAML 1.1 calls them text."""
    (tmp_path / "x.yaml").write_text("[1e-5, -2E3, +5.e1, .5e+1, 1e, e5, '1e5', 1e5x]")
    assert read_yaml(tmp_path / "x.yaml") == [1e-5, -2000.0, 50.0, 5.0, "1e", "e5", "1e5", "1e5x"]


def test_a_json_document_may_be_a_number(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("1.5")
    assert read_json(tmp_path / "x.json") == 1.5


def test_aliases_of_reasonable_size_are_read(tmp_path: Path) -> None:
    """As libraries dump lists that several points share."""
    (tmp_path / "x.yaml").write_text("- &id001 [0.0, 0.0]\n- *id001\n- *id001\n")
    assert read_yaml(tmp_path / "x.yaml") == [[0.0, 0.0]] * 3
