"""What all results share: a document as JSON text, files in a folder, a view in notebooks."""

import copy
import inspect
import json
import pickle
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.front.verbs import VERBS, function_of
from energy_opt.motion import Baseline
from energy_opt.results import Document, Found, exit_of


class Table(Found):
    """A result with a table and a file."""

    def document(self) -> dict[str, Any]:
        return {"a": 1}

    def text(self, out: Path) -> str:
        return f"a < b\nfiles in {out}"

    def kept(self, out: Path) -> "Table":
        (out / "a.json").write_text(self.to_json())
        return self


class Said(Found):
    """A result whose messages said all; its document is a value."""

    def __init__(self) -> None:
        self.document = Document({"b": [2.0]})

    def __str__(self) -> str:
        return "two & more"


@pytest.mark.parametrize("verb", [name for name in VERBS if name != "run"])
def test_every_verb_returns_a_result_of_this_base(verb: str) -> None:
    returned = get_type_hints(function_of(verb))["return"]
    assert all(issubclass(kind, Found) for kind in get_args(returned) or (returned,))


@pytest.mark.parametrize("verb", [name for name in VERBS if name not in ("run", "effects")])
def test_the_text_of_a_verb_names_what_its_result_has(verb: str) -> None:
    """It ended with "Returns: Checked.", and promised identify.json for suggested poses."""
    returned = get_type_hints(function_of(verb))["return"]
    text = inspect.getdoc(getattr(eo, {"import": "import_logs"}.get(verb, verb))) or ""
    lines = text.partition("Returns:\n")[2].splitlines()
    for kind, line in zip(get_args(returned) or (returned,), lines, strict=True):
        first = re.findall(r"`(\w+)", line)[0]
        assert line.startswith(f"    {kind.__name__}: ")
        assert hasattr(kind, first) or first in {field.name for field in fields(kind)}
        assert ".json" not in line or kind.__name__ != "Suggested"


def test_a_result_is_text_files_and_a_view(tmp_path: Path) -> None:
    assert Table().save(str(tmp_path)) == tmp_path
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": 1} and Table().exit_code == 0
    assert Table()._repr_html_() == "<pre>a &lt; b</pre>"
    assert str(Table()) == "a < b" and str(silent := Found()) == repr(silent)
    assert Table()["a"] == 1 and Said()["b"] == [2.0]
    assert Said().document()["b"] == Said().document["b"], "the form of version 0.1"
    assert json.loads(Said().to_json()) == {"b": [2.0]} and Said()._repr_html_() == "<pre>two &amp; more</pre>"


def test_what_the_command_prints_is_what_python_prints(tmp_path: Path) -> None:
    """`print(eo.tradeoff(...))` showed one line, that of `repr`."""
    (tmp_path / "model.toml").write_text("format = 3\n")
    robots, checked = str(eo.robots("z1")), str(eo.check([tmp_path / "model.toml", tmp_path]))
    assert robots.startswith("z1  (6 joints") and "joint6" in robots
    assert "model.toml: format: 3" in checked and f"{tmp_path}: no log.toml" in checked
    steps = [{"to": [0.3, 1, -1, 0, 0, 0], "mode": "retime"}, {"to": [0, 1, -1, 0, 0, 0], "mode": "retime"}]
    job = {"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 4.0, "step": steps}
    cycle = eo.job(job, model="source-method-2", self_collision=False)
    assert "in a 4 s cycle: this plan" in str(cycle) and repr(cycle).startswith("JobAnswer(")


def test_a_result_in_python(tmp_path: Path) -> None:
    """Candidates held arrays, and `saving` had no attributes."""
    goals = eo.AnyOf([[0.3, 1, -1, 0, 0, 0], [0.6, 1, -1, 0, 0, 0]])
    asked: dict[str, Any] = {"start": [0, 1, -1, 0, 0, 0], "mode": "retime", "self_collision": False}
    found = eo.optimize("z1", "source-method-2", goal=goals, duration=2.0, **asked)
    document = json.loads(found.to_json())
    assert json.loads(json.dumps(found.document())) == document, "candidates of the document held arrays"
    assert {name: found[name] for name in document} == document and found["candidates"]
    assert found.saving is not None and found.saving.loss_percent == found["saving"]["loss_percent"]
    with pytest.raises(eo.BadInput, match="baselines are toppra, scaled, input; did you mean 'scaled'"):
        found.baseline("scale")
    with pytest.raises(KeyError, match="did you mean 'saving'"):
        found["savings"]


def test_a_type_checker_knows_that_a_result_has_effort_and_power() -> None:
    """`result.trajectory.power` was `ndarray | None`."""
    for kind in (eo.Result, Baseline):
        held = get_type_hints(get_type_hints(kind)["trajectory"])
        assert held["effort"] is held["power"] is np.ndarray


@pytest.mark.parametrize(("interrupted", "good", "code"), [(0, 1, 0), (0, 0, 4), (1, 1, 130), (1, 0, 130)])
def test_an_interrupted_answer_says_so_whether_it_is_good_or_not(interrupted: int, good: int, code: int) -> None:
    assert exit_of(bool(interrupted), bool(good)) == code


def test_a_result_is_read_like_a_mapping() -> None:
    """`"a" in found`, `list(found)` and `dict(found)` raised KeyError."""
    assert "a" in Table() and "b" not in Table() and list(Table()) == ["a"] and dict(Table()) == {"a": 1}
    assert dict(Said()) == {"b": [2.0]}


def test_objects_with_arrays_are_compared_as_objects() -> None:
    """`==` raised ValueError, and `hash` TypeError."""
    one, other = eo.load_robot("z1"), eo.load_robot("z1")
    found = eo.optimize(one, "source-method-2", start=[0, 1, -1, 0, 0, 0], goal=[0.3, 1, -1, 0, 0, 0], mode="retime")
    again = replace(found, trajectory=replace(found.trajectory))
    for a, b in ((one, other), (one.limits, other.limits), (found, again), (found.trajectory, again.trajectory)):
        assert a == a and a != b and len({a, b, a}) == 2
    assert found.baselines[0] in found.baselines and len(set(found.baselines)) == 2


def test_a_trajectory_of_an_answer_keeps_what_was_judged() -> None:
    """`save` wrote positions that were changed in place, with the certificate of the others."""
    given = np.zeros((2, 1))
    held = eo.Trajectory(("a",), np.array([0.0, 1.0]), given, given, given).filled(given, np.zeros(2))
    for each in (held, copy.deepcopy(held), pickle.loads(pickle.dumps(held))):
        for array in (each.time, each.position, each.velocity, each.acceleration, each.effort, each.power):
            with pytest.raises(ValueError, match="read-only"):
                array[:] += 0.5
    given += 1.0  # a trajectory of one's own can be changed
