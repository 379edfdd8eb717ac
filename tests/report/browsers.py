"""Chromium and Firefox as Debian has them, each behind the same few words.

Chromium is driven by Playwright, which downloads nothing; Firefox speaks Marionette, its own
protocol, with the few lines here.
"""

import contextlib
import itertools
import json
import shutil
import socket
import subprocess
import time

import pytest

# JSON has no inf and nan: they are returned as text; Firefox wraps objects of the page
WRAPPED = """
const page = window.wrappedJSObject ?? window, mapdeal = page.mapdeal;
const answer = JSON.stringify(await (%s)(argument), (_, value) =>
  (typeof value === "number" && !Number.isFinite(value) ? String(value) : value));
"""
KEY = """(key) => {
  const canvas = document.getElementById("map");
  canvas.focus();
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
}"""
PIXEL = """([x, y]) => {
  const canvas = document.getElementById("map"), { view } = mapdeal.state();
  const sx = view.width / 2 + (x - view.x) * view.scale;
  const sy = view.height / 2 - (y - view.y) * view.scale;
  const [px, py] = [sx, sy].map((length) => Math.floor((length * canvas.width) / view.width));
  return [...canvas.getContext("2d").getImageData(px, py, 1, 1).data].slice(0, 3);
}"""


def in_time(ask, is_wanted=bool, seconds=20.0):
    """Return an answer once it is wanted; the last one if that takes too long."""
    end = time.monotonic() + seconds
    while not is_wanted(answer := ask()) and time.monotonic() < end:
        time.sleep(0.03)
    return answer


class Browser:
    """The words that are the same in both."""

    def settle(self):
        drawn = "() => performance.getEntriesByName('mapdeal').length"
        assert in_time(lambda: self.evaluate(drawn)), "the page was never drawn"

    def show(self, path, **look):
        self.open(path, **look)
        self.settle()

    def press(self, keys):
        for key in keys.split():
            self.evaluate(KEY, key)

    def click(self, selector):
        self.evaluate("(selector) => document.querySelector(selector).click()", selector)

    def fill(self, selector, value):
        """Enter a value, as who types or drags does."""
        code = """([selector, value]) => {
          const field = document.querySelector(selector);
          field.value = value;
          field.dispatchEvent(new Event("input", { bubbles: true }));
        }"""
        self.evaluate(code, [selector, value])

    def go(self, place, scale=300):
        code = "(place) => { location.hash = `#entry-0/${place}`; }"
        self.evaluate(code, ",".join(map(str, [*place, scale])))

    def texts(self, selector):
        code = "(css) => [...document.querySelectorAll(css)].map((one) => one.textContent)"
        return self.evaluate(code, selector)

    def state(self):
        return self.evaluate("() => mapdeal.state()")

    def view(self):
        return self.state()["view"]

    def pixel(self, place, is_wanted=bool):
        """Return the colour at a place, asked for again while finer tiles may be on their way."""
        return in_time(lambda: self.evaluate(PIXEL, list(place)), is_wanted, seconds=2)


