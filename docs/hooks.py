"""What the pages take from the program when they are built: effects, options, examples; and formulas as MathML."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable

from latex2mathml.converter import convert

from energy_opt.cli.main import EXAMPLES, example, parsers
from energy_opt.effects import ALL_EFFECTS
from energy_opt.effects.registry import described_effect
from energy_opt.front.verbs import VERBS

CODE = re.compile(r"(```.*?```|`[^`\n]+`)", re.DOTALL)


def effects(_: str) -> str:
    """A section for every effect, written from its class."""
    out = []
    for row in map(described_effect, ALL_EFFECTS):
        out += [f"### `{row['name']}`", "", row["text"], "", f"*{'; '.join(row['traits'])}.*", ""]
        if row["parameters"]:
            out += ["| parameter | unit | neutral | bounds |", "|---|---|---|---|"]
            for p in row["parameters"]:
                bounds = f"{p['lower']:g} … {p['upper']:g}"
                out.append(f"| `{p['name']}` | {p['words']} | {p['neutral']:g} | {bounds} |")
        out += [f"| `{key}` | {' or '.join(words)} | {words[0]} | |" for key, words in row["options"].items()]
        given = [f"{p['name']}=…" for p in row["parameters"]]
        given += [f'{key}="{words[0]}"' for key, words in row["options"].items()]
        out += ["", f"In Python: `eo.effects.{row['class']}({', '.join(given)})`", ""]
    return "\n".join(out)


def options(verb: str) -> str:
    """The table of a verb's options, written from its parser."""
    parser = parsers([verb])[1][verb]
    out = []
    for group in parser._action_groups:
        rows = [a for a in group._group_actions if a.help != argparse.SUPPRESS and "--help" not in a.option_strings]
        if rows:
            title = "" if group.title in ("options", "positional arguments") else f"**{group.title}**"
            out += ["", title, "", "| option | meaning |", "|---|---|"]
            out += [f"| {_words(a)} | {_escaped(a.help or '')} |" for a in rows]
    return "\n".join(out)


def _words(action: argparse.Action) -> str:
    value = action.metavar or (f"{{{','.join(map(str, action.choices))}}}" if action.choices else "")
    value = " ".join(value) if isinstance(value, tuple) else value
    return f"`{' '.join([*action.option_strings[:1], str(value)]).strip()}`".replace("|", "\\|")


def _escaped(text: str) -> str:
    return text.replace("%%", "%").replace("|", "\\|").replace("<", "&lt;")


def all_options(_: str) -> str:
    """The options of every verb."""
    rows = ((name, verb.summary) for name, verb in VERBS.items())
    return "\n\n".join(f"## {name}\n\n{text[0].upper() + text[1:]}.\n\n{options(name)}" for name, text in rows)


def shown(kind: str) -> str:
    """An example file, as `--example` prints it."""
    return f"```{'yaml' if kind in ('limits', 'scene') else 'toml'}\n{example(kind)}```"


MARKS: dict[str, Callable[[str], str]] = {
    "effects": effects,
    "options": options,
    "all-options": all_options,
    "example": shown,
}


_written: list[str] = []  # formulas as MathML; `@formula-7@` stands for the eighth until the page is HTML


def on_page_markdown(markdown: str, **_: object) -> str:
    """Fill in `<!-- MARK WORD -->` lines, then take $…$ and $$…$$ outside of code for formulas."""

    def filled(found: re.Match[str]) -> str:
        return MARKS[found[1]](found[2] or "")

    text = re.sub(r"^<!-- ([a-z-]+)(?: ([a-z-]+))? -->$", filled, markdown, flags=re.MULTILINE)
    parts = CODE.split(text)
    parts[::2] = [_formulas(part) for part in parts[::2]]
    return "".join(parts)


def _formulas(text: str) -> str:
    def formula(found: re.Match[str]) -> str:
        block = found[1] is not None
        latex = found[1] if block else found[2]
        _written.append(convert(" ".join(latex.split()), display="block" if block else "inline"))
        return f"@formula-{len(_written) - 1}@"

    return re.sub(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", formula, text, flags=re.DOTALL)


def on_page_content(html: str, **_: object) -> str:
    """Formulas in their places."""
    return re.sub(r"@formula-(\d+)@", lambda found: _written[int(found[1])], html)


def on_config(config: object) -> None:
    """A page whose marks name what is not there must not be built."""
    assert set(EXAMPLES) >= {"model", "log", "suite", "limits"}
