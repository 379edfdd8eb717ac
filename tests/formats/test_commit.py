"""Files of a transaction get their names all together or not at all: at every step between."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from mapdeal import FileAccessError
from mapdeal.formats.commit import JOURNAL, settle
from mapdeal.formats.signals import signals_put_off
from mapdeal.formats.source import read_file
from mapdeal.formats.transaction import Transaction

OLD = {"a/map.pgm": b"old picture", "a/map.yaml": b"old", "b/left.txt": b"left over"}
NEW = {"a/map.pgm": b"new picture", "a/map.yaml": b"new", "b/picture.png": b"drawn"}


def make_old(folder):
    for name, data in OLD.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)


def replace_all(folder, *, force=True):
    """Replace two files in one folder, make one in another and remove one there."""
    import hashlib

    with Transaction([folder / name for name in NEW], force=force) as transaction:
        for name, data in NEW.items():
            transaction.write_bytes(folder / name, data)
        sum_ = hashlib.sha256(OLD["b/left.txt"]).hexdigest()
        transaction.remove_if_unchanged(folder / "b/left.txt", sum_)


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_files_are_replaced_and_removed_together(tmp_path):
    make_old(tmp_path)
    replace_all(tmp_path)
    assert contents(tmp_path) == NEW


@pytest.mark.slow
@pytest.mark.parametrize("has_links", [True, False], ids=["links", "no links"])
@pytest.mark.parametrize("operation", ["replace", "rename", "unlink"])
def test_a_failure_at_any_step_puts_everything_back(tmp_path, monkeypatch, operation, has_links):
    if not has_links:

        def no_link(*_, **__):
            raise PermissionError(1, "Operation not permitted")

        monkeypatch.setattr(os, "link", no_link)
    real, failed = getattr(Path, operation), 0
    for step in range(20):
        folder = tmp_path / str(step)
        folder.mkdir()
        make_old(folder)
        count = 0

        def fail_once(self, *args, step=step, **options):
            nonlocal count
            count += 1
            if count == step + 1:
                raise PermissionError(1, "Operation not permitted")
            return real(self, *args, **options)

        monkeypatch.setattr(Path, operation, fail_once)
        try:
            replace_all(folder)
        except FileAccessError as error:
            failed += 1
            assert "Operation not permitted" in str(error)
            assert contents(folder) == OLD
        else:  # or it did not matter: what is left of it goes with the next command
            assert {k: v for k, v in contents(folder).items() if ".mapdeal" not in k} == NEW
        monkeypatch.setattr(Path, operation, real)
        if count <= step:
            break
    else:
        pytest.fail("there is no end of steps")
    # links are kept aside by `link`; without them `rename` does it
    assert failed >= {"replace": 3, "rename": 0 if has_links else 3, "unlink": 1}[operation]


KILLED_AT_EACH_STEP = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_commit import NEW, OLD, contents, make_old, replace_all
from mapdeal.formats.commit import settle
from mapdeal.kernels.threads import use_threads

WATCHED = {"os.rename", "os.link", "os.remove", "open", "os.chmod", "fcntl.flock"}
torn = restored = 0
for step in range(1000):
    folder = Path(sys.argv[1]) / str(step)
    folder.mkdir()
    make_old(folder)
    pid = os.fork()
    if pid == 0:
        count = 0

        def kill_at_step(event, arguments):
            global count
            if event in WATCHED:
                if count == step:
                    os.kill(os.getpid(), signal.SIGKILL)
                count += 1

        with use_threads(1):
            sys.addaudithook(kill_at_step)
            replace_all(folder)
            os._exit(0)
    _, status = os.waitpid(pid, 0)
    seen = {k: v for k, v in contents(folder).items() if ".mapdeal" not in k}
    torn += seen not in (OLD, NEW)
    for place in ("a", "b") if step % 2 else ("b", "a"):
        settle(folder / place)
    after = {k: v for k, v in contents(folder).items() if ".mapdeal" not in k}
    assert after in (OLD, NEW), (step, seen, after)
    restored += after != seen
    if step % 4 == 0:
        replace_all(folder)
        assert contents(folder) == NEW, (step, contents(folder))
    if status == 0:
        break
print(step, torn, restored)
"""


