import contextlib
import hashlib
import os
import signal
import stat
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from mapdeal import FileAccessError, OccupancyGrid, write_map
from mapdeal.files import transaction as temporary
from mapdeal.files.transaction import Transaction
from mapdeal.kernels.threads import use_threads
from mapdeal.maps import reading as maps


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
from mapdeal.files.transaction import Transaction
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
    import mapdeal.files.transaction as module

    lock, removed = module.fcntl.flock, []

    def lose_the_first(descriptor, operation):
        if not removed:  # the first that is locked is the folder
            removed.extend(tmp_path.glob(".mapdeal-*"))
            for path in removed:
                path.unlink()
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


OLD = {"a/map.pgm": b"old picture", "a/map.yaml": b"old", "b/left.txt": b"left over"}
NEW = {"a/map.pgm": b"new picture", "a/map.yaml": b"new", "b/picture.png": b"drawn"}


def make_old(folder):
    for name, data in OLD.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
        (folder / name).chmod(0o640)


def replace_all(folder):
    """Replace two files in one folder, make one in another and remove one there."""
    with Transaction([folder / name for name in NEW], force=True) as transaction:
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


def without_leftovers(found):
    return {name: data for name, data in found.items() if ".mapdeal-" not in name}


def test_files_are_replaced_and_removed_together(tmp_path):
    make_old(tmp_path)
    replace_all(tmp_path)
    assert contents(tmp_path) == NEW


@pytest.mark.parametrize("has_links", [True, False], ids=["links", "no links"])
@pytest.mark.parametrize("operation", ["replace", "unlink"])
def test_a_failure_at_any_step_puts_everything_back(tmp_path, monkeypatch, operation, has_links):
    def refused(*_, **__):
        raise PermissionError(1, "Operation not permitted")

    if not has_links:
        monkeypatch.setattr(os, "link", refused)
    real, failed = getattr(Path, operation), 0
    for step in range(20):
        folder = tmp_path / str(step)
        folder.mkdir()
        make_old(folder)
        count = 0

        def fail_once(self, *args, step=step, **options):
            nonlocal count
            count += 1
            return (refused if count == step + 1 else real)(self, *args, **options)

        monkeypatch.setattr(Path, operation, fail_once)
        try:
            replace_all(folder)
        except FileAccessError as error:
            failed += 1
            assert "Operation not permitted" in str(error)
            assert contents(folder) == OLD
            assert {stat.S_IMODE((folder / name).stat().st_mode) for name in OLD} == {0o640}
        else:  # or it did not matter: what is left of it goes with the next command
            assert without_leftovers(contents(folder)) == NEW
        monkeypatch.setattr(Path, operation, real)
        if count <= step:
            break
    else:
        pytest.fail("there is no end of steps")
    assert failed == {"replace": 3, "unlink": 1}[operation]


@pytest.mark.parametrize("name", NEW)
def test_a_folder_that_has_come_in_the_way_of_a_file_leaves_the_others_as_they_were(tmp_path, name):
    make_old(tmp_path)
    expected = {**OLD}
    with (
        pytest.raises(FileAccessError, match="cannot be replaced: Is a directory"),
        Transaction([tmp_path / one for one in NEW], force=True) as transaction,
    ):
        for one, data in NEW.items():
            transaction.write_bytes(tmp_path / one, data)
        (tmp_path / name).unlink(missing_ok=True)
        (tmp_path / name).mkdir()
        expected.pop(name, None)
    assert contents(tmp_path) == expected


def test_an_old_file_that_cannot_be_kept_is_not_replaced(tmp_path, monkeypatch):
    """Without links it is copied, and the disk may be full."""

    def no_link(*_, **__):
        raise PermissionError(1, "Operation not permitted")

    def full(_, target, **__):
        target.write_bytes(b"ha")
        raise OSError(28, "No space left on device")

    make_old(tmp_path)
    monkeypatch.setattr(os, "link", no_link)
    monkeypatch.setattr(temporary.shutil, "copy2", full)
    with pytest.raises(FileAccessError, match=r"map\.pgm: cannot be replaced: No space left"):
        replace_all(tmp_path)
    assert contents(tmp_path) == OLD


def test_an_old_file_that_cannot_go_back_is_named_and_stays(tmp_path, monkeypatch):
    make_old(tmp_path)
    real = Path.replace

    def refused(self, target):
        if target.name == "map.yaml" or self.suffix == ".old":
            raise PermissionError(1, "Operation not permitted")
        return real(self, target)

    monkeypatch.setattr(Path, "replace", refused)
    with pytest.raises(FileAccessError, match=r"map\.pgm: cannot be put back") as caught:
        replace_all(tmp_path)
    (kept,) = tmp_path.glob("*/.mapdeal-*")
    assert caught.value.hint == f"the old file is {kept}"
    assert kept.read_bytes() == OLD["a/map.pgm"]


