"""Print the first shell command of README that starts a given program, so that CI runs what README shows."""

import re
import sys
from pathlib import Path


def first_command(text: str, program: str) -> str:
    """The first command in a code block (fenced or indented) with `program` in it, from there to its end."""
    joined = re.sub(r"\\\n\s*", " ", text)
    for line in joined.splitlines():
        found = re.search(rf"(?:^\s*\$?\s*|&&\s*)({re.escape(program)}\s.*)$", line)
        if found:
            return found.group(1).strip()
    raise SystemExit(f"README shows no command {program!r}")


if __name__ == "__main__":
    print(first_command(Path(sys.argv[1]).read_text(encoding="utf-8"), sys.argv[2]))
