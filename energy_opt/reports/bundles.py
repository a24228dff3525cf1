"""Scripts that pages carry inside them, taken from the pip packages that ship them when a page is written.

plotly's bundle draws plots, three.js (as trimesh's notebook viewer carries it) the moving arm; both are MIT-licensed
and keep their notices. They are packed with gzip, which every browser since 2023 unpacks by itself, so that a page
stays below 3 MB.
"""

from __future__ import annotations

import base64
import gzip
import importlib.util
import io
import re
import zipfile
from functools import cache
from pathlib import Path

from energy_opt.errors import BadInput

LEVEL = 5  # of gzip: 6 takes a third longer and saves 0.7 % of a page
ASSETS = Path(__file__).parent / "assets"


def packed(text: str | bytes) -> str:
    """Text as base64 of its gzip; the same bytes for the same text."""
    data = text.encode() if isinstance(text, str) else text
    return base64.b64encode(gzip.compress(data, LEVEL, mtime=0)).decode("ascii")


def asset(name: str) -> str:
    """One of the package's own scripts or styles."""
    return (ASSETS / name).read_text(encoding="utf-8")


@cache
def plotly() -> str:
    """plotly.js, packed."""
    return packed((_folder("plotly") / "package_data" / "plotly.min.js").read_bytes())


@cache
def three() -> str:
    """three.js, packed: what is in trimesh's viewer page before that page's own few lines."""
    archive = (_folder("trimesh") / "resources" / "templates" / "viewer.zip").read_bytes()
    with zipfile.ZipFile(io.BytesIO(archive)) as file:
        page = file.read("viewer.html.template").decode("utf-8")
    script = max(re.findall(r"<script[^>]*>(.*?)</script>", page, flags=re.DOTALL), key=len)
    library, found, _ = script.partition("var camera,controls")
    if not found:
        raise BadInput("trimesh: its viewer page is not the one that is known; install trimesh 4")
    return packed(library)


def _folder(package: str) -> Path:
    """Where a package lies, without importing it."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise BadInput(f"reports need {package}: pip install {package}")
    return Path(next(iter(spec.submodule_search_locations)))
