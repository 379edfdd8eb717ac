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

from mapdeal import FileAccessError, OccupancyGrid, write_map
from mapdeal.files import transaction as temporary
from mapdeal.files.transaction import Transaction
from mapdeal.kernels.threads import use_threads
from mapdeal.maps import reading as maps


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def without_leftovers(found):
    return {name: data for name, data in found.items() if ".mapdeal-" not in name}


def _writer(text):
    return lambda file: file.write(text.encode())


def _refused(*_, **__):
    raise PermissionError(1, "Operation not permitted")


def _full(*_, **__):
    raise OSError(28, "No space left on device")


def test_nothing_appears_before_the_end(tmp_path):
    one, two = tmp_path / "one.txt", tmp_path / "two.txt"
    with Transaction([one, two], checksums=True) as transaction:
        transaction.write(one, _writer("1"))
        assert transaction.checksums() == {one: hashlib.sha256(b"1").hexdigest()}
        transaction.write_parts(two, iter([b"2", b"", b"34"]))
        assert transaction.checksums()[two] == hashlib.sha256(b"234").hexdigest()
        assert not one.exists()
        assert not two.exists()
    assert contents(tmp_path) == {"one.txt": b"1", "two.txt": b"234"}


def _fails_in_a_part(transaction, path, patch):
    patch.setattr(temporary._File, "write", _full)
    transaction.write_parts(path, [b"new"])


def _fails_at_the_end(transaction, path, patch):
    patch.setattr(os, "fsync", _full)
    transaction.write(path, _writer("new"))


def _fails_in_the_writer(transaction, path, _):
    transaction.write(path, _full)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("fail", [_fails_in_a_part, _fails_at_the_end, _fails_in_the_writer])
def test_a_failure_leaves_nothing_and_old_files_as_they_were(tmp_path, monkeypatch, fail, threads):
    old, new = tmp_path / "old.txt", tmp_path / "folder" / "new.txt"
    old.write_bytes(b"before")
    with (
        pytest.raises(FileAccessError, match=r"\.txt: cannot be written: No space left"),
        use_threads(threads),
        Transaction([old, new], force=True) as transaction,
    ):
        transaction.write(old, _writer("after"))
        fail(transaction, new, monkeypatch)
    assert contents(tmp_path) == {"old.txt": b"before"}
    assert [path.name for path in tmp_path.iterdir()] == ["old.txt"]


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


def test_files_of_a_killed_run_are_removed_and_those_of_a_live_one_kept(tmp_path):
    """Locks are those of open files: another transaction is as good as another process."""
    stale = tmp_path / ".mapdeal-0123456789ab.tmp"
    stale.write_bytes(b"half")
    with Transaction([tmp_path / "live.txt"], checksums=True) as live:
        assert not stale.exists()
        live.write(tmp_path / "live.txt", _writer("x"))
        live.checksums()
        mine = set(tmp_path.iterdir())
        assert len(mine) == 1
        with Transaction([tmp_path / "third.txt"]) as transaction:
            transaction.write(tmp_path / "third.txt", _writer("3"))
        assert set(tmp_path.iterdir()) == mine | {tmp_path / "third.txt"}
    assert contents(tmp_path) == {"live.txt": b"x", "third.txt": b"3"}


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
    done, surprises = threading.Event(), []

    def fail():
        while not done.is_set():
            try:
                with Transaction([other]):
                    raise KeyError
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
    assert {type(one) for one in surprises} == {KeyError}


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
        with use_threads(count), Transaction([tmp_path / "1"], force=True) as transaction:
            transaction.write(tmp_path / "1", lambda _: seen.append(threading.get_ident()))
    assert seen[0] == threading.get_ident() != seen[1]


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


@pytest.fixture
def old(tmp_path):
    """A folder of files that `replace_all` replaces and removes."""
    make_old(tmp_path)
    return tmp_path


def test_files_are_replaced_and_removed_together(old):
    replace_all(old)
    assert contents(old) == NEW


@pytest.mark.parametrize("has_links", [True, False], ids=["links", "no links"])
@pytest.mark.parametrize("operation", ["replace", "unlink"])
def test_a_failure_at_any_step_puts_everything_back(tmp_path, monkeypatch, operation, has_links):
    if not has_links:
        monkeypatch.setattr(os, "link", _refused)
    real, failed = getattr(Path, operation), 0
    for step in range(20):
        folder = tmp_path / str(step)
        folder.mkdir()
        make_old(folder)
        calls = []

        def fail_once(self, *args, step=step, calls=calls, **options):
            calls.append(self)
            return (_refused if len(calls) == step + 1 else real)(self, *args, **options)

        with monkeypatch.context() as patch:
            patch.setattr(Path, operation, fail_once)
            try:
                replace_all(folder)
            except FileAccessError as error:
                failed += 1
                assert "Operation not permitted" in str(error)
                assert contents(folder) == OLD
                assert {stat.S_IMODE((folder / name).stat().st_mode) for name in OLD} == {0o640}
            else:  # or it did not matter: what is left of it goes with the next command
                assert without_leftovers(contents(folder)) == NEW
        if len(calls) <= step:
            break
    assert len(calls) <= step
    assert failed == {"replace": 3, "unlink": 1}[operation]


