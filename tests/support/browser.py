"""A browser without a window and without a network, told by its DevTools protocol what to do."""

import base64
import fcntl
import io
import json
import os
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FOUND = next((path for name in NAMES if (path := shutil.which(name))), None)
"""The browser's path, if there is one here."""
MISSING = f"no browser here: install one of {', '.join(NAMES)}"
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
READY = "document.body && document.body.dataset.ready"
"""What is true in a page once its script has run."""
PATIENCE = 90.0
"""Time to wait for anything, s."""


class Browser:
    """One page, of a size in pixels.

    - `errors`: what its console said of errors.
    """

    def __init__(self, folder: Path, size: tuple[int, int], options: tuple[str, ...] = OPTIONS):
        assert FOUND is not None
        (its_input, self._output), (self._input, its_output) = os.pipe(), os.pipe()
        given = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 20) for end in (its_input, its_output)]
        options = (*options, f"--user-data-dir={folder}", "--window-size={},{}".format(*size))
        nothing = os.open(os.devnull, os.O_RDWR)
        actions = [(os.POSIX_SPAWN_DUP2, end, 3 + k) for k, end in enumerate(given)]
        actions += [(os.POSIX_SPAWN_DUP2, nothing, k) for k in range(3)]
        self._process = os.posix_spawn(
            FOUND, [FOUND, *options], os.environ, file_actions=actions, setpgroup=0
        )
        for end in (its_input, its_output, nothing, *given):
            os.close(end)
        self.errors: list[str] = []
        self._number, self._left, self._session = 0, b"", ""
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def open(self, address: str, ready: str = READY) -> None:
        """Open an address, and wait until an expression in the page is true."""
        self._call("Page.navigate", url=address)
        self.wait(ready)

    def ask(self, script: str) -> Any:
        """The value of an expression in the page."""
        asked = self._call("Runtime.evaluate", expression=script, returnByValue=True)
        return asked["result"].get("value")

    def wait(self, script: str) -> None:
        """Wait until an expression in the page is true."""
        end = time.monotonic() + PATIENCE
        while not self.ask(script):
            assert time.monotonic() < end, f"{script} stays false; errors: {self.errors}"
            time.sleep(0.05)

    def picture(self) -> np.ndarray:
        """What it shows, (H, W, 3)."""
        data = self._call("Page.captureScreenshot")["data"]
        image = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
        return np.asarray(image, dtype=float)

    def close(self) -> None:
        """End it."""
        os.killpg(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        for end in (self._input, self._output):
            os.close(end)

    def _call(self, method: str, **parameters: object) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._output, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._number:
            self._note(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._left:
            part = os.read(self._input, 1 << 20)
            assert part, "the browser has ended"
            self._left += part
        message, self._left = self._left.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        about = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(about["exceptionDetails"])[:500])
        if event.get("method") == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.errors.append(about["entry"]["text"])
        if event.get("method") == "Runtime.consoleAPICalled" and about["type"] == "error":
            self.errors.append(json.dumps(about["args"])[:500])
