import contextlib
import hashlib
import os
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from mapdeal import FileAccessError
from mapdeal.formats import temporary
from mapdeal.formats.transaction import Transaction
from mapdeal.kernels.threads import use_threads


def _writer(text):
    return lambda file: file.write(text.encode())


def test_nothing_appears_before_the_end(tmp_path):
    one, two = tmp_path / "one.txt", tmp_path / "two.txt"
    with Transaction([one, two], checksums=True) as transaction:
        transaction.write(one, _writer("1"))
        assert transaction.checksums() == {one: hashlib.sha256(b"1").hexdigest()}
        assert not one.exists()
        transaction.write(two, _writer("2"))
    assert (one.read_text(), two.read_text()) == ("1", "2")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.txt", "two.txt"]


def test_checksums_are_not_made_up_where_nobody_asked_for_them(tmp_path):
    with (
        pytest.raises(ValueError, match="without checksums"),
        Transaction([tmp_path / "one.txt"]) as transaction,
    ):
        transaction.write(tmp_path / "one.txt", _writer("1"))
        transaction.checksums()
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_nothing_and_old_files_as_they_were(tmp_path):
    old, new = tmp_path / "old.txt", tmp_path / "folder" / "new.txt"
    old.write_text("before")

    def fail(file):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with (
        pytest.raises(FileAccessError, match="No space left"),
        Transaction([old, new], force=True) as transaction,
    ):
        transaction.write(old, _writer("after"))
        transaction.write(new, fail)
    assert old.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["old.txt"]


def test_an_error_of_the_caller_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), Transaction([tmp_path / "a" / "b.txt"]) as transaction:
        transaction.write(tmp_path / "a" / "b.txt", _writer("x"))
        1 / 0  # noqa: B018
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("link", [os.link, os.symlink])
def test_an_output_that_is_an_input_under_another_name_is_refused(tmp_path, link):
    source, output = tmp_path / "map.pgm", tmp_path / "other.pgm"
    source.write_text("precious")
    link(source, output)
    with pytest.raises(FileAccessError, match="the output is the input"):
        Transaction([output], inputs=[source], force=True)
    assert source.read_text() == "precious"


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileAccessError, match="not a folder"):
        Transaction([tmp_path / "file" / "x" / "map.pgm"])


HOLD = """
import sys, time
from pathlib import Path
from mapdeal.formats.transaction import Transaction
from mapdeal.kernels.threads import use_threads
path = Path(sys.argv[1])
with Transaction([path], checksums=True) as transaction:
    transaction.write(path, lambda file: file.write(b"x"))
    transaction.checksums()
    print("ready", flush=True)
    time.sleep(600)
"""


def test_files_of_a_killed_run_are_removed_and_those_of_a_live_one_kept(tmp_path):
    def hold(name):
        words = [sys.executable, "-c", HOLD, str(tmp_path / name)]
        process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert process.stdout.readline() == "ready\n"
        return process

    def temporaries():
        return {p for p in tmp_path.iterdir() if p.name.startswith(".mapdeal-")}

    killed = hold("killed.txt")
    stale = temporaries()
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    live = hold("live.txt")
    try:
        assert stale.isdisjoint(temporaries())  # the second run has cleaned up
        mine = temporaries()
        with Transaction([tmp_path / "third.txt"]) as transaction:
            transaction.write(tmp_path / "third.txt", _writer("3"))
        assert temporaries() == mine
    finally:
        live.kill()
        live.wait()
        killed.stdout.close()
        live.stdout.close()


def test_a_temporary_file_that_another_run_has_removed_is_made_again(tmp_path, monkeypatch):
    import mapdeal.formats.temporary as module

    lock, removed = module.fcntl.flock, []

    def lose_the_first(descriptor, operation):
        if not removed:
            removed.extend(tmp_path.glob(".mapdeal-*"))
            removed[0].unlink()
        lock(descriptor, operation)

    monkeypatch.setattr(module.fcntl, "flock", lose_the_first)
    with Transaction([tmp_path / "a.txt"]) as transaction:
        transaction.write(tmp_path / "a.txt", _writer("kept"))
    assert len(removed) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "kept"


@pytest.mark.slow
def test_a_failing_process_takes_no_folder_from_another(tmp_path):
    """One makes folders and removes them, since it fails; the other works in the same ones."""
    output, other = tmp_path / "out" / "good" / "file", tmp_path / "out" / "bad" / "file"
    done = threading.Event()
    surprises = []

    def fail():
        while not done.is_set():
            try:
                with Transaction([other]):
                    raise KeyError
            except KeyError:
                continue
            except Exception as error:  # noqa: BLE001 - told below
                surprises.append(error)

    thread = threading.Thread(target=fail)
    thread.start()
    try:
        for _ in range(100):
            with Transaction([output]) as transaction:
                transaction.write_bytes(output, b"here")
            assert output.read_bytes() == b"here"
            output.unlink()
            with contextlib.suppress(OSError):  # so that the two meet in making it
                output.parent.rmdir()
                output.parent.parent.rmdir()
    finally:
        done.set()
        thread.join()
    assert surprises == []