KILLED_AT_EACH_STEP = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_transaction import NEW, OLD, contents, make_old, replace_all, without_leftovers
from mapdeal.kernels.threads import use_threads

WATCHED = {"os.rename", "os.link", "os.remove", "open", "os.chmod", "fcntl.flock"}
ORDER = [*NEW, "b/left.txt"]
known = [OLD]
for name in ORDER:
    known.append({**known[-1], name: NEW.get(name)})
known = [{k: v for k, v in one.items() if v is not None} for one in known]
mixed = 0
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
    seen = without_leftovers(contents(folder))
    assert seen in known, (step, seen)
    mixed += seen in known[1:-1]
    replace_all(folder)
    assert contents(folder) == NEW, (step, contents(folder))
    if status == 0:
        break
print(step, mixed)
"""


@pytest.mark.slow
def test_a_kill_at_any_step_leaves_files_old_or_new_in_order_and_the_next_command_cleans_up(
    tmp_path,
):
    words = [sys.executable, "-c", KILLED_AT_EACH_STEP, str(tmp_path), str(Path(__file__).parent)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    steps, mixed = map(int, done.stdout.split())
    assert steps > 20
    assert mixed >= 3  # some kills came between two renames


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


def test_a_file_that_has_come_meanwhile_is_not_replaced_without_force(tmp_path):
    with (
        pytest.raises(FileAccessError, match="exists"),
        Transaction([tmp_path / "a.txt", tmp_path / "b.txt"]) as transaction,
    ):
        transaction.write_bytes(tmp_path / "a.txt", b"new")
        transaction.write_bytes(tmp_path / "b.txt", b"new")
        (tmp_path / "b.txt").write_bytes(b"precious")
    assert contents(tmp_path) == {"b.txt": b"precious"}


def test_a_link_is_replaced_and_what_it_leads_to_stays(tmp_path, monkeypatch):
    make_old(tmp_path)
    (tmp_path / "a" / "map.pgm").rename(tmp_path / "real")
    (tmp_path / "a" / "map.pgm").symlink_to("../real")

    real = Path.unlink

    def refused(self, **options):
        if self.name == "left.txt":
            raise PermissionError(1, "Operation not permitted")
        return real(self, **options)

    with monkeypatch.context() as patch:  # it is put back as a link
        patch.setattr(Path, "unlink", refused)
        with pytest.raises(FileAccessError, match="cannot be removed"):
            replace_all(tmp_path)
    assert (tmp_path / "a" / "map.pgm").readlink() == Path("../real")
    replace_all(tmp_path)
    assert not (tmp_path / "a" / "map.pgm").is_symlink()
    assert contents(tmp_path) == {**NEW, "real": OLD["a/map.pgm"]}


def test_where_there_are_no_locks_old_files_that_are_kept_stay(tmp_path, monkeypatch):
    """A live command may have kept them."""

    def no_locks(*_):
        raise OSError(37, "No locks available")

    (tmp_path / ".mapdeal-0123456789ab.old").write_bytes(b"old")
    with monkeypatch.context() as patch:
        patch.setattr(temporary.fcntl, "flock", no_locks)
        with Transaction([tmp_path / "a.txt"]) as transaction:
            transaction.write_bytes(tmp_path / "a.txt", b"1")
    assert sorted(contents(tmp_path)) == [".mapdeal-0123456789ab.old", "a.txt"]
    with Transaction([tmp_path / "b.txt"]) as transaction:
        transaction.write_bytes(tmp_path / "b.txt", b"2")
    assert sorted(contents(tmp_path)) == ["a.txt", "b.txt"]


def test_a_map_that_is_read_between_two_renames_is_refused(tmp_path, monkeypatch):
    """What was read is the new picture with the old YAML file, which a moment later is another."""
    write_map(tmp_path / "m.yaml", OccupancyGrid([[100, 0]], 0.5))
    real, is_between, has_read = Path.replace, threading.Event(), threading.Event()

    def slow(self, target):
        if target.name == "m.yaml":
            is_between.set()
            assert has_read.wait(60)
        return real(self, target)

    def write():
        write_map(tmp_path / "m.yaml", OccupancyGrid([[0, 100]], 0.25), force=True)

    @contextmanager
    def locked(folders):
        has_read.set()
        with temporary.locked(folders):
            yield

    monkeypatch.setattr(Path, "replace", slow)
    monkeypatch.setattr(maps, "locked", locked)
    writer = threading.Thread(target=write)
    writer.start()
    assert is_between.wait(60)
    with pytest.raises(FileAccessError, match="changed while it was read"):
        maps.read_map(tmp_path / "m.yaml")
    writer.join()
    assert maps.read_map(tmp_path / "m.yaml").resolution == 0.25
