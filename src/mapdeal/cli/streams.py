"""``-`` in the place of a map: from standard input, to standard output."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from inspect import Parameter
from pathlib import Path
from typing import Any

from mapdeal.cli import terminal
from mapdeal.errors import ParameterError

DASH = Path("-")
"""The word ``-``; the file of this name is ``./-``, which is made an absolute path."""


_OUTPUT = "output"


class Streamed:
    """Marks a parameter in whose place ``-`` stands for a standard stream."""

    def __init__(self, *, is_output: bool) -> None:
        self.is_output = is_output


FROM_STDIN, TO_STDOUT = Streamed(is_output=False), Streamed(is_output=True)


def streamed(parameters: list[Parameter]) -> dict[str, bool]:
    return {
        one.name: mark.is_output
        for one in parameters
        for mark in getattr(one.annotation, "__metadata__", ())
        if isinstance(mark, Streamed)
    }


@contextmanager
def piped(values: Mapping[str, Any], marked: Mapping[str, bool]) -> Iterator[dict[str, Any]]:
    """Give the values of a command with files in the place of standard streams.

    When the block ends without an error, the file that stands for standard output is sent.
    """
    inputs = [
        name for name in values
        if name != _OUTPUT and _dashes(values[name]) and not marked.get(name)
    ]  # fmt: skip
    wanted = [name for name in inputs if name in marked]
    output = next((n for n, is_output in marked.items() if is_output and values[n] == DASH), None)
    if not wanted and output is None:
        yield dict(values)
        return
    if wanted and values.get("in_place"):
        rule = "is standard input, which cannot be repaired in place"
        raise ParameterError(rule, source="-", hint="--fix -o OUT writes a repaired map")
    if sum(_dashes(values[name]) for name in inputs) > 1 and wanted:
        rule = "can be used for one input only: standard input is one file"
        raise ParameterError(rule, source="-")
    from mapdeal.files.transaction import temporary_folder
    from mapdeal.inputs.streams import STDOUT, keep_npz

    if output is not None:
        terminal.leave_stdout_to_data()
    if wanted:
        terminal.refuse_keyboard()
    with ExitStack() as stack:
        folder = stack.enter_context(temporary_folder())
        terminal.call_files({folder / f"{STDOUT}.npz": STDOUT})
        files = dict(values)
        for name in wanted:
            kept = keep_npz(terminal.input_chunks(), folder)
            terminal.call_files({kept: "standard input"})
            files[name] = _replaced(values[name], kept)
        if output is not None:
            files[output] = folder / f"{STDOUT}.npz"
        yield files
        if output is not None:
            terminal.send(files[output])


def _dashes(value: object) -> int:
    """Return how often ``-`` stands in the value of a parameter for files."""
    return sum(str(one) == "-" for one in (value if isinstance(value, list) else [value]))


def _replaced(value: Any, path: Path) -> Any:
    if isinstance(value, list):
        return [_replaced(one, path) if _dashes(one) else one for one in value]
    return str(path) if isinstance(value, str) else path
