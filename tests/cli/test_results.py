"""A folder of results holds the files of one motion, whatever lay there before."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.folders import ANSWERS, BESIDE, faults_of_results, guard, leave_folder, written_whole
from energy_opt.formats import FORMATS
from energy_opt.front.simulate import simulated_files

READY, NEAR = "0,-0.785,0,-2.356,0,1.571,0.785", "0.2,-0.685,0.1,-2.256,0.1,1.471,0.885"
MOVE = ("optimize", "--robot", "panda", "--start", READY, "--goal", NEAR, "--mode", "retime", "--quiet",
        "--self-collision", "off", "--model", "source-method-2", "--duration")  # fmt: skip


def run(out: Path, *words: str) -> int:
    return main([*MOVE, *words, "--out", str(out)])


def listed(out: Path) -> set[str]:
    """Names that result.json lists, each with the digest that the file has."""
    rows = json.loads((out / "result.json").read_text())["files"]
    for row in rows:
        assert hashlib.sha256((out / row["name"]).read_bytes()).hexdigest() == row["sha256"]
    return {row["name"] for row in rows}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("results") / "out"
    assert run(out, "1.5", "--write", "yaml", "--write", "mcap", "--write", "follow-joint-trajectory") == 0
    return out


def copied(folder: Path, out: Path) -> Path:
    out.mkdir()
    for path in folder.iterdir():
        (out / path.name).write_bytes(path.read_bytes())
    return out


def test_every_format_that_is_written_is_known_to_be_ours() -> None:
    assert {f"trajectory{f.suffix}" for f in FORMATS.values() if f.write} <= set(BESIDE["result.json"])


def test_a_result_lists_its_files(written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert listed(written) == {path.name for path in written.iterdir()} - {"result.json"}
    assert main(["check", str(written), "--quiet"]) == 0
    out = copied(written, tmp_path / "other")
    (out / "trajectory.yaml").write_text("another motion")
    (out / "plot.png").unlink()
    (out / "trajectory.script").write_text("another motion")
    assert main(["check", str(out), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "trajectory.yaml: is not the file" in said and "plot.png: is missing" in said and ".script: not of" in said


def test_the_json_of_a_result_stands_for_its_folder(
    written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was refused as no planned trajectory."""
    out = copied(written, tmp_path / "other")
    assert main(["check", str(out / "result.json")]) == 0
    assert "result.json: its folder is checked" in capsys.readouterr().err
    (out / "trajectory.csv").write_text("another motion")
    assert main(["check", str(out / "result.json")]) == 2
    assert "trajectory.csv: is not the file" in capsys.readouterr().err


def test_files_in_a_folder_of_a_result_are_its_own(tmp_path: Path) -> None:
    """The job in the folder of `place` was listed, and then taken for files of another result."""
    with written_whole(tmp_path, "place.json") as aside:
        (aside / "place.json").write_text("{}")
        with written_whole(aside / "job", "job.json") as inner:
            (inner / "job.json").write_text("{}")
            (inner / "cycle.csv").write_text("time")
    assert faults_of_results(tmp_path) == [] == faults_of_results(tmp_path / "job")
    (tmp_path / "job" / "step_01.csv").write_text("another motion")
    (tmp_path / "job" / "cycle.csv").write_text("another motion")
    first, second = faults_of_results(tmp_path)
    assert "cycle.csv: is not the file" in first and "step_01.csv: not of the motion" in second


@pytest.mark.parametrize("state", ["tradeoff.json", "results.jsonl", "unlisted", "broken"])
def test_a_second_run_leaves_files_of_one_motion_only(written: Path, tmp_path: Path, state: str) -> None:
    """Over the results of other verbs, over files without a document, and over a document that is none."""
    out = copied(written, tmp_path / "out")
    (out / "mine.txt").write_text("foreign")
    answer = state if state in ANSWERS else "result.json"
    for pattern in BESIDE[answer]:
        (out / pattern.replace("[0-9]*", "01").replace("*", "7")).write_text("old")
    (out / "result.json").unlink()
    if state != "unlisted":
        (out / answer).write_text("{" if state == "broken" else '{"request": {}}')
    assert run(out, "1", "--force") == 0
    assert {path.name for path in out.iterdir()} == listed(out) | {"result.json", "mine.txt"}
    assert "trajectory.mcap" not in listed(out) and faults_of_results(out) == []