@pytest.mark.parametrize("name", NEW)
def test_a_folder_that_has_come_in_the_way_of_a_file_leaves_the_others_as_they_were(old, name):
    expected = {**OLD}
    with (
        pytest.raises(FileAccessError, match="cannot be replaced: Is a directory"),
        Transaction([old / one for one in NEW], force=True) as transaction,
    ):
        for one, data in NEW.items():
            transaction.write_bytes(old / one, data)
        (old / name).unlink(missing_ok=True)
        (old / name).mkdir()
        expected.pop(name, None)
    assert contents(old) == expected


def test_an_old_file_that_cannot_be_kept_is_not_replaced(old, monkeypatch):
    """Without links it is copied, and the disk may be full."""

    def half(_, target, **__):
        target.write_bytes(b"ha")
        _full()

    monkeypatch.setattr(os, "link", _refused)
    monkeypatch.setattr(temporary.shutil, "copy2", half)
    with pytest.raises(FileAccessError, match=r"map\.pgm: cannot be replaced: No space left"):
        replace_all(old)
    assert contents(old) == OLD


def test_an_old_file_that_cannot_go_back_is_named_and_stays(old, monkeypatch):
    real = Path.replace

    def replace(self, target):
        is_refused = target.name == "map.yaml" or self.suffix == ".old"
        return (_refused if is_refused else real)(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(FileAccessError, match=r"map\.pgm: cannot be put back") as caught:
        replace_all(old)
    (kept,) = old.glob("*/.mapdeal-*")
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
def test_signals_wait_for_the_last_rename(old, monkeypatch, number):
    def end(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    real, seen = Path.replace, []

    def send_first(self, target):
        signal.raise_signal(number)
        seen.append(target.name)
        return real(self, target)

    monkeypatch.setattr(Path, "replace", send_first)
    try:
        with pytest.raises(KeyboardInterrupt):
            replace_all(old)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen == ["map.pgm", "map.yaml", "picture.png"]
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
    real = Path.unlink

    def unlink(self, **options):
        return (_refused if self.name == "left.txt" else real)(self, **options)

    with monkeypatch.context() as patch:  # it is put back as a link
        patch.setattr(Path, "unlink", unlink)
        with pytest.raises(FileAccessError, match="cannot be removed"):
            replace_all(old)
    assert (old / "a" / "map.pgm").readlink() == Path("../real")
    replace_all(old)
    assert not (old / "a" / "map.pgm").is_symlink()
    assert contents(old) == {**NEW, "real": OLD["a/map.pgm"]}


def test_where_there_are_no_locks_old_files_that_are_kept_stay(tmp_path, monkeypatch):
    """A live command may have kept them."""
    kept = tmp_path / ".mapdeal-0123456789ab.old"
    kept.write_bytes(b"old")
    for is_kept in (True, False):
        with monkeypatch.context() as patch:
            if is_kept:
                patch.setattr(temporary.fcntl, "flock", _full)
            with Transaction([tmp_path / f"{is_kept}.txt"]) as transaction:
                transaction.write_bytes(tmp_path / f"{is_kept}.txt", b"1")
        assert kept.exists() == is_kept


def test_a_map_that_is_read_between_two_renames_is_refused(tmp_path, monkeypatch):
    """What was read is the new picture with the old YAML file, which a moment later is another."""
    path = tmp_path / "m.yaml"
    write_map(path, OccupancyGrid([[100, 0]], 0.5))
    real, is_between, has_read = Path.replace, threading.Event(), threading.Event()

    def slow(self, target):
        if target.name == "m.yaml":
            is_between.set()
            assert has_read.wait(60)
        return real(self, target)

    def locked(folders):
        has_read.set()
        return temporary.locked(folders)

    monkeypatch.setattr(Path, "replace", slow)
    monkeypatch.setattr(maps, "locked", locked)
    new = OccupancyGrid([[0, 100]], 0.25)
    writer = threading.Thread(target=write_map, args=(path, new), kwargs={"force": True})
    writer.start()
    assert is_between.wait(60)
    with pytest.raises(FileAccessError, match="changed while it was read"):
        maps.read_map(path)
    writer.join()
    assert maps.read_map(path).resolution == 0.25