class Chromium(Browser):
    def __init__(self, folder):
        del folder  # Playwright has its own
        playwright = pytest.importorskip("playwright.sync_api")
        path = shutil.which("chromium")
        if path is None:
            pytest.skip("chromium is not installed")
        self._closed = contextlib.ExitStack()
        driver = self._closed.enter_context(playwright.sync_playwright())
        self._browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        self._closed.callback(self._browser.close)
        self._context, self._look = None, None

    def open(self, path, *, width=1400, height=900, dark=False, phone=False, script=True, hash_=""):
        look = {
            "viewport": {"width": width, "height": height}, "has_touch": phone, "is_mobile": phone,
            "device_scale_factor": 2 if phone else 1, "java_script_enabled": script,
            "color_scheme": "dark" if dark else "light",
        }  # fmt: skip
        if look != self._look:
            self._start(look)
        self.page.goto("about:blank")  # a change of the hash alone would load nothing
        self.complaints, self.requests = [], []
        self.page.goto(path.as_uri() + hash_)

    def _start(self, look):
        if self._context is not None:
            self._context.close()
        self._context, self._look = self._browser.new_context(**look), look
        self.page = self._context.new_page()
        self.page.on("console", lambda message: self._hear(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", self._answer)
        self.page.on("request", lambda request: self.requests.append(request.url))

    def _answer(self, dialog):
        self.complaints.append(dialog.message)
        dialog.accept()  # else the page is never left

    def _hear(self, text):
        if "willReadFrequently" not in text:  # of tests that look at pixels
            self.complaints.append(text)

    def evaluate(self, function, argument=None):
        code = f"async (argument) => {{ {WRAPPED % function} return answer; }}"
        answer = self.page.evaluate(code, argument)
        return None if answer is None else json.loads(answer)

    def close(self):
        self._closed.close()


class Firefox(Browser):
    def __init__(self, folder):
        path = shutil.which("firefox-esr")
        if path is None:
            pytest.skip("firefox-esr is not installed")
        settings = {
            "marionette.port": 0,
            "browser.shell.checkDefaultBrowser": False,
            "datareporting.policy.dataSubmissionEnabled": False,
            "app.update.enabled": False,
        }
        lines = [f'user_pref("{name}", {json.dumps(value)});' for name, value in settings.items()]
        (folder / "user.js").write_text("\n".join(lines))
        options = ["--headless", "--marionette", "--remote-allow-system-access", "--no-remote"]
        command = [path, *options, "--profile", str(folder)]
        with (folder / "log.txt").open("wb") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log)
        self._socket = socket.create_connection(("127.0.0.1", self._port(folder)), timeout=120)
        self._file = self._socket.makefile("rb")
        self._receive()
        self._numbers = itertools.count(1)
        self.command("WebDriver:NewSession", capabilities={})
        self.command("WebDriver:SetTimeouts", script=60_000)

    def _port(self, folder):
        chosen = folder / "MarionetteActivePort"
        is_known = lambda: chosen.exists() and chosen.read_text().strip()  # noqa: E731
        in_time(lambda: is_known() or self._process.poll() is not None, seconds=120)
        if not is_known():
            self._process.kill()
            pytest.skip("firefox-esr does not start here")
        return int(chosen.read_text())

    def _receive(self):
        length = b""
        while not length.endswith(b":"):
            length += self._file.read(1)
        return json.loads(self._file.read(int(length[:-1])))

    def command(self, name, **parameters):
        text = json.dumps([0, next(self._numbers), name, parameters]).encode()
        self._socket.sendall(b"%d:%s" % (len(text), text))
        _, _, error, result = self._receive()
        if error:
            raise RuntimeError(f"{name}: {error['error']}: {error['message']}")
        return result.get("value") if isinstance(result, dict) else result

    def _in_chrome(self, script):
        self.command("Marionette:SetContext", value="chrome")
        answer = self.command("WebDriver:ExecuteScript", script=script, args=[])
        self.command("Marionette:SetContext", value="content")
        return answer

    @property
    def complaints(self):
        """What the console says of the page; Firefox's own code has troubles of its own."""
        return self._in_chrome("""
            return Services.console.getMessageArray()
                .filter((message) => message instanceof Ci.nsIScriptError)
                .filter((one) => one.sourceName.startsWith("file:") || one.category === "CSP")
                .map(({ errorMessage }) => errorMessage);
        """)

    def open(self, path, *, width=1400, height=900, hash_=""):
        self.command("WebDriver:Navigate", url="about:blank")
        self._in_chrome("Services.console.reset();")
        self.command("WebDriver:SetWindowRect", width=width, height=height)
        self.command("WebDriver:Navigate", url=path.as_uri() + hash_)
        entries = "async () => performance.getEntriesByType('resource').map((entry) => entry.name)"
        self.requests = [path.as_uri(), *self.evaluate(entries)]

    def evaluate(self, function, argument=None):
        code = """
            const [argument, done] = arguments;
            (async () => { %s return answer; })()
                .then((answer) => done([answer]), (error) => done([null, String(error)]));
        """ % (WRAPPED % function)  # fmt: skip
        answer, *error = self.command("WebDriver:ExecuteAsyncScript", script=code, args=[argument])
        assert not error, error
        return None if answer is None else json.loads(answer)

    def close(self):
        with contextlib.suppress(Exception):
            self.command("Marionette:Quit", flags=["eForceQuit"])
        self._file.close()
        self._socket.close()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def started(name, folder):
    return {"chromium": Chromium, "firefox": Firefox}[name](folder)
