"""The events of a YAML file as libyaml, which ROS 2 uses, has them.

PyYAML's scanner is libyaml's, but for tabs and byte order marks: libyaml takes tabs behind values
and between words, and a mark for a blank at the start of a line.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

_BREAKS = "\r\n\x85\u2028\u2029"
_ENDS = "\0 \t" + _BREAKS


def events_of(text: str, deepest: int) -> Iterator[yaml.Event]:
    """Yield the events of a text."""
    loader = _Scanner(text, deepest)
    while loader.check_event():
        yield loader.get_event()  # type: ignore[no-untyped-call]


class _Scanner(yaml.SafeLoader):
    """PyYAML's scanner and parser with libyaml's tabs."""

    def __init__(self, text: str, deepest: int) -> None:
        super().__init__(text)
        self._deepest = deepest

    def fetch_flow_collection_start(self, kind: Any) -> None:
        """Scan a bracket; the time for many within each other grows with their square."""
        if self.flow_level >= self._deepest:
            rule = f"nested deeper than {self._deepest} levels"
            raise yaml.scanner.ScannerError(None, None, rule, self.get_mark())
        super().fetch_flow_collection_start(kind)

    def scan_to_next_token(self) -> None:
        """Skip blanks, comments and ends of lines; tabs where no key of a block may start."""
        while True:
            if self.column == 0 and self.peek() == "\ufeff":
                self.forward()
                self.column += 1  # to libyaml a mark is as wide as a blank
            while self.peek() == " " or (
                self.peek() == "\t" and (self.flow_level or not self.allow_simple_key)
            ):
                self.forward()
            if self.peek() == "#":
                while self.peek() not in "\0" + _BREAKS:
                    self.forward()
            if not self._line_break():
                return
            if not self.flow_level:
                self.allow_simple_key = True

    def scan_plain_spaces(self, indent: int, start_mark: yaml.Mark) -> list[str] | None:
        """Return what the blanks within or behind a value without quotes are to it."""
        length = 0
        while self.peek(length) in " \t":
            length += 1
        blanks = self.prefix(length)
        self.forward(length)
        if self.peek() not in _BREAKS:
            return [blanks] if blanks else []
        first = self._line_break()
        self.allow_simple_key = True
        following: list[str] = []
        while not self._is_at_document_end():
            if self.peek() == "\t" and self.column < indent:
                rule = "found a tab character that violates indentation"
                context = "while scanning a plain scalar"
                raise yaml.scanner.ScannerError(context, start_mark, rule, self.get_mark())
            if self.peek() in " \t":
                self.forward()
            elif self.peek() in _BREAKS:
                following.append(self._line_break())
            else:
                lead = [first] if first != "\n" else [] if following else [" "]
                return lead + following
        return None

    def _line_break(self) -> str:
        return str(self.scan_line_break())  # type: ignore[no-untyped-call]

    def _is_at_document_end(self) -> bool:
        return self.column == 0 and self.prefix(3) in ("---", "...") and self.peek(3) in _ENDS
