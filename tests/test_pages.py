"""Pages in a real browser: every plot drawn, no word on the console, nothing asked of a network, nothing too wide."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.reports.charts import MOST_POINTS, Chart, Line
from energy_opt.reports.motion import Played, Solid, player
from energy_opt.reports.page import Report
from energy_opt.robot import Robot

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
LARGEST = 6e6  # [byte] of a page
TETRAHEDRON = (
    np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.2]]),
    np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]),
)


def _report(robot: Robot) -> Report:
    t = np.linspace(0, 2, 4000)
    q = np.sin(t)[:, None] * np.linspace(0.2, 1, robot.n)
    motion = SimpleNamespace(time=t, position=q)
    solids = [Solid(j, *TETRAHEDRON) for j in range(-1, robot.n)]
    report = Report("<b>x</b> $\\frac$")
    played = [Played("result", motion), Played("scaled", motion, ghost=True)]
    report.player(player(robot, played, solids, [Solid(-1, *TETRAHEDRON)], ("closest: a and b, 3 mm", 1.0)))
    lines = [Line(joint, t, q[:, j]) for j, joint in enumerate(robot.joints)]
    report.charts(
        Chart("Position", "time [s]", "position [rad]", lines, {"limit": 1.0}, timed=True),
        Chart(
            "Bars", "energy [J]", "", bars={"result": {"copper </script>": 1.0}, "scaled": {"copper </script>": 2.0}}
        ),
        Chart("Spread", "loss saved [%]", "", spread={"panda": np.array([1.0, 2.0, 4.0])}),
        Chart("Nothing", "", ""),
    )
    return report.table(["a", "b"], [["x" * 300, 1.0]])


def _seen(page: Path, profile: Path) -> tuple[str, str]:
    """The document after its scripts ran, and what the browser said."""
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"]
    command += [f"--user-data-dir={profile}", "--virtual-time-budget=20000", "--window-size=800,900", "--dump-dom"]
    done = subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, done.stderr


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
def test_a_page_draws_everything_in_a_browser(panda: Robot, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    _report(panda).write(page)
    document, said = _seen(page, tmp_path / "profile")
    assert 'data-ready="yes"' in document
    assert document.count('<div class="plot js-plotly-plot" data-drawn="yes"') == 3
    assert re.search(r"<canvas[^>]*data-drawn=\"yes\"", document)
    lines = [line for line in said.splitlines() if "GL Driver Message" not in line]  # of the software renderer
    assert not [line for line in lines if "CONSOLE" in line or "net::" in line]


def test_a_page_is_small_and_asks_for_nothing(panda: Robot, tmp_path: Path) -> None:
    text = _report(panda).html()
    assert len(text) < LARGEST
    assert not re.search(r"(src|href)\s*=", text.split("held-data")[0])
    assert "<b>x</b>" not in text
    assert not re.search(r"https?://", re.sub(r'<script type="application/gzip".*?</script>', "", text))


def test_long_lines_are_thinned_between_their_ends() -> None:
    x = np.arange(10_000.0)
    line = Chart("", "", "", [Line("a", x, x)]).data()["lines"][0]
    assert len(line["x"]) <= MOST_POINTS and (line["x"][0], line["x"][-1]) == (0.0, 9999.0)


def test_a_robot_without_bodies_has_no_player(panda: Robot) -> None:
    assert player(panda, [], []) is None
