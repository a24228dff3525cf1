"""Files that a request names are found from any folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.front.verbs import asked_in
from energy_opt.requests.moves import OptimizeRequest

A, B = [0.0, 1.0, -1.0, 0.0, 0.0, 0.0], [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]


def test_files_of_a_request_are_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A result names files as its command did; it could be repeated only where that command was given."""
    for folder in ("project/out", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    project = tmp_path / "project"
    for name in ("limits.yaml", "model.toml", "careful"):
        (project / name).write_text("")
    asked = {"verb": "tradeoff", "limits": "limits.yaml", "model": ["model.toml", "careful"], "scene": "gone.yaml"}
    (project / "out/tradeoff.json").write_text(json.dumps({"request": {**asked, "robot": "z1", "start": A}}))
    monkeypatch.chdir(tmp_path / "elsewhere")
    notes: list[str] = []
    found = asked_in(project / "out/tradeoff.json", notes.append).document()
    assert found["limits"] == str(project / "limits.yaml")
    assert found["model"] == [str(project / "model.toml"), "careful"]
    assert found["scene"] == "gone.yaml" and found["start"] == A and len(notes) == 2
    (tmp_path / "elsewhere/limits.yaml").write_text("")
    assert asked_in(project / "out/tradeoff.json")["limits"] == "limits.yaml"  # the current folder comes first


def test_files_of_a_job_are_found_after_its_project_was_moved(tmp_path: Path) -> None:
    """The result states the job's folder; a moved project could not be repeated."""
    (tmp_path / "moved/out").mkdir(parents=True)
    (tmp_path / "moved/cell.yaml").write_text("")
    result, notes = tmp_path / "moved/out/job.json", list[str]()
    for folder, found in ((tmp_path / "project", "moved"), (tmp_path, "")):  # another one that exists is the job's
        job = {"robot": "z1", "step": [{"to": A}, {"to": B, "scene": "cell.yaml"}]}
        result.write_text(json.dumps({"request": {"verb": "job", "job": job, "folder": str(folder)}}))
        assert asked_in(result, notes.append)["folder"] == str(tmp_path / found)
    assert len(notes) == 1 and notes[0].startswith(f"{tmp_path / 'project'} does not exist; the files of the job are")


@pytest.mark.parametrize("verb", ["job", "tradeoff", "place"])
@pytest.mark.parametrize("file", ["cell.yaml", "part.yaml"])
def test_a_request_by_hand_finds_the_files_of_its_job(
    verb: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They were found only from their own folder; a message named `job.toml`, which did not exist."""
    step = {"cell.yaml": {"to": A, "scene": "cell.yaml"}, "part.yaml": {"pose": "part.yaml"}}[file]
    job = {"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 4.0, "step": [step]}
    box = {"base_box": "0,0,0,0,0,0"} if verb == "place" else {}
    folders = tmp_path / "hand", tmp_path / "hand/below", tmp_path / "elsewhere"
    for each in folders:
        each.mkdir()
    monkeypatch.chdir(folders[2])
    request = folders[1] / "request.json"
    request.write_text(json.dumps({"verb": verb, "job": job, **box}))
    assert main(["run", str(request), "--out", str(tmp_path / "x"), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert f"{request}: " in said and file in said
    for folder, found in zip(folders, (folders[0], request, None), strict=True):  # the current folder comes first
        (folder / file).write_text("")
        assert Path(asked_in(request)["folder"]) == (found or Path.cwd())


def test_a_resolved_request_is_repeated_as_its_document() -> None:
    """It states the ends of its path, too, and `eo.repeat(result)` refused them."""
    resolved = OptimizeRequest("z1", path=[A, B], start=A, goal=B)
    assert resolved.start == A
    again = asked_in(resolved)
    assert isinstance(again, OptimizeRequest) and again.path == [A, B] and again.start is again.goal is None


def test_what_cannot_be_repeated_says_what_is_expected(tmp_path: Path) -> None:
    """Both said what the operating system says: no such file, is a directory."""
    with pytest.raises(BadInput, match=r"motion from memory; .*save the result"):
        eo.repeat({"verb": "evaluate", "files": ["motion_01_8e41e0ed.csv"], "robot": "z1"})
    with pytest.raises(BadInput, match="folder without a result; expected one with result"):
        eo.repeat(tmp_path)
