"""All files of a command appear together or not at all, and what guards them."""

import fcntl
import hashlib
import itertools
import os
import signal
import stat
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from mapdeal import FileAccessError, OccupancyGrid, read_map, write_map
from mapdeal.files import transaction as temporary
from mapdeal.files.transaction import Temporary, Transaction, locked
from mapdeal.kernels.threads import use_threads


def contents(folder, but=()):
    paths = [path for path in folder.rglob("*") if path.is_file() and path.suffix not in but]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


LEFT_BY_KILLS = (".tmp", ".old")
REFUSED = PermissionError(1, "Operation not permitted")
FULL = OSError(28, "No space left on device")


def raising(error):
    return Mock(side_effect=error)


def refuse(patch, operation, when):
    """Make a method of paths fail if `when` is true for its path and further arguments."""
    real = getattr(Path, operation)

    def do(*args, **options):
        if when(*args):
            raise REFUSED
        return real(*args, **options)

    patch.setattr(Path, operation, do)


def test_nothing_appears_before_the_end(tmp_path):
    first, two = tmp_path / "one.txt", tmp_path / "two.txt"
    with Transaction([first, two], checksums=True) as transaction:
        transaction.write(first, lambda file: file.write(b"1"))
        assert transaction.wait() == {first: hashlib.sha256(b"1").hexdigest()}
        transaction.write_parts(two, iter([b"2", b"", b"34"]))
        assert transaction.wait()[two] == hashlib.sha256(b"234").hexdigest()
        assert not first.exists()
        assert not two.exists()
    assert contents(tmp_path) == {"one.txt": b"1", "two.txt": b"234"}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("method", "data"), [("write_bytes", b"new"), ("write_parts", [b"new"])])
@pytest.mark.parametrize("place", [(temporary._File, "write"), (os, "fsync")], ids=lambda p: p[1])
def test_a_failure_leaves_old_files_alone(tmp_path, monkeypatch, place, method, data, threads):
    old, new = tmp_path / "old.txt", tmp_path / "folder" / "new.txt"
    old.write_bytes(b"before")
    with (
        pytest.raises(FileAccessError, match=r"\.txt: cannot be written: No space left"),
        use_threads(threads),
        Transaction([old, new], force=True) as transaction,
    ):
        transaction.write_bytes(old, b"after")
        monkeypatch.setattr(*place, raising(FULL))
        getattr(transaction, method)(new, data)
    assert contents(tmp_path) == {"old.txt": b"before"}
    assert [path.name for path in tmp_path.iterdir()] == ["old.txt"]


def test_files_of_a_killed_run_are_removed_and_those_of_a_live_one_kept(tmp_path):
    """Locks are those of open files: another transaction is as good as another process."""
    stale = tmp_path / ".mapdeal-0123456789ab.tmp"
    stale.write_bytes(b"half")
    with Transaction([tmp_path / "live.txt"], checksums=True) as live:
        assert not stale.exists()
        live.write_bytes(tmp_path / "live.txt", b"x")
        live.wait()
        (mine,) = tmp_path.iterdir()
        with Transaction([tmp_path / "third.txt"]) as transaction:
            transaction.write_bytes(tmp_path / "third.txt", b"3")
        assert set(tmp_path.iterdir()) == {mine, tmp_path / "third.txt"}
    assert contents(tmp_path) == {"live.txt": b"x", "third.txt": b"3"}


