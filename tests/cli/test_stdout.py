"""With --json, standard output holds one document, whatever users' files print."""

import json
import os
import subprocess
import sys
from pathlib import Path

from poses import START

EFFECT = """
import os
print("read")
os.write(1, b"written to the descriptor\\n")
from energy_opt.effects import Standby
class Fan(Standby):
    \"\"\"Constant power of a fan.\"\"\"
    name = "fan"
"""
CONDITION = """
print("read")
from energy_opt.conditions import MaxPower
conditions = [MaxPower(500)]
"""


def test_what_users_files_print_goes_to_standard_error(tmp_path: Path) -> None:
    effects, conditions = tmp_path / "fan.py", tmp_path / "own.py"
    effects.write_text(EFFECT)
    conditions.write_text(CONDITION)
    at = ",".join(map(str, START))
    words = ["optimize", "--robot", "panda", f"--start={at}", f"--goal={at}", "--duration", "1", "--json"]
    words += ["--model", "source-method-2", "--self-collision", "off"]
    words += ["--effects", str(effects), "--conditions", str(conditions), "--out", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-m", "energy_opt", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "solved"
    assert "read" in done.stderr and "written to the descriptor" in done.stderr


def test_a_terminal_without_some_characters_gets_escapes() -> None:
    """In such a locale, a list of robots was refused as text that cannot be encoded."""
    words = [sys.executable, "-m", "energy_opt", "robots", "z1"]
    for encoding in ("ascii", "latin-1"):
        done = subprocess.run(words, capture_output=True, check=False, env=os.environ | {"PYTHONIOENCODING": encoding})
        assert done.returncode == 0 and rb"-2.618 \u2026 2.618 rad" in done.stdout


def test_matplotlib_does_not_report_a_home_that_cannot_be_written() -> None:
    code = "from energy_opt.cli.main import main; main(['effects', 'standby']); import energy_opt.reports.plots"
    home = dict.fromkeys(("HOME", "MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"), "/proc/none")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **home})
    assert (done.returncode, done.stderr) == (0, "")