@pytest.mark.parametrize("when", ["before", "after"])
def test_an_interruption_while_a_temporary_file_is_made_leaves_none(tmp_path, monkeypatch, when):
    """Ctrl-C and SIGTERM come at any moment, also when a file is there and nobody knows it yet."""
    output = tmp_path / "new" / "file"
    really_open = os.open

    def opened(path, flags, *more):
        if ".mapdeal-" not in str(path):
            return really_open(path, flags, *more)
        if when == "after":
            os.close(really_open(path, flags, *more))
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "open", opened)
    with pytest.raises(KeyboardInterrupt), Transaction([output]) as transaction:
        transaction.write_bytes(output, b"x")
    assert list(tmp_path.iterdir()) == []


def test_one_thread_is_the_callers_own(tmp_path):
    seen = []
    for count in (1, 2):
        with use_threads(count), Transaction([tmp_path / "one.txt"], force=True) as transaction:
            transaction.write(
                tmp_path / "one.txt", lambda _: seen.append(threading.get_ident())
            )  # fmt: skip
    assert seen[0] == threading.get_ident() != seen[1]


def test_a_failure_in_the_callers_own_thread_leaves_nothing_either(tmp_path):
    one, two = tmp_path / "folder" / "one.txt", tmp_path / "folder" / "two.txt"

    def fail(_):
        raise OSError(28, "No space left on device")

    with (
        pytest.raises(FileAccessError, match=r"two\.txt: cannot be written: No space left"),
        use_threads(1),
        Transaction([one, two]) as transaction,
    ):
        transaction.write(one, _writer("1"))
        transaction.write(two, fail)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("count", [1, 2])
def test_all_files_are_on_the_disk_before_any_has_its_name(tmp_path, monkeypatch, count):
    synced, outputs = [], [tmp_path / "one.txt", tmp_path / "two.txt"]
    real = os.fsync

    def sync(descriptor):
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            synced.append([path.exists() for path in outputs])
        real(descriptor)

    monkeypatch.setattr(os, "fsync", sync)
    with use_threads(count), Transaction(outputs) as transaction:
        for path in outputs:
            transaction.write(path, _writer(path.name))
    assert synced == [[False, False], [False, False]]
    assert [path.read_text() for path in outputs] == ["one.txt", "two.txt"]


@pytest.mark.parametrize("count", [1, 2])
def test_a_disk_that_fails_at_the_end_leaves_the_old_files(tmp_path, monkeypatch, count):
    output = tmp_path / "one.txt"
    output.write_text("old")

    def sync(_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", sync)
    with (
        pytest.raises(FileAccessError, match=r"one\.txt: cannot be written: Input/output error"),
        use_threads(count),
        Transaction([output], force=True) as transaction,
    ):
        transaction.write(output, _writer("new"))
    assert output.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["one.txt"]


def test_parts_are_written_one_after_the_other(tmp_path):
    output = tmp_path / "a.txt"
    with Transaction([output], checksums=True) as transaction:
        transaction.write_parts(output, iter([b"one ", b"", b"two"]))
        assert transaction.checksums() == {output: hashlib.sha256(b"one two").hexdigest()}
        assert not output.exists()
    assert output.read_bytes() == b"one two"


def test_a_part_that_cannot_be_written_leaves_the_old_file(tmp_path, monkeypatch):
    output = tmp_path / "a.txt"
    output.write_text("old")

    def fail(*_):
        raise OSError(28, "No space left on device")

    with (
        pytest.raises(FileAccessError, match=r"a\.txt: cannot be written: No space left"),
        Transaction([output], force=True) as transaction,
    ):
        monkeypatch.setattr(temporary._File, "write", fail)
        transaction.write_parts(output, [b"new"])
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("a.txt", "old")]


def test_a_folder_that_is_gone_when_it_is_looked_at_is_made_again(tmp_path, monkeypatch):
    """pathlib looks at what is in the way: it may be a folder that another run takes away."""
    folder = tmp_path / "out"
    really_make, calls = Path.mkdir, []

    def mkdir(path, *args, **kwargs):
        calls.append(path)
        if len(calls) == 1:
            raise FileExistsError(17, "File exists")
        really_make(path, *args, **kwargs)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    with Transaction([folder / "file"]) as transaction:
        transaction.write_bytes(folder / "file", b"here")
    assert (folder / "file").read_bytes() == b"here"
    assert calls == [folder, folder]
