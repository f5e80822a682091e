"""A real browser without a window, driven over the pipe that Chromium's own protocol offers."""

import base64
import itertools
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")

PATIENCE_S = 60.0
"""For any single answer: a busy machine is slow, a browser that hangs stays silent."""


def executable() -> str | None:
    """Chromium, wherever it is; the environment variable ``CHROMIUM`` goes first."""
    return os.environ.get("CHROMIUM") or next((path for name in NAMES if (path := shutil.which(name))), None)


WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Flags that draw in three dimensions without a graphics card."""


class Browser:
    """One page at a time, with everything that its console said."""

    def __init__(self, folder: Path, *more: str):
        """Starts it with a folder of its own and more flags, such as ``WEBGL``."""
        program = executable()
        assert program is not None
        own, theirs = os.pipe(), os.pipe()
        # Chromium reads commands from 3 and writes answers to 4.
        shell = f'exec "$0" "$@" 3<&{own[0]} 4>&{theirs[1]}'
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run", *more]
        self._process = subprocess.Popen(
            ["bash", "-c", shell, program, *flags, f"--user-data-dir={folder}", "about:blank"],
            pass_fds=(own[0], theirs[1]),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(own[0])
        os.close(theirs[1])
        self._to, self._from, self._rest = own[1], theirs[0], b""
        self._ids, self._session = itertools.count(1), None
        self._loaded = False
        self.said: list[str] = []
        self.asked: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def close(self) -> None:
        """Ends it."""
        os.close(self._to)
        os.close(self._from)
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _message(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._from], [], [], PATIENCE_S)
            assert ready, "the browser does not answer"
            some = os.read(self._from, 1 << 20)
            assert some, "the browser has ended"
            self._rest += some
        one, self._rest = self._rest.split(b"\0", 1)
        return json.loads(one)

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._ids)
        message = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        left = json.dumps(message).encode() + b"\0"
        while left:
            left = left[os.write(self._to, left) :]
        while (answer := self._message()).get("id") != number:
            self._listen(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _listen(self, event: dict[str, Any]) -> None:
        method, what = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = what["exceptionDetails"]
            self.said.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Runtime.consoleAPICalled":
            words = " ".join(str(one.get("value", one.get("description"))) for one in what["args"])
            self.said.append(f"{what['type']}: {words}")
        elif method == "Log.entryAdded":
            self.said.append(f"{what['entry']['level']}: {what['entry']['text']}")
        elif method == "Page.javascriptDialogOpening":
            self.said.append(f"dialog: {what['message']}")
        elif method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Network.requestWillBeSent":
            self.asked.append(what["request"]["url"])

    def open(self, page: Path, width: int = 1000, height: int = 800, **media: str) -> None:
        """Goes to a file; ``prefers_color_scheme="dark"`` and the like set what the user prefers."""
        self.said, self.asked = [], []
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        features = [{"name": name.replace("_", "-"), "value": value} for name, value in media.items()]
        self._call("Emulation.setEmulatedMedia", features=features)
        self._loaded = False
        self._call("Page.navigate", url=page.resolve().as_uri())
        while not self._loaded:
            self._listen(self._message())

    def ask(self, expression: str) -> Any:
        """The value of an expression on the page."""
        answer = self._call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, expression: str) -> Any:
        """Asks until the answer is true."""
        until = time.monotonic() + PATIENCE_S
        while not (answer := self.ask(expression)):
            assert time.monotonic() < until, f"{expression} stays {answer}; the console: {self.said}"
            time.sleep(0.05)
        return answer

    def picture(self, path: Path, top: int = 0, height: int = 0) -> None:
        """A picture of the page from some way down, for a person to look at."""
        clip = {
            "x": 0,
            "y": top,
            "width": self.ask("innerWidth"),
            "height": height or self.ask("innerHeight"),
            "scale": 1,
        }
        answer = self._call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
        path.write_bytes(base64.b64decode(answer["data"]))
