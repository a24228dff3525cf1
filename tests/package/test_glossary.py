"""Names and pages use the terms of docs/glossary.md: words that it replaces may only become fewer."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / ".ci" / "glossary.py"


def test_no_room_uses_more_words_of_our_own_than_it_did() -> None:
    done = subprocess.run([sys.executable, str(SCRIPT)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
