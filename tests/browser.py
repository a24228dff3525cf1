"""A headless Chromium for tests of pages, spoken to through its debugging pipe (Chrome DevTools Protocol)."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PATIENCE = 60.0  # [s] for one answer
QUIET = ("GL Driver Message", "GPU stall")  # of the software renderer
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --hide-scrollbars --disable-dev-shm-usage "
    "--disable-background-networking --disable-component-update --disable-sync --use-gl=angle "
    "--use-angle=swiftshader --enable-unsafe-swiftshader --remote-debugging-pipe"
)
# Starts a program with these two pipes as its descriptors 3 and 4.
WIRED = """
import fcntl, os, sys
a, b = (fcntl.fcntl(int(word), fcntl.F_DUPFD, 10) for word in sys.argv[1:3])
os.dup2(a, 3), os.dup2(b, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    """One Chromium with one tab; what it says and asks for is kept.

    Attributes:
        said: errors and words on the console since the last `open`.
        asked: addresses that were asked for since then.
    """

    def __init__(self, profile: Path) -> None:
        assert CHROMIUM is not None
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-c", WIRED, str(theirs_in), str(theirs_out), CHROMIUM, *FLAGS.split(),
             f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(theirs_in, theirs_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._held, self._count, self._session = b"", 0, ""
        self.said: list[str] = []
        self.asked: list[str] = []
        target = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        os.close(self._in)
        os.close(self._out)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to a command of the protocol."""
        self._count += 1
        words: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            words["sessionId"] = self._session
        os.write(self._out, json.dumps(words).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while True:
            found = self._message(end)
            if found.get("id") == self._count:
                if "error" in found:
                    raise RuntimeError(f"{method}: {found['error']}")
                return dict(found["result"])

    def _message(self, end: float) -> dict[str, Any]:
        while b"\0" not in self._held:
            if not select.select([self._in], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError("the browser does not answer")
            read = os.read(self._in, 1 << 20)
            if not read:
                raise RuntimeError("the browser has ended")
            self._held += read
        text, _, self._held = self._held.partition(b"\0")
        found: dict[str, Any] = json.loads(text)
        words = found.get("params", {})
        match found.get("method"):
            case "Runtime.consoleAPICalled":
                self._note(" ".join(str(a.get("value", a.get("description"))) for a in words["args"]))
            case "Runtime.exceptionThrown":
                self._note(json.dumps(words["exceptionDetails"]))
            case "Log.entryAdded":
                self._note(words["entry"]["text"])
            case "Network.requestWillBeSent":
                self.asked.append(words["request"]["url"])
        return found

    def _note(self, text: str) -> None:
        if not any(word in text for word in QUIET):
            self.said.append(text)

    def view(self, width: int, dark: bool = False, height: int = 900) -> None:
        """A window of this size [px], light or dark."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def open(self, page: Path) -> None:
        """A page, until its own scripts have ended."""
        self.said, self.asked = [], []
        self.call("Page.navigate", url=page.resolve().as_uri())
        script = "document.querySelector('script:not([type])') !== null"
        self.until("document.readyState === 'complete'")
        if self.run(script):
            self.until("document.body.dataset.ready !== undefined")

    def until(self, condition: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.run(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"{condition}; it said {self.said}")
            time.sleep(0.02)

    def run(self, expression: str) -> Any:
        """The value of an expression in the page; of a promise, what it ends in."""
        words = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        found = self.call("Runtime.evaluate", **words)
        if "exceptionDetails" in found:
            raise RuntimeError(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def mouse(self, kind: str, x: float, y: float, button: str = "none") -> None:
        """A movement ("mouseMoved"), "mousePressed" or "mouseReleased" at a place of the window [px]."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=1)

    def picture(self, file: Path) -> None:
        """The whole page as a PNG."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        found = self.call("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        file.write_bytes(base64.b64decode(found["data"]))
