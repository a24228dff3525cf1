"""Faults of a cell's description, each named in one line by `check` and `job`."""

from __future__ import annotations

from pathlib import Path

import pytest
import tomli_w

import energy_opt as eo
from energy_opt.cli.main import main


def refused(tmp_path: Path, document: dict, verb: str = "job", *options: str) -> int:
    """The exit code for a description, as a file of `tmp_path`."""
    file = tmp_path / "cell.toml"
    file.write_bytes(tomli_w.dumps(document).encode())
    return main([verb, str(file), *options])


def one_robot(*steps: dict) -> dict:
    """A job of one Panda."""
    robot = {"name": "a", "robot": "panda", "step": list(steps)}
    return {"format": "energy-opt/job/2", "cycle_time": 9.0, "robot": [robot]}


def test_a_step_does_not_come_after_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(tmp_path, one_robot({"name": "p", "to": [0.0] * 7, "after": "a.p"})) == 2
    assert "robot a: step p: after = 'a.p' is the step itself; name another" in capsys.readouterr().err


def test_the_robot_of_a_step_is_proposed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`after` has it, also for a step of the same robot; nothing was proposed."""
    assert refused(tmp_path, one_robot({"name": "A", "wait": 1.0}, {"wait": 1.0, "after": "A"})) == 2
    assert "after = 'A': no such step; did you mean 'a.A'?" in capsys.readouterr().err


def test_check_names_a_frame_that_no_pose_of_a_cell_can_be_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.yaml").write_text(
        "objects:\n  - {name: table, type: box, size: [0.3, 0.3, 0.1], position: [0.5, 0, 0]}\n"
    )
    unknown, known = (
        one_robot({"name": "pick", "pose": f"{frame}: 0, 0, 0.1, 3.14, 0, 0"}) | {"scene": "scene.yaml"}
        for frame in ("tabel", "table")
    )
    assert refused(tmp_path, unknown, "check") == 2
    assert "robot a: step 1 (pick): no frame 'tabel'; did you mean 'table'?" in capsys.readouterr().err
    assert refused(tmp_path, known, "check") == 0


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("to", 5, "to = 5; expected a list, a table or text"),
        ("to", [1.0, "x"], "to 2 = 'x'; expected a number"),
        ("to", {"joint": "x"}, "to: joint = 'x'; expected a number"),
        ("wait", "x", "wait = 'x'; expected a number or a list"),
        ("wait", [1.0], "wait 2 is missing"),
    ],
)
def test_a_value_of_no_kind_that_a_key_may_have_is_one_fault(
    key: str, value: object, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(tmp_path, one_robot({"name": "p", key: value})) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"cell.toml: robot 1 (a): step 1 (p): {says}")


@pytest.mark.parametrize(
    ("step", "cell", "arm", "says"),
    [
        ({"payload": 2500.0}, {}, {}, "(p): payload = 2500.0; effect payload: mass = 2500 is outside [0, 1000] kg"),
        ({"payload": [1.0, 20.0, 0.0, 0.0]}, {}, {}, "effect payload: com = 20 is outside [-10, 10] m"),
        ({}, {"scene": "../scene.yaml"}, {}, "'../scene.yaml' lies outside of"),
        ({}, {}, {"model": "../model.toml"}, "'../model.toml' lies outside of"),
    ],
)
def test_check_refuses_what_the_job_refuses(
    step: dict, cell: dict, arm: dict, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Payloads beyond all bounds passed the check; a cell's scene and models were read from anywhere."""
    (tmp_path / "scene.yaml").write_text("objects: []\n")
    (tmp_path / "model.toml").write_text('format = "energy-opt/model/1"\n')
    (tmp_path / "job").mkdir()
    document = one_robot({"name": "p", "to": [0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0], **step}) | cell
    document["robot"][0] |= arm
    for verb in ("check", "job"):
        assert refused(tmp_path / "job", document, verb) == 2
        assert says in capsys.readouterr().err


def test_check_reads_the_positions_of_every_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = one_robot({"name": "pick", "to": [0.0, 0.5, 0.0, -1.6, 0.0, 2.1, 0.7]})
    assert refused(tmp_path, document, "check") == 0
    document["robot"].append({**document["robot"][0], "name": "b"})
    document["robot"][1]["step"] = [{"name": "pick", "to": [9.0, 0.5, 0.0, -1.6, 0.0, 2.1, 0.7]}]
    assert refused(tmp_path, document, "check") == 2
    assert "robot b: step 1 (pick): panda_joint1 = 9 is outside" in "".join(capsys.readouterr())


def test_a_step_without_a_name_is_named_once_in_messages() -> None:
    steps = [{"duration": [1, 2], "curve": [[2, -5.0]]}, {"wait": [0, 9], "power": {"on": 10.0}, "modes": ["off"]}]
    job = {"format": "energy-opt/job/2", "cycle_time": 6.0, "robot": [{"name": "a", "step": steps}]}
    with pytest.raises(eo.BadInput, match=r"robot a: step 2: no mode 'off'"):
        eo.job(job)
    del steps[1]["modes"]
    with pytest.raises(eo.BadInput, match=r"robot a: step 1: its curve is not convex"):
        eo.job(job)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["tradeoff"], "tradeoff takes jobs of one robot; use `job` with other values of cycle_time"),
        (["place", "--base-box", "0,1,0,1,0,1"], "place takes jobs of one robot"),
    ],
)
def test_verbs_of_one_robot_say_so(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another format was expected."""
    assert refused(tmp_path, one_robot({"name": "x", "to": [0.0] * 7}), *words) == 2
    assert said in capsys.readouterr().err


def test_a_jitter_in_milliseconds_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(tmp_path, {**one_robot({"wait": 9.0}), "jitter": 20}) == 2
    assert "jitter = 20 s is more than half of the cycle; 20 ms are 0.02" in capsys.readouterr().err


def test_the_table_shows_steps_of_zero_duration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    move, rest = {"duration": 9.0, "curve": [[0, 50.0]]}, {"name": "rest", "wait": [0, 5], "power": {"motors": 1.0}}
    document = {"format": "energy-opt/job/2", "cycle_time": 9.0, "robot": [{"name": "a", "step": [move, rest]}]}
    assert refused(tmp_path, document, "job", "--out", str(tmp_path / "out")) == 0
    assert "rest                              9.000      0.000 motors" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("document", "says"),
    [
        (
            {"format": "energy-opt/job/2", "robot": "panda", "step": [{"to": [0.0] * 7}]},
            "with the keys of one robot; expected 'energy-opt/job/1'",
        ),
        (
            {
                "format": "energy-opt/job/2",
                "cycle_time": 9.0,
                "robot": [{"name": "a", "step": [{"wait": 9.0, "after": "b.step 1"}]} for _ in range(2)],
            },
            "robot: two robots are named 'a'",
        ),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], document: dict, says: str) -> None:
    assert refused(tmp_path, document) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


def test_a_job_in_json_is_led_to_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "job.json").write_text('{"format": "energy-opt/job/1"}')
    assert main(["job", str(tmp_path / "job.json")]) == 2
    assert "JSON, not TOML; `energy-opt run` takes results" in capsys.readouterr().err
