"""An arm that runs URScript programs: what it is sent, when, and how long it all takes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np


class Controller:
    """Runs a URScript program: the language is Python's but for `local`, `end`, `halt`, and lists that are copied."""

    def __init__(self, at: np.ndarray, step: float = 0.002) -> None:
        self.at, self.step, self.time = at, step, 0.0
        self.sent: list[tuple[float, np.ndarray]] = []
        self.targets: list[tuple[float, np.ndarray]] = []  # when each is reached
        self.moves: list[dict[str, Any]] = []
        self.payloads: list[tuple[float, float, list[float]]] = []

    def run(self, text: str, **changed: str) -> None:
        for name, value in changed.items():
            text = re.sub(rf"local {name} = .*", f"local {name} = {value}", text)
        text = re.sub(r"^ *end$", "", text, flags=re.M).replace("local q = q0", "q = list(q0)").replace("local ", "")
        text = text.replace("halt", "raise StopIteration")
        scope: dict[str, Any] = {
            "get_actual_joint_positions": self.at.tolist, "get_steptime": lambda: self.step, "norm": abs,
            "servoj": self._servoj, "stopj": lambda a: None, "popup": lambda *words: None, "sleep": self._sleep,
            "movej": lambda q, **how: self.moves.append({"q": q, **how}),
            "set_payload": lambda mass, centre: self.payloads.append((self.time, mass, centre)),
        }  # fmt: skip
        exec(text, scope)
        scope[re.search(r"def (\w+)\(\)", text)[1]]()  # type: ignore[index]

    def _servoj(self, q: list[float], a: float, v: float, t: float, lookahead: float, gain: float) -> None:
        assert 0.03 <= lookahead <= 0.2 and 100 <= gain <= 2000
        self.sent.append((t, np.array(q)))
        self.time += t
        self.targets.append((self.time, np.array(q)))

    def _sleep(self, seconds: float) -> None:
        assert seconds >= 0
        self.time += seconds
