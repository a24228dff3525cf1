"""What `diagnose` makes of a recording of a real arm in Universal Robots' columns.

    python benchmarks/recorded.py RECORDING.csv [--robot ur3e] [--out recorded.json]

No model is declared. Printed are the error on the motions held out, before and after, the verdict and the friction of
each joint by its own current, by the power, and by both, with 95 % intervals. A recording of a UR3e is in the artifact
of the RAD paper of DSN 2022 (github.com/ubc-systopia/dsn-2022-rad-artifact, MIT, sheet of figure 9 as CSV).
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

from common import finish

from energy_opt.cli.main import main as command
from energy_opt.files import read_json, write_toml


def main() -> int:
    """Run the benchmark; exit code 1 where the error held out did not fall."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--robot", default="ur3e")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(args.recording, folder / "run.csv")
        log = {"format": "energy-opt/log/1", "robot": args.robot, "run": [{"file": "run.csv", "kind": "motion"}]}
        log |= {"columns": {"preset": "ur_rtde"}, "segment": {"at": "standstill"}}
        write_toml(folder / "log.toml", log)
        if code := command(["diagnose", str(folder), "--out", str(folder / "out")]):
            return code
        document = read_json(folder / "out/diagnosis.json")
    before, after = (document["error"][when]["holdout"]["power_rmse"] for when in ("before", "after"))
    numbers = {"held_out_before": before, "held_out_after": after, "joints": document["joint_side"]}
    return finish(numbers, {f"held out {before:.2f} -> {after:.2f} W": after < before}, args.out)


if __name__ == "__main__":
    sys.exit(main())
