"""What a saving is worth in a year, from every verb that states one."""

import json

import pytest

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.power.per_year import PerYear, per_year_of, per_year_words

ENDS = ["--start", "0,1,-1,0,0,0", "--goal", "0.8,1.5,-1.3,0.3,0.2,0.1"]
MOVE = ["--robot", "z1", *ENDS, "--mode", "retime", "--model", "source-method-2", "--compile", "never"]
YEAR = ["--cycles-per-year", "720000", "--price", "0.25", "--co2", "0.4", "--json", "--quiet"]
JOB = """format = "energy-opt/job/1"
robot = "z1"
cycle_time = 6.0
home = [0, 1, -1, 0, 0, 0]
[[step]]
to = [0.8, 1.5, -1.3, 0.3, 0.2, 0.1]
mode = "retime"
[[step]]
to = "home"
mode = "retime"
"""
SUITE = """format = "energy-opt/suite/1"
name = "s"
robots = ["z1"]
modes = ["retime"]
durations = [2.0, 3.0]
models = ["source_method_2"]
[[moves]]
name = "m"
start = [0, 1, -1, 0, 0, 0]
goal = [0.8, 1.5, -1.3, 0.3, 0.2, 0.1]
"""
CELL = """format = "energy-opt/job/2"
cycle_time = 10.0
[[mode]]
name = "motors"
power = 200.0
[[robot]]
name = "a"
[[robot.step]]
name = "move"
duration = [1.0, 9.0]
curve = [[-1, 400.0], [0, 20.0], [1, 60.0]]
[[robot.step]]
name = "rest"
wait = [0.0, 20.0]
"""


def test_five_joules_in_each_of_720000_cycles_are_one_kilowatt_hour():
    assert PerYear(720000, price=0.25, co2=0.4).of(5.0) == pytest.approx({"kwh": 1.0, "money": 0.25, "co2_kg": 0.4})
    assert PerYear(720000).of(5.0) == {"kwh": 1.0, "money": None, "co2_kg": None}
    assert PerYear(720000, 0.25).of(None) == {"kwh": None, "money": None, "co2_kg": None}
    words = per_year_words(PerYear(720000, 0.25).of(5.0), 720000)
    assert words == "saves in a year of 720,000 cycles: 1 kWh, 0.25 in money"


@pytest.mark.parametrize("given", [(None, 0.3, None), (None, None, 0.4), (-1.0, None, None), (1.0, float("nan"), None)])
def test_a_price_without_cycles_and_numbers_below_0_are_refused(given):
    with pytest.raises(BadInput, match=r"price|co2|cycles_per_year"):
        per_year_of(*given)


def held(found, joules):
    """The three numbers of a document are those of so many joules a cycle."""
    kwh = joules * 720000 / 3.6e6
    assert {k: found["per_year"][k] for k in ("kwh", "money", "co2_kg")} == pytest.approx(
        {"kwh": kwh, "money": 0.25 * kwh, "co2_kg": 0.4 * kwh}
    )


def answered(words, tmp_path, capsys):
    assert main([*words, *YEAR, *(["--out", str(tmp_path / "out")])]) == 0
    return json.loads(capsys.readouterr().out)


def test_of_a_move(tmp_path, capsys):
    found = answered(["optimize", *MOVE, "--duration", "2"], tmp_path, capsys)
    assert found["saving"]["joules"] > 0
    held(found, found["saving"]["joules"])
    assert "kWh" in (tmp_path / "out/report.html").read_text()


def test_of_a_cycle_of_one_move(tmp_path, capsys):
    words = ["tradeoff", *MOVE, "--durations", "1:2:3", "--cycle", "2", "--idle-power", "100"]
    found = answered(words, tmp_path, capsys)
    cycle = found["cycle"]
    saved = cycle["fastest_then_wait"]["energy_total"] - cycle["minimum"]["energy_total"]
    assert saved > 0  # waiting costs more than moving
    held(found, saved)


@pytest.mark.slow
def test_of_a_job_and_of_a_batch(tmp_path, capsys):
    (tmp_path / "job.toml").write_text(JOB)
    found = answered(["job", str(tmp_path / "job.toml"), "--compile", "never"], tmp_path, capsys)
    evenly = next(b["energy_total"] for b in found["baselines"] if b["name"] == "evenly_slowed")
    held(found, evenly - found["energy_total"])

    (tmp_path / "suite.toml").write_text(SUITE)
    words = ["bench", str(tmp_path / "suite.toml"), "--jobs", "1", "--compile", "never"]
    assert main([*words, *YEAR, "--out", str(tmp_path / "batch")]) == 0
    summary = json.loads(capsys.readouterr().out)
    rows = [json.loads(line) for line in (tmp_path / "batch/results.jsonl").read_text().splitlines()[1:]]
    held(summary, sum(r["row"]["energy_scaled"] - r["row"]["energy_total"] for r in rows))


def test_of_a_cell_of_robots(tmp_path, capsys):
    (tmp_path / "cell.toml").write_text(CELL)
    found = answered(["job", str(tmp_path / "cell.toml")], tmp_path, capsys)
    saved = found["levers"][0]["energy_total"] - found["energy_total"]
    assert saved > 0
    held(found, saved)
