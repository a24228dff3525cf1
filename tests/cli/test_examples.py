"""Files that `--example` prints are read back by the readers that users' files meet; effects describe themselves."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest

from energy_opt.batches.suite import load_suite
from energy_opt.cell.scene_files import read_scene
from energy_opt.cli.main import EXAMPLES, VERBS, main, parsers
from energy_opt.effects import ALL_EFFECTS
from energy_opt.errors import BadInput
from energy_opt.jobs.file import load_job
from energy_opt.measured import inspect_set, read_set
from energy_opt.power import load_model
from energy_opt.robot import load_robot
from energy_opt.tables import write_table


def log(path):
    """The log with two runs beside it, one in motion and one at rest."""
    for number, size in ((1, 0.3), (2, 0.0)):
        time = np.arange(0, 12, 0.02)
        names = [f"{joint}.position" for joint in load_robot("z1").joints]
        swing = [size * (1 - np.cos(time * (0.7 + 0.1 * k))) for k in range(6)]
        swing[1], swing[2] = swing[1] + 0.5, swing[2] - 0.9
        write_table(
            path.parent / f"run0{number}.csv",
            ["time", *names, "power"],
            [time, *swing, 40 + swing[0] + np.sin(99 * time)],
        )
    assert inspect_set(path.parent)[0] == [] and len(read_set(path.parent).runs) == 2


def suite(path):
    """Two random moves, and one at two durations."""
    assert [task.timing.label for task in load_suite(path).tasks] == ["2", "3", "1.5x", "1.5x"]


def limits(path):
    """Only what the file says is changed."""
    found, before = load_robot("panda", limits=path).limits, load_robot("panda").limits
    assert found.velocity[[0, 3]].tolist() == [1.5, 1.2] and found.velocity[1] == before.velocity[1]


READERS = {
    "model": ("m.toml", lambda path: load_model(path).check(7)),
    "log": ("log.toml", log),
    "suite": ("s.toml", suite),
    "limits": ("joint_limits.yaml", limits),
    "scene": ("s.yaml", read_scene),
    "job": ("j.toml", lambda path: load_job(path, load_robot)),
}


@pytest.mark.parametrize("kind", EXAMPLES)
def test_an_example_is_read_back(kind, tmp_path, capsys):
    assert main(["--example", kind]) == 0
    name, reader = READERS[kind]
    (tmp_path / name).write_text(capsys.readouterr().out)
    reader(tmp_path / name)
    if kind not in ("scene", "job"):
        assert main(["check", str(tmp_path / name), "--robot", "panda", "--quiet"]) == 0


def test_the_example_of_a_job_shows_a_step_for_place(tmp_path, capsys):
    assert main(["--example", "job"]) == 0
    job = capsys.readouterr().out.replace('to = "part"\n# pose', "pose")
    (tmp_path / "pick.toml").write_text(job)
    found = load_job(tmp_path / "pick.toml", load_robot)
    assert [found.steps[k].name for k in found.open] == ["to the part"]


def test_faults_of_what_is_printed(capsys):
    assert main(["--example", "modle"]) == 2 and "did you mean 'model'" in capsys.readouterr().err
    assert main(["bench", "--example", "suite"]) == 2
    assert "is used without a verb: energy-opt --example KIND" in capsys.readouterr().err
    assert main(["--print-completion", "fish"]) == 2 and "bash, zsh, tcsh" in capsys.readouterr().err


def test_completion_of_the_shell_knows_verbs_and_options(capsys):
    assert main(["--print-completion", "bash"]) == 0
    script = capsys.readouterr().out
    assert "--max-duration" in script and "diagnose" in script
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)


def test_effects_are_listed_with_units_and_laws(capsys):
    assert main(["effects"]) == 0
    text = capsys.readouterr().out
    assert all(f"{kind.name}\n" in text for kind in ALL_EFFECTS) and "tau_c * sign(v)" in text
    assert main(["effects", "regeneration", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["effects"]
    assert row["options"] == {"level": ["bus", "joint"]} and row["parameters"][0]["unit"] == "1"
    assert main(["effects", "regenration"]) == 2 and "did you mean 'regeneration'" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.name)
def test_every_effect_says_what_it_is(kind):
    from energy_opt.effects.registry import described_effect

    row = described_effect(kind)
    assert len(row["law"]) > 20 and row["traits"] and all(p["unit"] for p in row["parameters"])
    with pytest.raises(BadInput):
        kind(nonsense=1)


def test_every_option_says_what_it_is():
    _, verbs = parsers(list(VERBS))
    for verb, parser in verbs.items():
        for action in parser._actions:
            assert action.help, f"{verb} {action.option_strings or action.dest}"
