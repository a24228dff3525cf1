"""Count words that docs/glossary.md replaces, in names and in text; fail where a room has more of one than it may.

python .ci/glossary.py            compare with .ci/glossary.toml, which says how many each room still has
python .ci/glossary.py --lower    write the counts of today there, where they are lower
"""

import ast
import re
import sys
import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / ".ci" / "glossary.toml"
# A word of a name, such as `rows` in `held_rows`.
NAMES = ("rows", "ways", "told", "doubt", "eased", "mended", "mends", "made", "begun", "pushed", "sides", "leftover",
         "remainder", "dear", "dearer", "gone", "stands")  # fmt: skip
# In docstrings, comments and pages; some words have a plain meaning, too, and count as names alone.
TEXT = re.compile(
    r"\b(rows|told by|is told|are told|doubt|eased|mended|mends|mending|begun|leftover|remainder|dear|dearer|is gone|"
    r"are gone|stands)\b"
)


def names_in(tree: ast.AST) -> list[str]:
    """Names of functions, classes, arguments, attributes and variables that a file makes."""
    out = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            out.append(node.name)
        elif isinstance(node, ast.arg):
            out.append(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            out.append(node.id)
    return out


def texts_in(source: str, tree: ast.AST) -> list[str]:
    """Docstrings and comments of a file."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docs = [ast.get_docstring(node) or "" for node in ast.walk(tree) if isinstance(node, kinds)]
    return [*docs, *re.findall(r"#.*$", source, re.MULTILINE)]


def counted() -> dict[str, Counter[str]]:
    """How often each room has each word; `docs` are the pages and README."""
    out: dict[str, Counter[str]] = {}
    for file in sorted((ROOT / "energy_opt").rglob("*.py")):
        found = out.setdefault(file.relative_to(ROOT / "energy_opt").parts[0].removesuffix(".py"), Counter())
        source = file.read_text(encoding="utf-8")
        tree = ast.parse(source)
        found.update(part for name in [file.stem, *names_in(tree)] for part in name.lower().split("_") if part in NAMES)
        found.update(word for text in texts_in(source, tree) for word in TEXT.findall(text))
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        out.setdefault("docs", Counter()).update(TEXT.findall(page.read_text(encoding="utf-8")))
    return out


def main(words: list[str]) -> int:
    """Compare, or lower; returns the exit code."""
    found, kept = counted(), tomllib.loads(KEPT.read_text(encoding="utf-8")) if KEPT.is_file() else None
    if "--lower" in words:
        lines = ["# How many words that docs/glossary.md replaces each room still has: they may only become fewer."]
        for room, counts in sorted(found.items()):
            most = {word: min(n, kept.get(room, {}).get(word, 0) if kept else n) for word, n in counts.items()}
            rows = [f'"{word}" = {n}' for word, n in sorted(most.items()) if n]
            lines += ["", f"[{room}]", *rows] if rows else []
        KEPT.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return 0
    more = [
        f"{room}: {word!r} {n} times, at most {most}: see docs/glossary.md"
        for room, counts in sorted(found.items())
        for word, n in sorted(counts.items())
        if n > (most := (kept or {}).get(room, {}).get(word, 0))
    ]
    print("\n".join(more) or f"{sum(sum(c.values()) for c in found.values())} words left that the glossary replaces")
    return 1 if more else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
