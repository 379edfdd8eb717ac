"""How ``--help`` is laid out: commands and options in groups, examples at the end."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mapdeal.cli import terminal

GROUPS = (
    "Maps, distance fields, costmaps", "Questions about a map", "Changing a map",
    "Two maps of one place", "Laser scans and point clouds", "Formats", "CI and reports",
)  # fmt: skip
"""Titles under which ``mapdeal --help`` lists commands, in its order."""

_COMMON = "Common options"
_LAST = ("Robot", _COMMON)  # groups of options that many commands have, after a command's own


def in_groups(group: Any, context: Any, names: Iterable[str] = ()) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {title: [] for title in GROUPS}
    for name in names or group.list_commands(context):
        command = group.get_command(context, name)
        found.setdefault(command.rich_help_panel or "Other commands", []).append(command)
    return {title: members for title, members in found.items() if members}


def lay_out(command: Any) -> None:
    def write_options(context: Any, formatter: Any) -> None:
        for title, rows in sections_of(command, context).items():
            with formatter.section(terminal.bold(title)):
                formatter.write_dl(rows)

    def write_examples(_: Any, formatter: Any) -> None:
        with formatter.section("Examples"):
            for line in command.epilog.splitlines():
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")

    if not hasattr(command, "commands"):
        command.format_options = write_options
    if command.epilog:
        command.format_epilog = write_examples


FIRST = ("run", "view", "info", "reach", "clean", "diff", "build", "lint")


def overview(group: Any, context: Any) -> str:
    formatter = context.make_formatter()
    formatter.write("Process robot map files without ROS.\n\n")
    formatter.write("Start with: mapdeal run MAP.yaml -o out\n")
    write_commands(group, context, formatter, names=FIRST)
    text = "mapdeal --help lists all commands, mapdeal help COMMAND shows one with examples."
    return f"{formatter.getvalue()}\n{text}"


def write_commands(group: Any, context: Any, formatter: Any, *, names: Iterable[str] = ()) -> None:
    groups = in_groups(group, context, names)
    longest = max(len(command.name) for members in groups.values() for command in members)
    for title, members in groups.items():
        with formatter.section(terminal.bold(title)):
            rows = [(command.name, command.short_help) for command in members]
            formatter.write_dl(rows, col_max=longest)


def sections_of(command: Any, context: Any) -> dict[str, list[tuple[str, str]]]:
    parameters = command.get_params(context)
    sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for parameter in parameters:
        if record := parameter.get_help_record(context):
            names, text = record
            title, text = _placed(parameter, text, parameters)
            sections.setdefault(title, []).append((names, text))
    ordered = sorted(sections, key=lambda title: title in _LAST)  # others keep their order
    return {title: sections[title] for title in ordered if sections[title]}


def _placed(parameter: Any, text: str, parameters: Iterable[Any]) -> tuple[str, str]:
    # Texts begin with what an option counts with: "With a bag: ...", or a value, "rings: ...".
    if parameter.param_type_name == "argument":
        return "Arguments", text
    title = _COMMON if parameter.name == "help" else getattr(parameter, "rich_help_panel", None)
    if title is not None:
        return title, text
    condition, colon, meaning = text.partition(": ")
    meaning = meaning[:1].upper() + meaning[1:]
    if colon and condition == "With a bag":
        return condition, meaning
    for choice in parameters:
        if condition in [*(choice.metavar or "").split("|"), *getattr(choice.type, "choices", ())]:
            return f"With {choice.opts[0]} {condition}", meaning
    return "Options", text
