"""What a failure says: one line, in the reader's words, with a name that was meant, and one JSON document."""

from __future__ import annotations

import json
import re

import pytest
from logs import Z1, arm, lines, log, put

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.errors import BadInput, Infeasible, speaking_of_options
from energy_opt.motion import Move


def test_arguments_in_python_options_on_the_command_line():
    with pytest.raises(BadInput, match="both duration and max_duration are given"):
        Move([0.0], [1.0], duration=1.0, max_duration=2.0)
    error = BadInput("--max-duration 0: see `energy-opt optimize --help`, --max-duration 1-2")
    assert str(error) == "max_duration 0: see `energy-opt optimize --help`, max_duration 1-2"
    with speaking_of_options():
        assert str(error) == "--max-duration 0: see `energy-opt optimize --help`, --max-duration 1-2"


@pytest.mark.parametrize(
    "named",
    ["my --tool.yaml: no file", "out/--force/x.csv", "no link is named 'nix --floor': a frame",
     "my --force folder holds results"],
)  # fmt: skip
def test_names_in_quotes_and_parts_of_paths_are_no_options(named: str) -> None:
    """Their words were replaced as if they were options."""
    assert str(BadInput(named)) == named
    assert str(BadInput(f"{named}; add --force, or --max-power")) == f"{named}; add force=True, or max_power"


def test_a_document_says_all_that_is_known_of_a_failure():
    error = Infeasible("too short", joint="j1", limit="velocity", shortest_duration=1.5)
    error.about = {"robot": "panda"}
    found = error.document()
    assert found["status"] == "infeasible" and found["message"] == "too short" and found["robot"] == "panda"
    assert found["shortest_duration"] == 1.5 and found["joint"] == "j1" and found["excess"] is None


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["optimise"], "no verb 'optimise'; did you mean 'optimize'?"),
        (["robots", "pandda"], "did you mean 'panda'?"),
        (["optimize", "--robot", "panda", "--duratoin", "2"], "did you mean '--duration'?"),
        (["optimize", "--robot", "z1", "--start", "jiont1=0", "--goal", "joint1=0"], "did you mean 'joint1'?"),
        (["check", "x.urdf", "--controls", "16"], "--controls is an option of optimize"),
        (["optimize", "--robot", "z1"], "--start is missing"),
        (["optimize"], "--robot"),
    ],
)
def test_the_name_that_was_meant_in_one_line_and_one_document(capsys, words, says):
    assert main([*words, "--json"]) == 2
    printed = capsys.readouterr()
    assert says in printed.err and printed.err.count("\n") == 1
    found = json.loads(printed.out)
    assert found["status"] == "bad_input" and says in found["message"]