@pytest.mark.slow
def test_what_a_killed_process_has_left_is_put_back_at_every_step(tmp_path):
    words = [sys.executable, "-c", KILLED_AT_EACH_STEP, str(tmp_path), str(Path(__file__).parent)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    steps, torn, restored = map(int, done.stdout.split())
    # the names change one by one: some kills must have come between; and some after the last one,
    # but before the journals went
    assert steps > 20
    assert 3 <= torn <= restored


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_wait_for_the_last_rename(tmp_path, monkeypatch, number):
    class TerminatedError(BaseException):
        pass

    def end(*_):
        raise TerminatedError

    before = signal.getsignal(signal.SIGTERM)
    signal.signal(signal.SIGTERM, end)
    real, seen = Path.replace, []

    def send_first(self, target):
        if not self.name.endswith(".old") and JOURNAL not in str(target):
            signal.raise_signal(number)
            seen.append(target.name)
        return real(self, target)

    make_old(tmp_path)
    monkeypatch.setattr(Path, "replace", send_first)
    try:
        with pytest.raises((KeyboardInterrupt, TerminatedError)):
            replace_all(tmp_path)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen == ["map.pgm", "map.yaml", "picture.png"]
    assert contents(tmp_path) == NEW


def test_signals_are_answered_after_the_block_and_their_handlers_are_back():
    reached = False
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), signals_put_off():
        signal.raise_signal(signal.SIGINT)
        reached = True
    assert reached
    assert signal.getsignal(signal.SIGINT) is before


def test_ignored_signals_stay_ignored_and_other_threads_are_left_alone():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals_put_off():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    handlers = []

    def look():
        with signals_put_off():
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert handlers == [signal.getsignal(signal.SIGINT)]


def test_a_file_that_has_come_meanwhile_is_not_replaced_without_force(tmp_path):
    with (
        pytest.raises(FileAccessError, match="exists"),
        Transaction([tmp_path / "a.txt", tmp_path / "b.txt"]) as transaction,
    ):
        transaction.write_bytes(tmp_path / "a.txt", b"new")
        transaction.write_bytes(tmp_path / "b.txt", b"new")
        (tmp_path / "b.txt").write_bytes(b"precious")
    assert contents(tmp_path) == {"b.txt": b"precious"}


def killed_half_way(folder):
    """Leave two files in a folder as a process leaves them that is killed between two renames."""
    make_old(folder)
    pid = os.fork()
    if pid == 0:
        real = Path.replace

        def kill_before_the_second(self, target):
            if target.name == "map.yaml" and self.suffix == ".tmp":
                os.kill(os.getpid(), signal.SIGKILL)
            return real(self, target)

        Path.replace = kill_before_the_second
        replace_all(folder)
        os._exit(0)
    os.waitpid(pid, 0)
    assert contents(folder)["a/map.pgm"] == NEW["a/map.pgm"]
    assert contents(folder)["a/map.yaml"] == OLD["a/map.yaml"]


def test_a_reader_finds_the_old_files_of_a_killed_command(tmp_path):
    killed_half_way(tmp_path)
    assert read_file(tmp_path / "a/map.pgm") == OLD["a/map.pgm"]
    assert {k: v for k, v in contents(tmp_path).items() if not k.endswith(".tmp")} == OLD


def test_what_somebody_has_written_since_the_kill_stays(tmp_path):
    killed_half_way(tmp_path)
    (tmp_path / "a/map.pgm").write_bytes(b"by hand")
    settle(tmp_path / "a")
    assert (tmp_path / "a/map.pgm").read_bytes() == b"by hand"
    assert (tmp_path / "a/map.yaml").read_bytes() == OLD["a/map.yaml"]
    assert not list(tmp_path.glob("*/.mapdeal*.old"))


def test_a_reader_waits_for_a_live_command(tmp_path, monkeypatch):
    make_old(tmp_path)
    real, waiting, read = Path.replace, threading.Event(), []

    def slow(self, target):
        if target.name == "map.yaml":
            reader.start()
            waiting.wait()
            time.sleep(0.05)  # the longer, the better the test; it holds without
        return real(self, target)

    def look():
        waiting.set()
        read.append(read_file(tmp_path / "a/map.yaml"))
        read.append(read_file(tmp_path / "a/map.pgm"))

    reader = threading.Thread(target=look)
    monkeypatch.setattr(Path, "replace", slow)
    replace_all(tmp_path)
    reader.join()
    assert read == [NEW["a/map.yaml"], NEW["a/map.pgm"]]


