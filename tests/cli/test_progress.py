"""What is said while work goes on: on a terminal and with -v only, with the time left; and the report that opens."""

from __future__ import annotations

import io
import logging
import time
import webbrowser
from pathlib import Path

import pytest

from energy_opt.cli import faults, terminal
from energy_opt.cli.terminal import Progress

LOG = logging.getLogger("energy_opt.somewhere")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "PATIENCE", 0.0)
    monkeypatch.setattr(terminal, "TICK", 0.02)


def _said(stream: io.StringIO, **options: bool) -> str:
    with Progress(**{"quiet": False, "verbose": False, **options}, stream=stream) as show:
        LOG.info("compiling", extra={"expected": 30.0})
        time.sleep(0.1)
        show("leg 1", 0.25)
        LOG.info("start %d", 3, extra={"share": 0.9})
        time.sleep(0.1)
    return stream.getvalue()


def test_a_terminal_shows_the_task_and_the_time_left() -> None:
    said = _said(Terminal())
    assert "about 30 s left | compiling" in said and "leg 1: start 3" in said
    assert said.endswith("\r" + " " * terminal.WIDTH + "\r") and "\n" not in said  # the line is gone in the end
    assert LOG.parent is not None and not LOG.parent.handlers


def test_the_time_left_follows_from_the_share_of_work() -> None:
    shown = Progress(False, False, Terminal())
    shown("half", 0.25)
    begin = time.monotonic()
    assert shown.left(begin + 10.0) == pytest.approx(30.0, abs=1.0)
    shown("unknown")
    assert shown.left(begin + 10.0) is None


def test_elsewhere_there_is_nothing_but_with_v() -> None:
    assert _said(io.StringIO()) == "" == _said(Terminal(), quiet=True)
    lines = _said(io.StringIO(), verbose=True).splitlines()
    assert [line.split("] ")[1] for line in lines] == ["compiling", "leg 1", "  start 3"]


def test_the_report_opens_where_there_is_a_display(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    (tmp_path / "report.html").write_text("")
    monkeypatch.setattr(faults, "has_display", lambda: False)
    faults.view(tmp_path)
    assert not opened and str(tmp_path / "report.html") in capsys.readouterr().err
    monkeypatch.setattr(faults, "has_display", lambda: True)
    faults.view(tmp_path)
    assert opened == [(tmp_path / "report.html").resolve().as_uri()]


def test_a_stage_maps_the_shares_of_its_parts() -> None:
    terminal = Terminal()
    with Progress(False, False, terminal) as show:
        show.stage("reading", 0.2, 0.6)
        LOG.info("file 2 of 4", extra={"share": 0.5})
        assert show.left(show._begin + 4.0) == pytest.approx(4.0 * 0.6 / 0.4)
        time.sleep(0.1)
    assert "reading: file 2 of 4" in terminal.getvalue()