@pytest.mark.parametrize(
    ("verb", "kind"),
    [("passport", "model"), ("bench", "suite"), ("job", "job"), ("tradeoff", "job"), ("check", "KIND")],
)
def test_a_file_that_is_no_toml_of_a_kind_says_which_kind_is_read(tmp_path, capsys, verb, kind):
    file = tmp_path / "x.toml"
    for text, what in (
        ("# nothing", "an empty file"),
        ("a = 1", "format is missing"),
        ("<?xml?><robot/>", "a URDF, not"),
    ):
        file.write_text(text)
        assert main([verb, str(file)]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and f"{file}: {what}" in said
        assert f"(a {kind})" in said or (kind == "KIND" and '"energy-opt/log/1" (a log)' in said)
        assert said.rstrip().endswith(f"see `energy-opt --example {kind}`")


def test_unknown_effects_come_with_a_suggestion(tmp_path, capsys):
    (tmp_path / "m.toml").write_text(
        'format = "energy-opt/model/1"\nrobot = "z1"\n[[effect]]\nname = "coulomb_fricton"\ntau_c = 1\n'
    )
    assert main(["check", str(tmp_path / "m.toml")]) == 2
    assert "did you mean 'coulomb_friction'?" in capsys.readouterr().err


def test_a_folder_with_another_result_is_refused(tmp_path, capsys):
    words = ["optimize", "--robot", "z1", "--start", "0,1,-1,0,0,0", "--mode", "retime", "--out", str(tmp_path / "out")]
    words += ["--model", "source-method-2", "--self-collision", "off"]
    assert main([*words, "--goal", "1,1,-1,0,0,0", "--quiet"]) == 0
    request = json.loads((tmp_path / "out/result.json").read_text())["request"]
    assert request["command"].startswith("energy-opt optimize --robot z1") and request["goal"] == [1, 1, -1, 0, 0, 0]
    assert main([*words, "--goal", "1,1,-1,0,0,0", "--quiet"]) == 0  # the same again
    assert main([*words, "--goal", "1,1,-1,0,0,0", "--quiet", "--max-power", "900"]) == 2
    assert "another request (max_power)" in capsys.readouterr().err
    assert main([*words, "--goal", "1,1.2,-1,0,0,0", "--quiet"]) == 2
    assert "another request (goal); choose another --out, or overwrite it with --force" in capsys.readouterr().err
    assert main([*words, "--goal", "1,1.2,-1,0,0,0", "--quiet", "--force"]) == 0


def test_one_document_in_every_case(capsys, monkeypatch):
    assert main(["--json"]) == 2
    assert json.loads(capsys.readouterr().out)["message"].startswith("no verb; verbs are optimize")
    monkeypatch.setattr("energy_opt.front.robots.run", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main(["robots", "--json"]) == 130
    assert json.loads(capsys.readouterr().out)["status"] == "interrupted"


def test_a_traceback_only_of_unforeseen_faults_and_on_request(capsys, monkeypatch):
    assert main(["optimize", "--robot", "nowhere", "--start", "0", "--goal", "1", "-v"]) == 2
    assert "Traceback" not in capsys.readouterr().err
    monkeypatch.setattr("energy_opt.front.robots.run", lambda *_: 1 / 0)
    assert main(["robots", "-v"]) == 2
    assert "Traceback" in capsys.readouterr().err
    assert main(["robots"]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["identify", "diagnose", "simulate", "check"])
def test_a_payload_in_grams_is_refused_by_every_verb_of_measured_data(tmp_path, capsys, verb):
    t, q, _, p = arm(Z1)
    header = ["time", *(f"{joint}.position" for joint in Z1.joints), "power"]
    motion = put(tmp_path / "a.csv", lines(",".join(header), [t, q, p]))
    log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\n')
    eo.source_model("z1").save(tmp_path / "plant.toml")
    words = {
        "simulate": [str(motion), "--plant", str(tmp_path / "plant.toml")],
        "check": [str(motion), "--robot", "z1"],
    }
    out = [] if verb == "check" else ["--out", str(tmp_path / "out")]
    assert main([verb, *words.get(verb, [str(tmp_path)]), *out, "--payload", "500"]) == 2
    assert "are these grams? then 0.5 kg" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_other_column_names_have_a_remedy(tmp_path, capsys):
    joints = [f"joint{k}" for k in range(1, 7)]
    (tmp_path / "pos.csv").write_text(f"time,{','.join(f'{joint}.pos' for joint in joints)}\n0,0,1,-1,0,0,0\n")
    assert main(["check", str(tmp_path / "pos.csv"), "--robot", "z1"]) == 2
    assert "expected names such as joint1.position; `energy-opt import`" in capsys.readouterr().err
    (tmp_path / "set").mkdir()
    (tmp_path / "set/log.toml").write_text('format = "energy-opt/log/1"\nrobot = "z1"\n[[run]]\nfile = "q.csv"\n')
    (tmp_path / "set/q.csv").write_text("time,q1,q2,q3,q4,q5,q6,power\n0,0,1,-1,0,0,0,90\n1,0,1,-1,0,0,0,90\n")
    for verb in ("check", "identify"):
        assert main([verb, str(tmp_path / "set")]) == 2
        said = capsys.readouterr().err
        assert "[columns] of log.toml" in said and "`energy-opt import`" in said, said


def test_an_exceeded_limit_says_by_how_much(tmp_path, capsys):
    header = ",".join(["time", *(f"joint{k}.position" for k in range(1, 7))])
    rows = [f"{t / 100},{0.1 * t},1,-1,0,0,0" for t in range(31)]  # 10 rad/s
    (tmp_path / "fast.csv").write_text("\n".join([header, *rows]))
    assert main(["check", str(tmp_path / "fast.csv"), "--robot", "z1", "--self-collision", "off"]) == 2
    said = capsys.readouterr().err
    bound = eo.load_robot("z1").limits.velocity[0]
    assert f"bound {bound:.6g}, exceeded by {100 * (10 / bound - 1):.3g} %" in said, said
    assert re.search(r"position of joint1 is \S+ at .*exceeded by \S+ rad\n", said), said


def test_a_job_from_a_mapping_is_not_called_a_file():
    with pytest.raises(eo.BadInput, match=r"^job: step is missing$"):
        eo.job({"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 4.0})
