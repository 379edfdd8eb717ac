"""Feed damaged files to every reader.

Run it as ``python tests/robustness/fuzz_readers.py [--inputs 200000] [--seed 1] [--reader NAME]``;
the suite does the same with fewer mutants, see test_fuzz.py. Readers and good files stand in
readers.py, what must hold of what they return in reading.py, the damage in mutation.py. Whatever it
is given, a reader gives a result that keeps what its format promises, or raises those errors that
are meant for it; it warns by mapdeal's warnings alone, writes nothing to the terminal, ends soon,
and takes no more than 256 MiB. Ends with exit code 1 if anything is wrong.
"""

import argparse
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from mapdeal.errors import MapdealError, MapdealWarning
from mapdeal.files.source import use_memory
from robustness.mutation import Dice, mutant
from robustness.readers import READERS
from robustness.reading import MEMORY

LONGEST = 5.0
"""Seconds for a mutant, when there is nothing else to do for the machine."""

_MORE_MEMORY = 256 << 20
_LONGEST_MESSAGE = 1000
"""Characters, beside a name that is as long as it is."""


class TooLongError(BaseException):
    """A reader has not ended; no reader catches this by accident."""


@dataclass
class Found:
    """What a reader has made of its mutants: results, errors meant for it, and problems."""

    read: int = 0
    refused: int = 0
    problems: list[str] = field(default_factory=list)
    slowest: float = 0.0
    """Seconds that one has taken, the longest."""


def main():
    """Fuzz, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", help="only those with this in their name")
    options = parser.parse_args()
    readers = [one for one in READERS if (options.reader or "") in one.name]
    each = options.inputs / sum(reader.share for reader in readers)
    problems = 0
    print("| reader | read | refused | wrong | seconds | slowest |\n|---|---|---|---|---|---|")
    for reader in readers:
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as name:
            found = fuzz(reader, round(each * reader.share), Path(name), options.seed, LONGEST)
        seconds = time.perf_counter() - started
        problems += len(found.problems)
        print(f"| {reader.name} | {found.read} | {found.refused} | {len(found.problems)} "
              f"| {seconds:.1f} | {found.slowest:.2f} |", flush=True)  # fmt: skip
        for problem in sorted(found.problems, key=len)[:5]:
            print(problem)
    return bool(problems)


def fuzz(reader, mutants, folder, seed, longest):
    """Feed a reader so many mutants, by way of files in a folder.

    `seed` and the reader's name decide which. A mutant that takes more than `longest` seconds is
    a problem.
    """
    dice = Dice(f"{reader.name} {seed}")
    found = Found()
    read_seeds(reader, folder / "good")  # what is imported late is not counted as theirs
    alike = {one.packed: [other.data for other in reader.seeds if other.packed == one.packed]
             for one in reader.seeds}  # fmt: skip
    with (
        _files_of(reader.seeds, folder) as files,
        use_memory(MEMORY, is_chosen=False),
        _watched() as caught,
    ):
        for number in range(mutants):
            index = dice.below(len(reader.seeds))
            good = reader.seeds[index]
            data = good.packed(mutant(good.data, alike[good.packed], reader.words, dice))
            _write(files[index][1], data)
            started = time.perf_counter()
            problem = _problem_of(reader, files[index][0], data, found, longest)
            found.slowest = max(found.slowest, time.perf_counter() - started)
            for warning in caught if problem is None else ():
                problem = problem or _problem_of_warning(warning)
            caught.clear()
            if problem is not None:
                found.problems.append(f"{reader.name} {number}: {problem}\n    {data!r}")
    return found


def read_seeds(reader, folder):
    """Return what a reader makes of its good files."""
    with _files_of(reader.seeds, folder) as files, warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        results = []
        for good, (path, descriptor) in zip(reader.seeds, files, strict=True):
            data = good.packed(good.data)
            _write(descriptor, data)
            results.append(reader.read(path, data))
        return results


def _problem_of(reader, path, data, found, longest):
    """Return what is wrong with how a reader takes some data, None if nothing is."""
    signal.setitimer(signal.ITIMER_REAL, longest)
    try:
        reader.read(path, data)
    except reader.refusals as error:
        found.refused += 1
        return _problem_of_error(error, path if reader.is_file else None, len(data))
    except MapdealError as error:
        return f"refused as {type(error).__name__}: {error}"
    except TooLongError:
        return f"took more than {longest:g} s: {_last_lines()}"
    except Exception:  # noqa: BLE001 - what is sought
        return _last_lines()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    found.read += 1
    return None


def _problem_of_error(error, path, length):
    text = str(error)
    if not text.isprintable() or len(text) > _LONGEST_MESSAGE + 4 * length:
        return f"no clear line: {text!r}"
    is_named = path is None or text.startswith(str(path.parent))
    return None if is_named else f"names no file: {text}"


def _problem_of_warning(warning):
    if issubclass(warning.category, MapdealWarning):
        return None
    return f"warned by {warning.category.__name__}: {warning.message} ({warning.filename})"


def _last_lines():
    return " | ".join(line.strip() for line in traceback.format_exc().splitlines()[-3:])


@contextmanager
def _files_of(seeds, folder):
    """Give path and descriptor of a file for each seed, in a folder with what stands beside it."""
    files = []
    try:
        for index, good in enumerate(seeds):
            own = folder / str(index)
            for name, data in {**good.beside, good.name or "text": b""}.items():
                (own / name).parent.mkdir(parents=True, exist_ok=True)
                (own / name).write_bytes(data)
            path = own / (good.name or "text")
            files.append((path, os.open(path, os.O_WRONLY)))
        yield files
    finally:
        for _, descriptor in files:
            os.close(descriptor)


def _write(descriptor, data):
    os.pwrite(descriptor, data, 0)
    os.ftruncate(descriptor, len(data))


@contextmanager
def _watched():
    """Give the list that warnings go to; hold memory, where the system tells it, and time."""

    def end(*_):
        raise TooLongError

    before = signal.signal(signal.SIGALRM, end)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    status = Path("/proc/self/statm")
    if status.exists():
        size = int(status.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + _MORE_MEMORY, hard))
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield caught
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)


if __name__ == "__main__":
    sys.exit(main())
