"""Figures and reports: what is drawn, what is escaped, and that a file is whole."""

from __future__ import annotations

import html.parser
from pathlib import Path

import numpy as np
import pytest

from energy_opt.reports import plots
from energy_opt.reports.page import Report, shown

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


def test_move_figure_shows_what_it_is_given(tmp_path: Path) -> None:
    t = np.linspace(0, 2, 50)
    velocity = np.column_stack([np.sin(t), np.cos(t)])
    figure = plots.plot_move(
        t,
        velocity,
        3 * velocity,
        100 + velocity[:, 0],
        joints=["a", "b"],
        velocity_limit=np.array([2.0, 4.0]),
        effort_limit=np.array([6.0, np.inf]),
        baseline=plots.Curve("scaled", t, 110 + 0 * t),
        by_effect={
            "result": {"standby": 176.0, "copper_loss": 12.0},
            "scaled": {"standby": 176.0, "copper_loss": 20.0},
        },
    )
    speed, torque, power, energy = figure.axes
    np.testing.assert_allclose(speed.lines[1].get_ydata(), np.cos(t) / 4)
    assert [line.get_label() for line in torque.lines if not line.get_label().startswith("_")] == [
        "a"
    ]  # b has no limit
    assert [line.get_label() for line in power.lines] == ["result", "scaled"]
    assert sorted(bar.get_width() for bar in energy.patches) == [12.0, 20.0, 176.0, 176.0]
    plots.save(figure, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(PNG)


def test_tradeoff_figure_adds_its_parts_up() -> None:
    duration = np.linspace(1, 4, 7)
    parts = {"standby": 88 * duration, "loss": 40 / duration**3, "stored": np.full(7, -5.0)}
    figure = plots.plot_tradeoff(duration, parts, {"minimum energy": (1.2, 130.0)}, fastest=1.0)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    np.testing.assert_allclose(lines["total"].get_ydata(), parts["standby"] + parts["loss"] - 5)
    assert set(lines) == {"total", "minimum energy", "fastest"}
    assert plots.png(figure).startswith(PNG)
