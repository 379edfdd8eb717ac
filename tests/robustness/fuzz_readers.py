"""Feed damaged files to every reader.

Run it as ``python tests/robustness/fuzz_readers.py [--inputs 200000] [--seed 1] [--reader NAME]``;
the suite does the same with fewer mutants, see test_fuzz.py. Readers and good files stand in
readers.py, the checks of their results in reading.py, the damage in mutation.py. Given any file,
a reader gives a result that keeps what its format promises, or raises those errors that
are meant for it; it warns by mapdeal's warnings alone, writes nothing to the terminal, ends soon,
and takes no more than 256 MiB. Ends with exit code 1 if anything is wrong.
"""

import argparse
import random
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
from robustness.mutation import mutant
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
    """Fuzz, and print the problems that were found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", help="only those with this in their name")
    options = parser.parse_args()
    readers = [reader for reader in READERS if (options.reader or "") in reader.name]
    each, problems = options.inputs / sum(reader.share for reader in readers), 0
    print("| reader | read | refused | wrong | seconds | slowest |\n|---|---|---|---|---|---|")
    for reader in readers:
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as name:
            found = fuzz(reader, round(each * reader.share), Path(name), options.seed, LONGEST)
        problems += len(found.problems)
        counts = f"{found.read} | {found.refused} | {len(found.problems)}"
        seconds = f"{time.perf_counter() - started:.1f} | {found.slowest:.2f}"
        print(f"| {reader.name} | {counts} | {seconds} |", flush=True)
        for problem in sorted(found.problems, key=len)[:5]:
            print(problem)
    return bool(problems)


def fuzz(reader, mutants, folder, seed, longest):
    """Feed a reader so many mutants, by way of files in a folder.

    `seed` and the reader's name decide which. A mutant that takes more than `longest` seconds is
    a problem.
    """
    rng, found = random.Random(f"{reader.name} {seed}"), Found()
    read_seeds(reader, folder / "good")  # late imports do not count as memory of the reader
    paths = _files_of(reader.seeds, folder)
    alike = {good.packed: [like.data for like in reader.seeds if like.packed == good.packed]
             for good in reader.seeds}  # fmt: skip
    with use_memory(MEMORY, is_chosen=False), _watched() as caught:
        for number in range(mutants):
            good, path = rng.choice(list(zip(reader.seeds, paths, strict=True)))
            data = good.packed(mutant(good.data, alike[good.packed], reader.words, rng))
            path.write_bytes(data)
            started = time.perf_counter()
            problem = _problem_of(reader, path, data, found, longest)
            found.slowest = max(found.slowest, time.perf_counter() - started)
            for warning in caught:
                if problem is None and not issubclass(warning.category, MapdealWarning):
                    source = f"{warning.message} ({warning.filename})"
                    problem = f"warned by {warning.category.__name__}: {source}"
            caught.clear()
            if problem is not None:
                found.problems.append(f"{reader.name} {number}: {problem}\n    {data!r}")
    return found


def read_seeds(reader, folder):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapdealWarning)
        return [reader.read(path, path.read_bytes()) for path in _files_of(reader.seeds, folder)]


def _problem_of(reader, path, data, found, longest):
    try:
        _read_within(reader, path, data, longest)
    except reader.refusals as error:
        found.refused += 1
        return _problem_of_error(error, path if reader.is_file else None, len(data))
    except MapdealError as error:
        return f"refused as {type(error).__name__}: {error}"
    except TooLongError:
        return f"took more than {longest:g} s: {_last_lines()}"
    except Exception:  # noqa: BLE001 - what is sought
        return _last_lines()
    found.read += 1
    return None


def _read_within(reader, path, data, longest):
    """Read, and stop the clock before an error is looked at: tracebacks take long to format."""
    signal.setitimer(signal.ITIMER_REAL, longest)
    try:
        reader.read(path, data)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _problem_of_error(error, path, length):
    text = str(error)
    if not text.isprintable() or len(text) > _LONGEST_MESSAGE + 4 * length:
        return f"no clear line: {text!r}"
    return None if path is None or text.startswith(str(path.parent)) else f"names no file: {text}"


def _last_lines():
    return " | ".join(line.strip() for line in traceback.format_exc().splitlines()[-3:])


def _files_of(seeds, folder):
    """Write each seed and its side files into a folder; return the paths."""
    for index, good in enumerate(seeds):
        for name, data in {**good.beside, good.name or "text": good.packed(good.data)}.items():
            path = folder / str(index) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    return [folder / str(index) / (good.name or "text") for index, good in enumerate(seeds)]


@contextmanager
def _watched():
    """Yield the list of warnings; limit memory, if the system reports it, and time."""

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
