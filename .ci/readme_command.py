"""Print block N of README's commands, for CI to run what README shows to the letter: readme_command.py README.md N."""

import re
import sys
from pathlib import Path


def commands(text: str) -> list[str]:
    """The content of every fenced `sh` block, in order."""
    return [block.strip() for block in re.findall(r"^```sh\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)]


if __name__ == "__main__":
    found, wanted = commands(Path(sys.argv[1]).read_text(encoding="utf-8")), int(sys.argv[2])
    if not 1 <= wanted <= len(found):
        raise SystemExit(f"{sys.argv[1]} has {len(found)} blocks of commands; number {wanted} is not among them")
    print(found[wanted - 1])
