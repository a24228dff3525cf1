"""`tradeoff JOB.toml`: a job over its cycle time, and its knee."""

import json

import numpy as np
import pytest

from energy_opt.cli.main import main
from energy_opt.jobs.over_time import knee, text
from energy_opt.jobs.work import Answers

JOB = """format = "energy-opt/job/1"
robot = "z1"
cycle_time = 6.0
home = [0, 1, -1, 0, 0, 0]
[[step]]
name = "there"
to = [0.8, 1.5, -1.3, 0.3, 0.2, 0.1]
mode = "retime"
[[step]]
wait = 0.5
[[step]]
to = "home"
mode = "retime"
"""


def test_the_model_of_a_front_of_several_is_named():
    """A cycle that takes more than a simple one under the first model looked like a poor plan."""
    row = {"duration": 5.0, "energy_total": 9.0, "evenly_slowed": 9.2, "fastest_then_wait": 8.9, "status": "solved"}
    several = {"kind": "mean", "models": [{"name": "first"}, {"name": "second"}]}
    found = {"points": [row], "fastest": 2.0, "knee": None, "request": {"robust": several}}
    assert text(found).splitlines()[2] == "under first; planned for the mean of the models"
    assert "under" not in text({**found, "request": {}})


def test_a_straight_line_moves_no_knee():
    time = np.linspace(1.0, 8.0, 29)
    loss = 3.0 / time
    k = knee(time, loss)
    assert k == knee(time, loss + 88.0 * time)
    assert abs(time[k] - np.sqrt(8.0)) < 0.26  # where the slope of c/t is that of the line between the ends
    assert knee(time, 88.0 * time) is None and knee(time[:2], loss[:2]) is None


@pytest.mark.slow
def test_a_job_over_its_cycle_time(tmp_path, capsys):
    (tmp_path / "job.toml").write_text(JOB)
    words = [str(tmp_path / "job.toml"), "--model", "source-method-2", "--compile", "never", "--json", "--quiet"]
    assert main(["tradeoff", *words, "--durations", "1:4:4", "--out", str(tmp_path / "front")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["duration"] for row in found["points"]] == [1.0, 2.0, 3.0, 4.0]
    for row in found["points"]:
        assert (row["status"] == "infeasible") == (row["duration"] < found["fastest"])
        if row["status"] != "infeasible":
            assert row["energy_total"] <= min(row["evenly_slowed"], row["fastest_then_wait"]) * (1 + 1e-9)
            assert row["energy_total"] == pytest.approx(row["energy_standby"] + row["energy_loss"])
    assert (tmp_path / "front/tradeoff.csv").read_text().splitlines()[0].startswith("duration,energy_total")
    report = (tmp_path / "front/report.html").read_text()
    assert (tmp_path / "front/plot.png").is_file() and "cycle time" in report
    assert found["assumptions"] and "Values that were not given" in report

    text = JOB.replace("cycle_time = 6.0", "cycle_time = 4.0")  # a point is what `job` makes of that cycle time
    (tmp_path / "four.toml").write_text(text)
    assert main(["job", str(tmp_path / "four.toml"), *words[1:], "--out", str(tmp_path / "four")]) == 0
    assert json.loads(capsys.readouterr().out)["energy_total"] == pytest.approx(found["points"][3]["energy_total"])


def test_a_stopped_front_of_a_job_is_continued(tmp_path, monkeypatch):
    """Legs that were answered are not solved again, and nothing is kept of a front that is done."""
    (tmp_path / "job.toml").write_text(JOB)
    words = ["tradeoff", str(tmp_path / "job.toml"), "--model", "source-method-2", "--compile", "never", "--quiet"]
    words += ["--durations", "3:4:2", "--out", str(tmp_path / "front"), "--resume"]
    solved, usual, most = [], Answers.keep, [1]

    def counted(answers, leg, *words):
        if len(solved) == most[0]:
            raise RuntimeError("the machine stops here")
        solved.append(leg)
        usual(answers, leg, *words)

    monkeypatch.setattr(Answers, "keep", counted)
    assert main(words) != 0 and len(list((tmp_path / "front" / ".answers").glob("*.csv"))) == 1
    most[0] = 4
    assert main(words) == 0 and len(solved) <= 4  # two cycles of two legs, one of them answered before
    assert not (tmp_path / "front" / ".answers").exists()


@pytest.mark.slow
def test_a_job_under_several_models_states_what_its_mean_is_held_against(tmp_path):
    (tmp_path / "job.toml").write_text(JOB)
    assert main(["job", str(tmp_path / "job.toml"), "--compile", "never", "--quiet", "--out", str(tmp_path / "o")]) == 0
    found = json.loads((tmp_path / "o" / "job.json").read_text())
    planned = [row["total"] for row in found["models"][:2]]
    assert found["robust"]["total"] == pytest.approx(sum(planned) / 2)
    slowed = [row["total"] + row["saving_joules"] for row in found["models"][:2]]
    assert found["robust"]["baselines"]["evenly_slowed"] == pytest.approx(sum(slowed) / 2)
    bound, known = found["robust"]["lower_bound"], found["optimality"]
    assert bound is None or bound <= found["robust"]["total"] * (1 + 1e-12)
    assert known["lower_bound"] is None and (known["gap_percent"] is None) == (bound is None)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["job.toml", "--start", "0,1,-1,0,0,0"], "--start belongs to one move"),
        (["job.toml", "--cycle", "3"], "--cycle belongs to one move"),
        (["job.toml", "--mode", "retime"], "--mode belongs to one move"),
        (["--robot", "z1", "--resume"], "--resume belongs to a job"),
        ([], "--robot is missing"),
    ],
)
def test_what_does_not_go_together(words, expected, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.toml").write_text(JOB)
    assert main(["tradeoff", *words, "--out", "front"]) == 2 and expected in capsys.readouterr().err
