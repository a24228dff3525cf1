"""Recorded sets of other virtual arms, replayed on this one: its power must be the recorded power, up to noise."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from virtual_sets import arm

from energy_opt.power.model import model_from_document
from energy_opt.tables import read_table
from energy_opt.virtual_arm.plant import Plant, special_from_row
from energy_opt.virtual_arm.simulate import Reference, play

pytest.importorskip("mujoco")

from energy_opt.virtual_arm.mujoco_arm import MujocoArm

SETS = Path(__file__).resolve().parents[3] / "shared" / "data" / "virtual_sets"
STEP = 4e-3  # [s]


@pytest.mark.skipif(not SETS.is_dir(), reason="the recorded sets are not here")
@pytest.mark.parametrize("name", ["clean_panda", "coulomb_panda", "cogging_panda", "payload_ur5"])
def test_a_recorded_set_is_reproduced(name: str) -> None:
    from scipy.signal import savgol_filter

    folder = SETS / name
    truth, declared, log = (tomllib.loads((folder / f"{f}.toml").read_text()) for f in ("truth", "declared", "log"))
    declared["effect"] += truth["effect"]
    specials = tuple(special_from_row(row, name) for row in truth.get("special", []))
    plant, robot = Plant(model_from_document(declared, name), specials), arm(truth["robot"])
    virtual = MujocoArm(robot, plant)
    for entry in [e for e in log["run"] if e["kind"] == "motion"][1:9:2]:
        table = read_table(folder / entry["file"])
        time = np.arange(0, table["time"][-1], STEP)
        raw = np.column_stack([np.interp(time, table["time"], table[f"{j}.position"]) for j in robot.joints])
        position = savgol_filter(raw, 31, 4, axis=0)
        velocity = savgol_filter(position, 15, 4, deriv=1, delta=STEP, axis=0)
        run = play(virtual, plant, Reference("again", time, position, velocity), start=entry.get("start", 0.0))
        meter = read_table(folder / entry["power_file"]) if "power_file" in entry else table
        inside = (meter["time"] > 0.1) & (meter["time"] < time[-1] - 0.1)
        gap = (meter["power"] - np.interp(meter["time"], run.played.time, run.power))[inside]
        assert np.sqrt(np.mean(gap**2)) < 1.25 * truth["noise_floor"]
        assert abs(gap.mean()) < 4 * truth["noise_floor"] / np.sqrt(len(gap)) + 0.05
