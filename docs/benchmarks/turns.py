"""What the benchmarks share: contenders that take turns, and tables of their times.

They run A B C A B C, after a turn that is a warm-up, so that a drift of the machine's speed falls
on all of them, and each ratio is of two that ran beside each other.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

Contender = Callable[[], Any] | list[str]  # a function, or the words of a command


class Times(NamedTuple):
    """What a contender took, turn by turn; the peak of memory is known of commands."""

    seconds: list[float]
    processor: list[float]
    mebibytes: list[float]

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    @property
    def ms(self) -> str:
        return f"{1e3 * self.median:.4g}"

    @property
    def spread(self) -> str:
        return f"{min(self.seconds):.2f}..{max(self.seconds):.2f}"


def in_turns(
    contenders: Mapping[str, Contender], runs: int, *, warm_ups: int = 1, clear: str = ""
) -> dict[str, Times]:
    """Return what each contender took; a folder to clear is removed after each, unmeasured."""
    times = {name: Times([], [], []) for name in contenders}
    for turn in range(warm_ups + runs):
        for name, contender in contenders.items():
            taken = _run(contender) if isinstance(contender, list) else _call(contender)
            shutil.rmtree(clear, ignore_errors=True)
            if turn >= warm_ups:
                for column, value in zip(times[name], taken, strict=True):
                    column.append(value)
    return times


def _call(work: Callable[[], Any]) -> tuple[float, float, float]:
    started, used = time.perf_counter(), time.process_time()
    result = work()
    taken = time.perf_counter() - started, time.process_time() - used, 0.0
    del result  # after the clock has stopped
    return taken


def _run(words: list[str]) -> tuple[float, float, float]:
    # compiled bytecode is kept, as in any installation
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    started = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{words} ended with {process.returncode}")
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def write_map(side: int, path: Path) -> None:
    """Write an office's map in another process: peaks of children begin with that of this one."""
    words = [sys.executable, str(Path(__file__).parent / "make_map.py"), str(side), str(path)]
    subprocess.run(words, check=True)


def ratio(ours: Times, theirs: Times, of: str = "seconds") -> str:
    """Return the median of the ratios of neighbouring turns."""
    pairs = zip(getattr(ours, of), getattr(theirs, of), strict=True)
    return f"{statistics.median(a / b for a, b in pairs):.3g}"


def head(*names: str) -> None:
    row(*names)
    print("|---" * len(names) + "|")


def row(*cells: object) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def options(doc: str, **defaults: Any) -> argparse.Namespace:
    """Return the options given: numbers with these defaults, several for a list, or paths."""
    parser = argparse.ArgumentParser(description=doc.partition("\n")[0])
    for name, value in defaults.items():
        kind = Path if value is None else int
        many = "+" if isinstance(value, list) else None
        parser.add_argument(f"--{name}", type=kind, nargs=many, default=value)
    return parser.parse_args()
