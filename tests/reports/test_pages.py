"""Every verb's page in a real browser: all is drawn, nothing is said or asked for, nothing too wide; it plays."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from browser import CHROMIUM, Browser

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene
from energy_opt.cli.main import example, main
from energy_opt.reports.charts import MOST_POINTS, Block, Chart, Line
from energy_opt.reports.motion import Closest, Played, player
from energy_opt.reports.page import Report
from energy_opt.robot import Robot

LARGEST = 6e6  # [byte] of a page
WIDTHS = (400, 1280)  # [px]
START, GOAL = "0,-0.785,0,-2.356,0,1.571,0.785", "0.6,-0.3,0.2,-1.8,0.2,1.9,0.4"
PLANNED = ["--robot", "panda", "--start", START, "--goal", GOAL, "--compile", "never", "--model", "source-method-2"]
SUITE = """
format = "energy-opt/suite/1"
name = "small"
robots = ["panda"]
modes = ["retime"]
durations = ["1.5x"]
models = ["source_method_2"]
random = { count = 1, seed = 1, range = 0.3 }
"""
JOB = f"""
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 4.0
home = [{START}]
mode = "retime"
[[step]]
name = "there"
to = [{GOAL}]
[[step]]
wait = 0.4
[[step]]
name = "back"
to = "home"
"""
PLANT = """
format = "energy-opt/model/1"
robot = "panda"
[[effect]]
name = "standby"
power = 90.0
[[effect]]
name = "copper_loss"
r_over_kt2 = 0.004
[[effect]]
name = "viscous_friction"
b = 1.5
"""
# Verb -> plots on its page (None: as many as there are joints and runs), and whether an arm moves there.
PAGES = {
    "optimize": (8, True), "tradeoff": (3, True), "job": (7, True), "bench": (2, False),
    "identify": (1, False), "diagnose": (None, False),
}  # fmt: skip


def _report(robot: Robot) -> Report:
    t = np.linspace(0, 2, 4000)
    q = np.sin(t)[:, None] * np.linspace(0.2, 1, robot.n)
    motion = SimpleNamespace(time=t, position=q)
    cell = Cell(robot, CellRequest(floor=-0.05), Scene(()))
    report = Report("<b>x</b> $\\frac$")
    played = [Played("result", motion), Played("scaled", motion, ghost=True)]
    closest = Closest(("a", "b"), 0.003, 1.0)
    report.player(player(robot, played, cell, closest, [(0.5, "</script>")]))
    lines = [Line(joint, t, q[:, j]) for j, joint in enumerate(robot.joints)]
    report.charts(
        Chart("Position", "time [s]", "position [rad]", lines, {"limit": 1.0}, timed=True),
        Chart(
            "Bars", "energy [J]", "", bars={"result": {"copper </script>": 1.0}, "scaled": {"copper </script>": 2.0}}
        ),
        Chart("Spread", "loss saved [%]", "", spread={"panda": np.array([1.0, 2.0, 4.0])}),
        Chart("Blocks", "time [s]", "", blocks=[Block("a", "</script>", 0.5, 1.0, "moves")], timed=True),
        Chart("Waterfall", "", "energy [J]", waterfall=[("as is", 1000.0), ("speeds", 900.0), ("modes", 600.0)]),
        Chart("Nothing", "", ""),
    )
    return report.table(["a", "b"], [["x" * 300, 1.0]])


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of each verb, as the command writes it."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    at = tmp_path_factory.mktemp("pages")
    for name, text in (("suite", SUITE), ("job", JOB), ("plant", PLANT)):
        (at / f"{name}.toml").write_text(text)
    (at / "scene.yaml").write_text(example("scene"))
    reshape = ["--duration", "1.5", "--starts", "1", "--controls", "12", "--scene", str(at / "scene.yaml")]
    plays = [str(at / name / "trajectory.csv") for name in ("retime", "optimize")]
    for name, words in {
        "optimize": ["optimize", *PLANNED, *reshape],
        "retime": ["optimize", *PLANNED, "--mode", "retime", "--duration", "2"],
        "tradeoff": ["tradeoff", *PLANNED, "--mode", "retime", "--durations", "1:2:2", "--cycle", "4"],
        "bench": ["bench", str(at / "suite.toml"), "--jobs", "1", "--compile", "never"],
        "job": ["job", str(at / "job.toml"), "--compile", "never", "--model", "source-method-2"],
        "set": ["simulate", *plays, "--plant", str(at / "plant.toml"), "--repeat", "3", "--static", "1"],
        "identify": ["identify", str(at / "set")],
        "diagnose": ["diagnose", str(at / "set")],
    }.items():
        assert main([*words, "--out", str(at / name), "--quiet"]) == 0, name
    return at


@pytest.mark.slow
@pytest.mark.parametrize("verb", PAGES)
def test_every_verbs_page_in_a_browser(browser: Browser, pages: Path, verb: str) -> None:
    page, (plots, moving) = pages / verb / "report.html", PAGES[verb]
    if verb == "optimize":  # one plot more where the search found better answers on its way
        plots += len(json.loads((page.parent / "result.json").read_text()).get("progress", ())) > 1
    assert page.stat().st_size < LARGEST
    browser.view(WIDTHS[-1])
    browser.open(page)
    assert browser.run("document.body.dataset.ready") == "yes"
    places, drawn = browser.run(
        "['.chart', '.plot[data-drawn] .main-svg'].map(c => document.querySelectorAll(c).length)"
    )
    assert places >= 2 if plots is None else places == plots, (verb, places)
    assert drawn >= places and browser.run("[...document.querySelectorAll('.plot')].every(p => p.clientHeight > 100)")
    assert browser.run("document.querySelector('canvas[data-drawn]') !== null") is moving
    assert "energy-opt " in browser.run("document.querySelector('pre').textContent")  # the command
    colours: list[str] = []
    for width, dark in zip(WIDTHS[::-1], (False, True), strict=True):
        browser.view(width, dark)
        wide = "[...document.querySelectorAll('.plot svg, canvas, button')].filter(e => e.getBoundingClientRect()"
        browser.until(f"{wide}.right > {width} + 1).length === 0")  # plots follow the window's width
        assert browser.run("document.documentElement.scrollWidth") <= width
        ink, paper = "document.querySelector('.plot .xtitle')).fill", "document.body).backgroundColor"
        colours += [browser.run(f"getComputedStyle({part}") for part in (ink, paper)]
    assert len(set(colours)) == 4  # ink and paper, light and dark
    cells = browser.run("[...document.querySelectorAll('table')].map(t => [...t.rows].map(r => r.cells.length))")
    assert all(len(set(rows)) == 1 and len(rows) > 0 for rows in cells)
    titles = browser.run("[...document.querySelectorAll('.xtitle')].map(t => t.textContent)")
    assert titles and all(re.search(r"\[.+\]$", title) for title in titles)  # each with its unit
    assert (
        browser.said == [] and [url for url in browser.asked if not url.startswith(("file:", "data:", "blob:"))] == []
    )


@pytest.mark.slow
def test_plots_and_arm_are_tied_and_play(browser: Browser, pages: Path) -> None:
    browser.view(WIDTHS[-1])
    browser.open(pages / "optimize" / "report.html")
    time, arm = "Number.parseFloat(document.querySelector('.time').textContent)", "document.querySelector('canvas')"
    shown = f"{arm}.toDataURL()"
    cursor = "Number.parseFloat(document.querySelector('.cursor').style.left)"
    at_rest, place = browser.run(shown), browser.run(cursor)
    assert browser.run(time) == 0
    browser.run("document.querySelector('.player button').click()")  # play
    browser.until(f"{time} > 0.2")
    assert browser.run(shown) != at_rest and browser.run(cursor) > place
    browser.until(f"{time} >= 1.5 && document.querySelector('.player button').textContent === 'play'")  # to the end
    browser.run("document.querySelector('.closest').click()")
    closest, held = browser.run(time), browser.run("document.querySelector('.closest').textContent")
    assert 0 <= closest <= 1.5 and " mm" in held
    browser.run("document.querySelector('.plot').scrollIntoView({block: 'center'})")
    box = browser.run(
        "(b => [b.x, b.y, b.width, b.height])(document.querySelector('.plot .nsewdrag').getBoundingClientRect())"
    )
    for share in (0.25, 0.75):  # the pointer goes over the plot, and the arm follows
        before = browser.run(shown)
        for step in range(4):
            browser.mouse("mouseMoved", box[0] + box[2] * share + step, box[1] + box[3] / 2)
        browser.until(f"Math.abs({time} - {1.5 * share}) < 0.05")
        assert browser.run(shown) != before
    browser.mouse("mouseMoved", 2, 2)
    sleep(0.5)  # for what the plot still has to say of the pointer
    slider = "document.querySelector('.player input[type=range]')"
    browser.run(f"{slider}.value = 0.5; {slider}.dispatchEvent(new Event('input'))")
    assert browser.run(time) == pytest.approx(0.5, abs=2e-3) and browser.said == []


def test_a_page_of_odd_texts_draws_everything(panda: Robot, tmp_path: Path, browser: Browser) -> None:
    page = tmp_path / "report.html"
    _report(panda).write(page)
    browser.view(400, dark=True)
    browser.open(page)
    assert browser.run("document.body.dataset.ready") == "yes"
    assert browser.run("document.querySelectorAll('.plot[data-drawn]').length") == 5
    assert browser.run("document.querySelector('canvas[data-drawn]') !== null")
    assert browser.said == []


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


def test_a_robot_without_bodies_has_no_player(panda: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("energy_opt.reports.motion.own_body", lambda robot: None)
    assert player(panda, []) is None