@pytest.mark.parametrize(
    "change",
    [
        {"files": [["../x", None, None]]},
        {"files": [["/x", None, None]]},
        {"files": [["..", None, None]]},
        {"files": [["x", None, "precious.txt"]]},
        {"files": [["x", None, "../.mapdeal-0123456789ab.old"]]},
        {"files": [["x", [1, 2], None]]},
        {"files": [["x", {}, None]]},
        {"files": 5},
        {"format": "other"},
        {"key": []},
    ],
)
def test_a_journal_from_somewhere_has_no_power_outside_of_its_folder(tmp_path, change):
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "precious.txt").write_bytes(b"1")
    (tmp_path / ".mapdeal-0123456789ab.old").write_bytes(b"2")
    document = {"format": "mapdeal-journal/1", "key": "k", "folders": ["."], "files": [], **change}
    (folder / JOURNAL).write_text(json.dumps(document))
    with contextlib.suppress(FileAccessError):
        settle(folder)
    assert (folder / "precious.txt").read_bytes() == b"1"
    assert (tmp_path / ".mapdeal-0123456789ab.old").read_bytes() == b"2"
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100000, '{"format": 1}', "\x00\xff"])
def test_a_damaged_journal_is_named(tmp_path, text):
    (tmp_path / JOURNAL).write_text(text, encoding="latin-1")
    (tmp_path / "a.txt").write_bytes(b"1")
    with pytest.raises(FileAccessError, match="not the journal") as caught:
        read_file(tmp_path / "a.txt")
    assert caught.value.hint == "remove it"


def test_old_files_that_were_kept_by_a_process_killed_at_its_very_end_go(tmp_path):
    (tmp_path / ".mapdeal-0123456789ab.old").write_bytes(b"old")
    (tmp_path / ".mapdeal-mine.old").write_bytes(b"not ours")
    with Transaction([tmp_path / "a.txt"]) as transaction:
        transaction.write_bytes(tmp_path / "a.txt", b"1")
    assert sorted(contents(tmp_path)) == [".mapdeal-mine.old", "a.txt"]


def test_where_there_are_no_locks_nothing_is_taken_for_dead(tmp_path, monkeypatch):
    import mapdeal.formats.temporary as module

    killed_half_way(tmp_path)

    def no_locks(*_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(module.fcntl, "flock", no_locks)
    before = contents(tmp_path)
    settle(tmp_path / "a")
    assert contents(tmp_path) == before


def test_a_file_of_somebody_else_in_a_sticky_folder_leaves_nothing_behind(tmp_path, monkeypatch):
    make_old(tmp_path)
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.chmod(0o1777)
    link, rename = os.link, Path.rename
    foreign = tmp_path / "a" / "map.yaml"
    owner = os.geteuid()
    os.chown(foreign, owner + 1 if owner == 0 else owner, -1)
    monkeypatch.setattr(os, "geteuid", lambda: owner + 2 if owner else owner + 1000)
    kept = []
    monkeypatch.setattr(os, "link", lambda *names, **how: (kept.append(names), link(*names, **how)))

    def refused(self, target):
        if self == foreign:
            raise PermissionError(1, "Operation not permitted")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(FileAccessError, match=r"map\.yaml: cannot be replaced: Operation not"):
        replace_all(tmp_path)
    assert kept == []  # a second name could not be taken away again
    assert contents(tmp_path) == OLD


def test_a_journal_that_cannot_be_worked_off_stops_only_who_needs_its_files(tmp_path, monkeypatch):
    killed_half_way(tmp_path)
    (tmp_path / "a" / "other.txt").write_bytes(b"other")

    def refused(*_, **__):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "unlink", refused)
    monkeypatch.setattr(Path, "replace", refused)
    assert read_file(tmp_path / "a" / "other.txt") == b"other"
    with pytest.raises(FileAccessError, match="Operation not permitted"):
        read_file(tmp_path / "a" / "map.yaml")
