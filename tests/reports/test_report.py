"""Figures and reports: what is drawn, what is escaped, and that a file is whole."""

from __future__ import annotations

import html.parser
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.reports import plots
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.motion import drawn
from energy_opt.reports.page import Report, shown
from energy_opt.robot import load_robot

PNG = b"\x89PNG\r\n\x1a\n"


class _Balanced(html.parser.HTMLParser):
    """Fails where tags do not close in order; collects what would load something from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        self.outside += [v for k, v in attrs if k in ("src", "href") and v and not v.startswith("data:")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_report_is_well_formed_self_contained_and_escaped(tmp_path: Path) -> None:
    evil = "<script>alert('x')</script>"
    report = Report(evil).section(evil).text(evil).warning(evil).code(evil).facts({evil: evil})
    report.table([evil, "J"], [[evil, 1.0], ["b", None]]).picture(PNG, evil)
    report.write(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    parser = _Balanced()
    parser.feed(text)
    assert parser.open == [] and parser.outside == []
    assert "<script" not in text and text.count("&lt;script&gt;") >= 10


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.23456789, "1.235"),
        (np.float64(1e-9), "1e-09"),
        (float("nan"), "-"),
        (None, "-"),
        (True, "yes"),
        (np.int64(12345678), "12345678"),
        ([1.0, None, "a"], "1, -, a"),
    ],
)
def test_shown(value: object, text: str) -> None:
    assert shown(value) == text


def test_figure_shows_the_charts_of_a_page(tmp_path: Path) -> None:
    t = np.linspace(0, 2, 50)
    bounds = {"limit": 1.0, "-limit": -1.0}
    powers = [Line("scaled", t, 110 + 0 * t), Line("result", t, 100 + np.sin(t), "dash")]
    energies = {"result": {"standby": 176.0, "copper_loss": 12.0}, "scaled": {"standby": 176.0, "copper_loss": 20.0}}
    shares = [Line("a", t, np.sin(t)), Line("b", t, np.cos(t) / 4)]
    charts = [
        Chart("Velocity", "time [s]", "velocity / limit [1]", shares, bounds),
        Chart("Torque", "time [s]", "torque / limit [1]", [Line("a", t, np.sin(t) / 2)], bounds),
        Chart("Power", "time [s]", "power [W]", powers, marks={"peak": (1.5, 101.0)}, edges={"fastest": 0.5}),
        Chart("Energy by effect", "energy [J]", "", bars=energies),
    ]  # fmt: skip
    figure = plots.draw(charts, "a move")
    speed, torque, power, energy = figure.axes
    np.testing.assert_allclose(speed.lines[1].get_ydata(), np.cos(t) / 4)
    assert [line.get_ydata()[0] for line in torque.lines[1:]] == [1.0, -1.0]
    assert [line.get_label() for line in power.lines] == ["scaled", "result", "fastest", "peak"]
    assert sorted(bar.get_width() for bar in energy.patches) == [12.0, 20.0, 176.0, 176.0]
    bar = next(bar for bar in energy.patches if bar.get_width() == 12.0)
    assert to_rgba(power.lines[1].get_color()) == bar.get_facecolor()  # of the result in both
    plots.save(figure, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(PNG)


def test_a_name_that_the_font_lacks_is_drawn_without_a_warning() -> None:
    """matplotlib's warning was printed on stderr, whatever --quiet said."""
    t = np.linspace(0, 2, 5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert plots.png(plots.draw([Chart("肘", "time [s]", "肘 [rad]", [Line("肘", t, t)])], "肘")).startswith(PNG)


def test_a_page_writes_the_charts_that_are_pictured(tmp_path: Path) -> None:
    t = np.linspace(0, 2, 5)
    plain = Chart("Power", "time [s]", "power [W]", [Line("result", t, t)])
    report = Report("A move").charts(plain)
    report.write(tmp_path / "report.html", tmp_path / "plot.png")
    assert not (tmp_path / "plot.png").exists()
    report.charts(replace(plain, pictured=True)).write(tmp_path / "report.html")
    assert not (tmp_path / "plot.png").exists()
    report.write(tmp_path / "report.html", tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(PNG)


# An arm of one body.
ARM = """<robot name="arm"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="1 0 0"/><geometry><{}/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
<limit lower="-3" upper="3" velocity="2" effort="100"/></joint></robot>"""


@pytest.mark.parametrize("shape", ['sphere radius="0"', 'capsule radius="0" length="0.2"', 'box size="0.1 0 0"'])
def test_bodies_without_volume_are_drawn(tmp_path: Path, shape: str) -> None:
    """Descriptions in use mark points by spheres of radius 0; a plan was lost where its picture could not have them."""
    (tmp_path / "arm.urdf").write_text(ARM.format(shape))
    (arm,), scene = drawn(Cell(load_robot(tmp_path / "arm.urdf"), CellRequest()))
    assert scene == [] and arm.name == "arm"


def test_thousands_of_balls_are_drawn_coarsely(tmp_path: Path) -> None:
    """Each had its 200 points: the page of a scene of 5,000 took 29 of a plan's 40 seconds, and 13 MB."""
    (tmp_path / "arm.urdf").write_text(ARM.format('sphere radius="0.1"'))
    balls = tuple(SceneObject(str(k), (Shape("sphere", (0.01,)),)) for k in range(1000))
    few, many = (
        drawn(Cell(load_robot(tmp_path / "arm.urdf"), CellRequest(), Scene(balls[:count])))[1] for count in (2, 1000)
    )
    assert len(few) == 2 and len(many) == 1000
    assert sum(len(ball.vertices) for ball in many) <= 20_000 and len(few[0].vertices) >= 100