def test_a_temporary_file_that_another_run_has_removed_is_made_again(tmp_path, monkeypatch):
    lock, removed = fcntl.flock, []

    def lose_the_first(descriptor, operation):
        if not removed:  # the first that is locked is the folder
            removed.extend(tmp_path.glob(".mapdeal-*"))
            for path in removed:
                path.unlink()
        lock(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", lose_the_first)
    with Transaction([tmp_path / "a.txt"]) as transaction:
        transaction.write_bytes(tmp_path / "a.txt", b"kept")
    assert len(removed) == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.txt": b"kept"}


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


@pytest.mark.parametrize("count", [1, 2])
def test_files_are_on_the_disk_before_their_names(tmp_path, monkeypatch, count):
    synced, outputs = [], [tmp_path / "one.txt", tmp_path / "two.txt"]

    def sync(descriptor):
        is_folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        synced.append([is_folder, *(path.exists() for path in outputs)])

    monkeypatch.setattr(os, "fsync", sync)
    with use_threads(count), Transaction(outputs) as transaction:
        for path in outputs:
            transaction.write_bytes(path, b"x")
    assert synced == [[False, False, False], [False, False, False], [True, True, True]]
    assert contents(tmp_path) == {"one.txt": b"x", "two.txt": b"x"}


def test_a_folder_that_is_gone_when_it_is_looked_at_is_made_again(tmp_path, monkeypatch):
    """pathlib checks the existing path, which may be a folder that another run removes."""
    calls, real = itertools.count(), Path.mkdir

    def mkdir(path, *args, **kwargs):
        if next(calls) == 0:
            raise FileExistsError(17, "File exists")
        real(path, *args, **kwargs)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    with Transaction([tmp_path / "out" / "file"]) as transaction:
        transaction.write_bytes(tmp_path / "out" / "file", b"here")
    assert contents(tmp_path) == {"out/file": b"here"}


OLD = {"a/map.pgm": b"old picture", "a/map.yaml": b"old", "b/left.txt": b"left over"}
NEW = {"a/map.pgm": b"new picture", "a/map.yaml": b"new", "b/picture.png": b"drawn"}


def make_old(folder):
    for name, data in OLD.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
        (folder / name).chmod(0o640)


def replace_all(folder):
    """Replace two files in one folder, make one in another and remove one there."""
    with Transaction([folder / name for name in NEW], force=True) as transaction:
        for name, data in NEW.items():
            transaction.write_bytes(folder / name, data)
        sum_ = hashlib.sha256(OLD["b/left.txt"]).hexdigest()
        transaction.remove_if_unchanged(folder / "b/left.txt", sum_)


@pytest.fixture
def old(tmp_path):
    make_old(tmp_path)
    return tmp_path


@pytest.mark.parametrize("has_links", [True, False], ids=["links", "no links"])
@pytest.mark.parametrize("operation", ["replace", "unlink"])
def test_a_failure_at_any_step_puts_everything_back(tmp_path, monkeypatch, operation, has_links):
    if not has_links:
        monkeypatch.setattr(os, "link", raising(REFUSED))
    failed, step = 0, -1
    while True:
        calls, step = itertools.count(), step + 1
        make_old(folder := tmp_path / str(step))
        with monkeypatch.context() as patch:
            refuse(patch, operation, lambda *_, calls=calls, step=step: next(calls) == step)
            try:
                replace_all(folder)
            except FileAccessError as error:
                failed += 1
                assert "Operation not permitted" in str(error)
                assert contents(folder) == OLD
                assert {stat.S_IMODE((folder / name).stat().st_mode) for name in OLD} == {0o640}
            else:  # or it did not matter: the next command removes its leftovers
                assert contents(folder, but=LEFT_BY_KILLS) == NEW
        if next(calls) <= step:
            break
    assert failed == {"replace": 3, "unlink": 1}[operation]


@pytest.mark.parametrize("name", NEW)
def test_a_folder_that_has_come_in_the_plan_blocks_a_file_leaves_the_others_as_they_were(old, name):
    with (
        pytest.raises(FileAccessError, match="cannot be replaced: Is a directory"),
        Transaction([old / file_name for file_name in NEW], force=True) as transaction,
    ):
        for file_name, data in NEW.items():
            transaction.write_bytes(old / file_name, data)
        (old / name).unlink(missing_ok=True)
        (old / name).mkdir()
    assert contents(old) == {place: data for place, data in OLD.items() if place != name}


def test_an_old_file_that_cannot_be_kept_is_not_replaced(old, monkeypatch):
    def half(_, target, **__):
        target.write_bytes(b"ha")
        raise FULL

    monkeypatch.setattr(os, "link", raising(REFUSED))
    monkeypatch.setattr(temporary.shutil, "copy2", half)
    with pytest.raises(FileAccessError, match=r"map\.pgm: cannot be replaced: No space left"):
        replace_all(old)
    assert contents(old) == OLD


def test_an_old_file_that_cannot_go_back_is_named_and_stays(old, monkeypatch):
    refuse(monkeypatch, "replace", lambda path, to: to.name == "map.yaml" or path.suffix == ".old")
    with pytest.raises(FileAccessError, match=r"map\.pgm: cannot be restored") as caught:
        replace_all(old)
    (backup,) = old.glob("*/.mapdeal-*")
    assert caught.value.hint == f"its backup is {backup}"
    assert backup.read_bytes() == OLD["a/map.pgm"]


KILLED_AT_EACH_STEP = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_transaction import LEFT_BY_KILLS, NEW, OLD, contents, make_old, replace_all
from mapdeal.kernels.threads import use_threads

WATCHED = {"os.rename", "os.link", "os.remove", "open", "os.chmod", "fcntl.flock"}
known = [OLD]
for name in NEW:
    known.append({**known[-1], name: NEW[name]})
known.append(NEW)
mixed = 0
for step in range(1000):
    folder = Path(sys.argv[1]) / str(step)
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
    seen = contents(folder, but=LEFT_BY_KILLS)
    assert seen in known, (step, seen)
    mixed += seen in known[1:-1]
    replace_all(folder)
    assert contents(folder) == NEW, (step, contents(folder))
    if status == 0:
        break
print(step, mixed)
"""


@pytest.mark.slow
def test_a_kill_at_any_step_leaves_files_old_or_new_until_the_next_command(tmp_path):
    words = [sys.executable, "-c", KILLED_AT_EACH_STEP, str(tmp_path), str(Path(__file__).parent)]
    process = subprocess.run(words, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    steps, mixed = map(int, process.stdout.split())
    assert steps > 20
    assert mixed >= 3  # some kills came between two renames


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_wait_for_the_last_rename(old, monkeypatch, number):
    def end(*_):
        raise KeyboardInterrupt

    before = signal.signal(number, end)
    real, renamed = Path.replace, []

    def send_first(self, target):
        signal.raise_signal(number)
        renamed.append(target.name)
        return real(self, target)

    monkeypatch.setattr(Path, "replace", send_first)
    try:
        with pytest.raises(KeyboardInterrupt):
            replace_all(old)
        assert signal.getsignal(number) is end
    finally:
        signal.signal(number, before)
    assert renamed == ["map.pgm", "map.yaml", "picture.png"]
    assert contents(old) == NEW


def test_a_file_that_has_come_meanwhile_is_not_replaced_without_force(tmp_path):
    with (
        pytest.raises(FileAccessError, match="exists"),
        Transaction([tmp_path / "a.txt", tmp_path / "b.txt"]) as transaction,
    ):
        transaction.write_bytes(tmp_path / "a.txt", b"new")
        transaction.write_bytes(tmp_path / "b.txt", b"new")
        (tmp_path / "b.txt").write_bytes(b"precious")
    assert contents(tmp_path) == {"b.txt": b"precious"}


def test_a_link_is_replaced_and_what_it_leads_to_stays(old, monkeypatch):
    (old / "a" / "map.pgm").rename(old / "real")
    (old / "a" / "map.pgm").symlink_to("../real")
    with monkeypatch.context() as patch:  # it is put back as a link
        refuse(patch, "unlink", lambda path: path.name == "left.txt")
        with pytest.raises(FileAccessError, match="cannot be removed"):
            replace_all(old)
    assert (old / "a" / "map.pgm").readlink() == Path("../real")
    replace_all(old)
    assert not (old / "a" / "map.pgm").is_symlink()
    assert contents(old) == {**NEW, "real": OLD["a/map.pgm"]}


def test_where_there_are_no_locks_old_files_that_are_kept_stay(tmp_path, monkeypatch):
    backup = tmp_path / ".mapdeal-0123456789ab.old"
    backup.write_bytes(b"old")
    for is_kept in (True, False):
        with monkeypatch.context() as patch:
            if is_kept:
                patch.setattr(fcntl, "flock", raising(FULL))
            with Transaction([tmp_path / f"{is_kept}.txt"]) as transaction:
                transaction.write_bytes(tmp_path / f"{is_kept}.txt", b"1")
        assert backup.exists() == is_kept


def test_a_map_that_is_read_between_two_renames_is_refused(tmp_path, monkeypatch):
    """The reader got the new picture and the old YAML file, which then was replaced."""
    path = tmp_path / "m.yaml"
    write_map(path, OccupancyGrid([[100, 0]], 0.5))
    real, is_between, has_read = Path.replace, threading.Event(), threading.Event()

    def slow(self, target):
        if target.name == "m.yaml":
            is_between.set()
            assert has_read.wait(60)
        return real(self, target)

    def locked_then(folders):
        has_read.set()
        return locked(folders)

    monkeypatch.setattr(Path, "replace", slow)
    monkeypatch.setattr("mapdeal.maps.map_file.locked", locked_then)
    with ThreadPoolExecutor() as pool:
        writing = pool.submit(write_map, path, OccupancyGrid([[0, 100]], 0.25), force=True)
        assert is_between.wait(60)
        with pytest.raises(FileAccessError, match="changed while it was read"):
            read_map(path)
    writing.result()
    assert read_map(path).resolution == 0.25


def is_locked(folder):
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def test_folders_are_locked_all_of_them_and_no_longer_than_needed(tmp_path):
    folders = [tmp_path / name for name in "ba"]
    for folder in folders:
        folder.mkdir()
    with pytest.raises(RuntimeError), locked(folders):
        assert [is_locked(folder) for folder in (*folders, tmp_path)] == [True, True, False]
        raise RuntimeError
    assert not any(map(is_locked, folders))


@pytest.fixture
def as_on_windows(monkeypatch):
    """Without locks; open files cannot be renamed or removed."""

    def is_open(path, *_):
        links = (Path("/proc/self/fd") / descriptor for descriptor in os.listdir("/proc/self/fd"))  # noqa: PTH208
        return any(os.path.realpath(link) == os.path.realpath(path) for link in links)

    monkeypatch.setattr(temporary, "fcntl", None)
    for name in ("replace", "rename", "unlink"):
        refuse(monkeypatch, name, is_open)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux's /proc")
def test_no_open_file_is_renamed_or_removed_where_that_is_refused(tmp_path, as_on_windows):
    with pytest.raises(PermissionError), (tmp_path / "open").open("w"):
        (tmp_path / "open").unlink()
    for value in (0, 100):
        grid = OccupancyGrid(np.full((3, 5), value, np.int8), 0.25, (1.0, 2.0, 0.5))
        write_map(tmp_path / "m.yaml", grid, force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.pgm", "m.yaml", "open"]
    assert (tmp_path / "m.pgm").read_bytes().endswith(bytes(15))
    given_up = Temporary(tmp_path / "n.yaml")
    given_up.open()
    given_up.remove()
    assert not given_up.path.exists()
