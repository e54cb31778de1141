"""A headless Chromium, driven through its DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

import websocket

NAMES = ("chromium", "chromium-browser", "google-chrome")
SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
STARTS_WITHIN_S = 30
ANSWERS_WITHIN_S = 60


def executable() -> str | None:
    """Return where this machine has Chromium, or None."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """One page in a browser of its own; what it asks for and complains of is kept."""

    def __init__(self, scratch: Path, *switches: str) -> None:
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self._calls = 0
        path = executable()
        assert path is not None
        words = [path, "--headless=new", "--no-sandbox", "--remote-debugging-port=0"]
        words += [f"--user-data-dir={scratch}", "--hide-scrollbars", *(switches or SOFTWARE)]
        self._process = subprocess.Popen(
            [*words, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            self._socket = websocket.create_connection(
                _address(scratch), timeout=ANSWERS_WITHIN_S, suppress_origin=True
            )
        except BaseException:
            self._process.kill()
            self._process.wait()
            raise
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def close(self) -> None:
        """End the browser."""
        self.call("Browser.close")
        self._socket.close()
        self._process.wait(STARTS_WITHIN_S)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._calls += 1
        order = {"id": self._calls, "method": method, "params": parameters}
        self._socket.send(json.dumps(order))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") == self._calls:
                assert "error" not in message, message
                return dict(message["result"])
            self._note(message)

    def _note(self, message: dict[str, Any]) -> None:
        method, about = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(str(about["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and about["type"] == "error":
            self.complaints.append(str(about["args"]))
        elif method == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.complaints.append(about["entry"]["text"])

    def evaluate(self, script: str) -> Any:
        """Return what an expression, or the promise that it gives, comes to."""
        result = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def open(self, path: Path, before: str = "", size: tuple[int, int] = (900, 800)) -> None:
        """Open a file, with a script before its own, and wait for the player."""
        self.resize(*size)
        if before:
            self.call("Page.addScriptToEvaluateOnNewDocument", source=before)
        self.requests.clear()
        self.complaints.clear()
        self.call("Page.navigate", url=path.as_uri())
        self._wait("document.documentElement?.dataset.playerReady === '1'")

    def open_without_script(self, path: Path, size: tuple[int, int] = (900, 800)) -> None:
        """Open a file with JavaScript switched off, and wait until all of it is there."""
        self.resize(*size)
        self.call("Emulation.setScriptExecutionDisabled", value=True)
        self.requests.clear()
        self.complaints.clear()
        self.call("Page.navigate", url=path.as_uri())
        self._wait("location.protocol === 'file:' && document.readyState === 'complete'")

    def _wait(self, condition: str) -> None:
        end = time.monotonic() + STARTS_WITHIN_S
        while self.evaluate(condition) is not True:
            assert time.monotonic() < end, self.complaints
            time.sleep(0.05)

    def resize(self, width: int, height: int) -> None:
        """Give the page a size."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def seek(self, time_s: float) -> None:
        """Go to a time and wait until it is drawn."""
        drawn = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        self.evaluate(f"skillplanPlayer.seek({time_s}); {drawn}")

    def press(self, key: str) -> None:
        """Press a key where the focus is."""
        text = key if len(key) == 1 else ""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def printed(self) -> bytes:
        """Return the page as a PDF, as the browser prints it."""
        return base64.b64decode(self.call("Page.printToPDF")["data"])

    def picture(self) -> bytes:
        """Return the page as a PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot")["data"])


def _address(scratch: Path) -> str:
    """Return where the browser's first page listens, once there is one."""
    end = time.monotonic() + STARTS_WITHIN_S
    port_file = scratch / "DevToolsActivePort"
    while time.monotonic() < end:
        text = port_file.read_text() if port_file.is_file() else ""
        if "\n" in text:
            listing = f"http://127.0.0.1:{text.splitlines()[0]}/json/list"
            with urllib.request.urlopen(listing) as answer:
                pages = [item for item in json.load(answer) if item["type"] == "page"]
            if pages:
                return str(pages[0]["webSocketDebuggerUrl"])
        time.sleep(0.05)
    raise TimeoutError("Chromium did not start")
