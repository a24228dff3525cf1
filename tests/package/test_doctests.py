"""The examples in the package's docstrings, run on the package that is installed, not on a folder beside the tests."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import energy_opt

ROOT = Path(energy_opt.__file__).parent


def with_examples() -> list[str]:
    """Names of the modules that show examples."""
    files = [file for file in ROOT.rglob("*.py") if ">>>" in file.read_text(encoding="utf-8")]
    names = (".".join(file.relative_to(ROOT.parent).with_suffix("").parts) for file in files)
    return sorted(name.removesuffix(".__init__") for name in names)


@pytest.mark.parametrize("name", with_examples())
def test_examples(name: str) -> None:
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted and not found.failed