@pytest.mark.parametrize("name", ["trajectory.csv", "plot.png", "trajectory_500hz.csv"])
def test_files_that_no_result_lists_are_kept(
    name: str, written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In an empty folder, and beside an earlier result that does not list them; `--force` replaces them."""
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert run(out, "1.5") == 2
    assert f"{name}: would be replaced, and no result in" in capsys.readouterr().err
    assert {path.name: path.read_text() for path in out.iterdir()} == {name: "mine"}
    beside = copied(written, tmp_path / "beside")
    (beside / "trajectory_500hz.csv").write_text("mine")
    request = ("--write", "yaml", "--write", "mcap", "--write", "follow-joint-trajectory")
    assert run(beside, "1.5", *request) == 2
    assert (beside / "trajectory_500hz.csv").read_text() == "mine"
    (beside / "trajectory_500hz.csv").unlink()
    assert run(beside, "1.5", *request) == 0
    assert run(out, "1.5", "--force") == 0


@pytest.mark.parametrize("words", [("evaluate", "--robot", "panda"), ("optimize", "--robot", "panda", "--path")])
def test_a_file_that_is_read_is_not_replaced(
    words: tuple[str, ...], written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Results may have the names of a user's own trajectories, which were removed."""
    own = tmp_path / "trajectory.yaml"
    own.write_bytes((written / "trajectory.yaml").read_bytes())
    assert main([*words, str(own), "--out", str(tmp_path), "--quiet"]) == 2
    assert "trajectory.yaml: would be replaced by a result" in capsys.readouterr().err
    assert own.read_bytes() == (written / "trajectory.yaml").read_bytes()


def test_an_infeasible_move_leaves_nothing_of_another(written: Path, tmp_path: Path) -> None:
    out = copied(written, tmp_path / "out")
    assert run(out, "0.01", "--force") == 3
    assert {path.name for path in out.iterdir()} == {"result.json"} and listed(out) == set()
    assert main(["check", str(out), "--quiet"]) == 0
    (out / "trajectory.script").write_text("of another motion")
    assert main(["check", str(out), "--quiet"]) == 2


@pytest.mark.parametrize("name", ["trajectory.csv", "result.json"])
def test_a_folder_in_the_way_is_refused_before_anything_is_touched(written: Path, tmp_path: Path, name: str) -> None:
    out = copied(written, tmp_path / "out")
    (out / name).unlink(missing_ok=True)
    (out / name / "kept").mkdir(parents=True)
    before = sorted((path, path.stat().st_mtime_ns) for path in out.rglob("*"))
    assert run(out, "2", "--force") == 2
    assert sorted((path, path.stat().st_mtime_ns) for path in out.rglob("*")) == before


def test_a_folder_in_the_way_of_a_file_that_no_table_lists(tmp_path: Path) -> None:
    (tmp_path / "of_tomorrow.bin").mkdir()
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(BadInput, match="of_tomorrow"), written_whole(tmp_path, "result.json") as aside:
        (aside / "of_tomorrow.bin").write_text("x")
        (aside / "result.json").write_text('{"new": 1}')
    assert (tmp_path / "result.json").read_text() == "{}"


def test_runs_that_were_simulated_go_with_their_log_and_measured_ones_stay(tmp_path: Path) -> None:
    (tmp_path / "log.toml").write_text(
        '[[run]]\nfile = "run01.csv"\npower_file = "p.csv"\n[[run]]\nfile = "../x.csv"\n'
    )
    for name in ("run01.csv", "p.csv", "mine.csv"):
        (tmp_path / name).write_text("old")
    assert simulated_files(tmp_path) == []  # measured: there is no truth
    (tmp_path / "truth.toml").write_text("")
    with written_whole(tmp_path, "log.toml", simulated_files(tmp_path)) as aside:
        (aside / "run01.csv").write_text("new")
        (aside / "log.toml").write_text("")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.toml", "mine.csv", "run01.csv", "truth.toml"]


@pytest.mark.parametrize("one", [{"floor": 0.0}, {"idle_power": 0}, {"self_collision": False}], ids=str)
def test_zero_and_false_are_values_of_a_request(one: dict[str, Any], tmp_path: Path) -> None:
    file, name = tmp_path / "result.json", next(iter(one))
    for held, wanted in ((one, {}), ({}, one), ({name: None}, one)):
        file.write_text(json.dumps({"request": held, "files": []}))
        guard(file, held, force=False)
        with pytest.raises(BadInput, match=f"another request \\({name}\\)"):
            guard(file, wanted, force=False)
    leave_folder(tmp_path)


def test_an_empty_entry_of_a_request_is_none(tmp_path: Path) -> None:
    """Earlier versions also wrote entries without a value."""
    file = tmp_path / "result.json"
    file.write_text(json.dumps({"request": {"via": [], "path": None, "cell": {}}, "files": []}))
    guard(file, {}, force=False)
    leave_folder(tmp_path)
