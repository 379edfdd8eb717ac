"""How ``--help`` is laid out: commands and options in groups, examples at the end."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any, Final

from mapdeal.cli.examples import EXAMPLES

GROUPS: Final = {
    "Maps, distance fields, costmaps": ("run", "active", "inflate", "esdf", "cost"),
    "Questions about a map": ("reach", "query", "route", "potential", "info"),
    "Two maps of one place": ("align", "merge", "diff", "score", "rotate", "rescale", "clean"),
    "Laser scans, point clouds, bags": ("build", "local", "convert"),
    "CI and reports": ("lint", "report", "completion"),
    "Drawing and packing": ("edit", "window", "shift", "pack", "unpack"),
}
"""Commands by the title under which ``mapdeal --help`` lists them."""

_OTHERS = "Other commands"
_COMMON = "Common options"
_LAST = ("Robot", _COMMON)
"""Groups of options that many commands have; they come after a command's own."""

_CONDITIONS = ("With a bag",)


def in_groups(names: Iterable[str]) -> dict[str, list[str]]:
    """Return names of commands by the title of their group, in the order of ``--help``.

    Examples
    --------
    >>> in_groups(["esdf", "smooth", "run"])
    {'Maps, distance fields, costmaps': ['run', 'esdf'], 'Other commands': ['smooth']}
    """
    left = dict.fromkeys(names)
    groups = {
        title: [name for name in members if name in left] for title, members in GROUPS.items()
    }
    grouped = {name for members in groups.values() for name in members}
    groups[_OTHERS] = [name for name in left if name not in grouped]
    return {title: members for title, members in groups.items() if members}


def lay_out(command: Any, name: str) -> None:
    """Make the ``--help`` of a command list its options in groups, and end with examples."""
    command.format_options = partial(_write_options, command, command.format_options)
    command.format_epilog = partial(_write_examples, name)


def write_commands(group: Any, context: Any, formatter: Any) -> None:
    """Write the commands of a group under the titles of `GROUPS`."""
    names = group.list_commands(context)
    for title, members in in_groups(names).items():
        rows = [(name, group.get_command(context, name).short_help) for name in members]
        with formatter.section(title):
            formatter.write_dl(rows, col_max=len(max(names, key=len)))


def sections_of(command: Any, context: Any) -> dict[str, list[tuple[str, str]]]:
    """Return the arguments and options of a command by the title that they stand below."""
    parameters = command.get_params(context)
    sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for parameter in parameters:
        record = parameter.get_help_record(context)
        if record is not None:
            names, text = record
            title, text = _placed(parameter, text, parameters)
            sections.setdefault(title, []).append((names, text))
    ordered = sorted(sections, key=lambda title: title in _LAST)  # others keep their order
    return {title: sections[title] for title in ordered if sections[title]}


def _write_options(command: Any, write_ungrouped: Any, context: Any, formatter: Any) -> None:
    """Write arguments and options; those that have one stand below the title of their group."""
    if hasattr(command, "commands"):
        write_ungrouped(context, formatter)
        return
    for title, rows in sections_of(command, context).items():
        with formatter.section(title):
            formatter.write_dl(rows)


def _placed(parameter: Any, text: str, others: Iterable[Any]) -> tuple[str, str]:
    """Return the title below which a parameter stands, and its help text there.

    Help texts say in their first words with what an option counts: "With a bag: ...", or the
    value of another option, "rings: ...". Below a title that says so they need not.
    """
    if parameter.param_type_name == "argument":
        return "Arguments", text
    title = _COMMON if parameter.name == "help" else getattr(parameter, "rich_help_panel", None)
    if title is not None:
        return title, text
    condition, colon, rest = text.partition(": ")
    if colon and condition in _CONDITIONS:
        return condition, rest[:1].upper() + rest[1:]
    for other in others:
        if condition in (other.metavar or "").split("|") + list(getattr(other.type, "choices", ())):
            return f"With {other.opts[0]} {condition}", rest[:1].upper() + rest[1:]
    return "Options", text


def _example_of(name: str) -> str:
    from mapdeal.command import commands_named  # which loads numpy

    first, _, rest = name.partition(" ")
    own = commands_named(first).get(rest)
    return EXAMPLES.get(name, "") if own is None else own.example


def _write_examples(name: str, _context: Any, formatter: Any) -> None:
    lines = _example_of(name).splitlines()
    if lines:  # the command of a new stage has none
        with formatter.section("Examples"):
            for line in lines:
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")
