import contextlib
import io
import os
import pty
import sys
import threading
import time

import pytest
from tests.drawn import grid_from_text

from mapdeal import write_map
from mapdeal.cli import terminal
from mapdeal.kernels.blocks import activities, activity

PATIENCE = 10.0  # seconds: far more than any machine takes


class Screen:
    """What a terminal gets, and the lines that it shows in the end."""

    def __init__(self, descriptor, stream):
        self.stream, self.shown = stream, b""
        self._descriptor, self._grew = descriptor, threading.Condition()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    @contextlib.contextmanager
    def shows(self, command):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "stderr", self.stream)  # within a test, else pytest replaces it
            with terminal.activity_shown(command):
                yield

    def _read(self):
        with contextlib.suppress(OSError):
            while part := os.read(self._descriptor, 4096):
                with self._grew:
                    self.shown += part
                    self._grew.notify_all()

    def wait_for(self, text):
        with self._grew:
            assert self._grew.wait_for(lambda: text in self.shown, PATIENCE), self.shown

    def lines(self):
        return [line.rpartition("\r\x1b[K")[2] for line in self.shown.decode().split("\r\n")]


@pytest.fixture
def screen(monkeypatch):
    """A terminal behind stderr, and a line of progress that comes at once."""
    main, screen_end = pty.openpty()
    monkeypatch.setattr(terminal, "_LINE_AFTER", 0.001)
    monkeypatch.setattr(terminal, "_LINE_EVERY", 0.001)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", "1")
    terminal.configure(quiet=False, verbose=False)
    with open(screen_end, "w", encoding="utf-8", buffering=1) as stream:
        screen = Screen(main, stream)
        yield screen
    screen.reader.join()  # it ends with the stream; the next terminal may get the same number
    os.close(main)


def ended(screen):
    screen.stream.write("end\n")
    screen.wait_for(b"end\r\n")
    return screen.lines()


def test_the_line_names_what_is_done_once_and_is_erased(screen):
    with screen.shows("run"):
        screen.wait_for(b"\r\x1b[Krun, 0 s")
        with activity("reading m.yaml"), activity("esdf"):
            screen.wait_for(b"\r\x1b[Krun: esdf, ")
    assert ended(screen) == ["end", ""]
    with screen.shows("esdf"), activity("esdf"):
        screen.wait_for(b"\r\x1b[Kesdf, ")
    assert b"esdf: esdf" not in screen.shown


def test_warnings_and_errors_have_lines_of_their_own(screen):
    with screen.shows("run"):
        for number in range(20):
            screen.wait_for(b"run, ")
            terminal.warn(f"number {number}")
    assert ended(screen) == [*(f"warning: number {k}" for k in range(20)), "end", ""]


def test_the_line_is_erased_when_the_command_fails(screen):
    with pytest.raises(KeyboardInterrupt), screen.shows("run"):
        screen.wait_for(b"run, ")
        raise KeyboardInterrupt
    assert ended(screen) == ["end", ""]


def test_beside_a_bar_there_is_no_line(screen):
    with screen.shows("run"):
        screen.wait_for(b"run, ")
        with terminal.blocks_done(4) as advance:
            advance(1)
            screen.wait_for(b"25%")  # what was written before the bar has arrived by then
            begun = len(screen.shown)
            time.sleep(0.05)
            advance(1)
            screen.wait_for(b"50%")
            assert b"run, " not in screen.shown[begun:]


@pytest.mark.parametrize("case", ["quiet", "dumb", "pipe"])
def test_nothing_is_shown_where_it_is_of_no_use(screen, monkeypatch, case):
    if case == "quiet":
        terminal.configure(quiet=True, verbose=False)
    if case == "dumb":
        monkeypatch.setenv("TERM", "dumb")
    if case == "pipe":
        screen.stream = io.StringIO()
    with screen.shows("run"):
        assert activities.get() is None  # no list collects names of activities
        time.sleep(0.05)
    assert screen.shown == b""


def test_commands_name_what_they_read_write_and_compute(sh):
    activity_names = []
    write_map("m.yaml", grid_from_text("...#\n.?..", 0.1, (1, -2, 0.4)))

    class Names(list):
        def append(self, name):
            activity_names.append(name)
            super().append(name)

    token = activities.set(Names())
    try:
        sh("esdf m.yaml -o field.npz")
    finally:
        activities.reset(token)
    assert activity_names == ["reading m.yaml", "esdf", "writing field.npz"]
