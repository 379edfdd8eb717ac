"""What ``mapdeal info`` prints of a bag."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from mapdeal.errors import one_line

_LATEST = 253402300799
"""Seconds up to which Python has dates: the year 9999."""


def text_of_bag(report: dict[str, Any]) -> str:
    """Return what there is to say of a bag, for a person."""
    lines = [f"  {name:<11} {value}" for name, value in _rows(report)]
    return "\n".join(one_line(line) for line in [str(report["file"]), *lines])


def _rows(report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "kind", report["is"]
    yield "messages", _when(report)
    for index, line in enumerate(_table(report["topics"])):
        yield "topics" if index == 0 else "", line
    for index, line in enumerate(_transforms(report["transforms"])):
        yield "transforms" if index == 0 else "", line
    for index, line in enumerate(report["use"]):
        yield "use" if index == 0 else "", line


def _when(report: dict[str, Any]) -> str:
    if not report["messages"]:
        return "none"
    text = f"{report['messages']} in {report['duration_s']:.6g} s"
    seconds = report["start_ns"] / 1e9
    if 0 < seconds <= _LATEST:
        text += f", from {datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
    return text


def _table(topics: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each topic, in columns."""
    rows = [
        (
            one["topic"],
            one["type"],
            str(one["count"]),
            "" if one["frame"] is None else f"in {one['frame']}",
            f"for {', '.join(one['commands'])}" if one["commands"] else "",
        )
        for one in topics
    ]
    widths = [max((len(row[k]) for row in rows), default=0) for k in range(5)]
    for row in rows:
        topic, name, count, frame, use = row
        yield (
            f"{topic:<{widths[0]}}  {name:<{widths[1]}}  {count:>{widths[2]}}  "
            f"{frame:<{widths[3]}}  {use}"
        ).rstrip()


def _transforms(edges: list[dict[str, Any]]) -> Iterator[str]:
    width = max((len(f"{one['parent']} -> {one['child']}") for one in edges), default=0)
    digits = max((len(str(one["count"])) for one in edges), default=0)
    for one in edges:
        edge = f"{one['parent']} -> {one['child']}"
        yield f"{edge:<{width}}  {one['count']:>{digits}} on {one['topic']}"
