"""Write the tables in the documentation that repeat definitions of the code.

Run it as ``python docs/tables.py`` after a change to an option or a stage; ``--check`` writes
nothing and exits with 1 if a page would change.

A table stands between two comments. The words of the first say what it is made of::

    <!-- options of inflate -->

    | option | default | meaning |
    ...

    <!-- end -->

`PAGES` says which function makes a table of these words.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import typer

from mapdeal.cli.main import app, command_names
from mapdeal.cli.shared_options import SHARED_OPTIONS, expanded
from mapdeal.command import Parameter, Stage, meanings_of
from mapdeal.grid.costmap import Costmap, InflationLayer, StaticLayer
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline.folder import paths_of
from mapdeal.pipeline.step import Step
from mapdeal.stages.catalogue import STAGE_NAMES, STAGES, stage_named
from mapdeal.stages.structured import LayerList, described_layer

DOCS = Path(__file__).parent

MadeTable = Callable[[str], str]

_END = "end"
_COMMENT = re.compile(r"^<!-- (.+?) -->\n", re.MULTILINE)
_REMARK = re.compile(r"  \[(default: )?(.+)\]$")
_CODE = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*|(?<![^\s(])\.[a-z]{2,4}\b|\bmapdeal\[\w+\]")


def main(words: Sequence[str]) -> int:
    """Write the pages that are not as they should be, or only name them."""
    is_check = list(words) == ["--check"]
    if words and not is_check:
        print(f"usage: {Path(__file__).name} [--check]", file=sys.stderr)
        return 2
    changed = []
    for name, makers in PAGES.items():
        page = DOCS / name
        text = page.read_text()
        made = with_tables(text, makers)
        if made != text:
            changed.append(name)
            if not is_check:
                page.write_text(made)
    for name in changed:
        print(f"{name}: {'is out of date; run docs/tables.py' if is_check else 'written'}")
    return 1 if is_check and changed else 0


def with_tables(text: str, makers: dict[str, MadeTable]) -> str:
    """Return the text of a page with its tables made anew.

    Parameters
    ----------
    text : str
        The page.
    makers : dict
        Function that makes a table, by the words that its comment begins with. It is called
        with the rest of the words.

    Raises
    ------
    ValueError
        If a comment is of no table, or a table has no end.
    """
    parts, position = [], 0
    comments = list(_COMMENT.finditer(text))
    for start, end in zip(comments[::2], [*comments[1::2], None], strict=False):
        words = start[1]
        maker = next((prefix for prefix in makers if f"{words} ".startswith(f"{prefix} ")), None)
        if maker is None or end is None or end[1] != _END:
            raise ValueError(f"no table and its end: <!-- {words} -->")
        table = makers[maker](words[len(maker) :].strip())
        parts += [text[position : start.end()], f"\n{table}\n", end[0]]
        position = end.end()
    return "".join([*parts, text[position:]])


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; a ``|`` within a cell is escaped, within code, too."""
    escaped = [[cell.replace("|", "\\|") for cell in line] for line in (head, *rows)]
    lines = [f"| {' | '.join(line)} |".replace("|  |", "| |") for line in escaped]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:], ""])


def options_of(names: str) -> str:
    """Return the table of a command's own arguments and options.

    Of several commands, ``edit line, edit circle``, it has a column that says whose option it is.
    """
    commands = names.split(", ")
    found: dict[str, dict[tuple[str, ...], list[str]]] = {}
    for name in commands:
        for parameter in _sorted(_command(name).params):
            row = _row(parameter)
            if not _is_shared(parameter):
                owners = found.setdefault(parameter.name, {}).setdefault(row, [])
                owners.append(name.split()[-1])
    rows = [(row, of) for same in found.values() for row, of in same.items()]
    if len(commands) == 1:
        return markdown_table(["option", "default", "meaning"], [row for row, _ in rows])
    return markdown_table(
        ["option", "of", "default", "meaning"],
        [
            (option, "all" if len(of) == len(commands) else ", ".join(of), default, meaning)
            for (option, default, meaning), of in rows
        ],
    )


def shared_options(names: str) -> str:
    """Return the table of shared options, by their names and those of their groups."""
    having = {name: {one.name: one for one in _parameters(name)} for name in command_names()}
    rows = []
    for name in expanded(names.split(", ")):
        if name not in SHARED_OPTIONS:
            raise ValueError(f"no shared option {name!r}")
        commands = [command for command in command_names() if name in having[command]]
        same = [having[command][name] for command in commands if _is_shared(having[command][name])]
        rows.append((*_row(same[0]), _listed(commands)))
    return markdown_table(["option", "default", "meaning", "commands"], rows)


def _listed(commands: list[str]) -> str:
    """Return which commands have something, or which ones do not if these are fewer."""
    others = [name for name in command_names() if name not in commands]
    names = others if len(others) < len(commands) else commands
    listed = ", ".join(f"`{name}`" for name in names)
    if not others:
        return "all"
    return f"all but {listed}" if names is others else listed


def _command(name: str) -> Any:
    command = typer.main.get_command(app)
    for word in name.split():
        command = command.get_command(None, word)  # type: ignore[attr-defined]
        if command is None:
            raise ValueError(f"no command {name!r}")
    return command


def _parameters(name: str) -> list[Any]:
    """Return the parameters of a command, or of all commands of a group."""
    command = _command(name)
    of_group = getattr(command, "commands", {}).values()
    return list(chain(command.params, *(one.params for one in of_group)))


def _sorted(parameters: Iterable[Any]) -> list[Any]:
    """Return parameters with the arguments first, as they are written."""
    return sorted(parameters, key=lambda parameter: parameter.param_type_name != "argument")


def _is_shared(parameter: Any) -> bool:
    """Return whether an option is a shared one, with the text that all commands have."""
    shared = SHARED_OPTIONS.get(parameter.name)
    return shared is not None and parameter.help == shared.option.help


def _row(parameter: Any) -> tuple[str, str, str]:
    """Return option, default and meaning, as cells."""
    if not parameter.help:
        raise ValueError(f"no help text of {parameter.name!r}")
    text, remark = parameter.help, ""
    default = "required" if parameter.required else _shown(parameter.default)
    if match := _REMARK.search(text):
        text = text[: match.start()]
        if match[1]:
            default = match[2]
        else:
            remark = f" {match[2][0].upper()}{match[2][1:]}."
    return _names(parameter), _with_code(default), _with_code(text + remark)


def _with_code(text: str) -> str:
    return _CODE.sub(lambda code: f"`{code[0]}`", text)


def _shown(default: Any) -> str:
    return "" if default is None or isinstance(default, bool) else str(default)


def _names(parameter: Any) -> str:
    """Return how an option is written, its short name first, with its value."""
    metavar = parameter.metavar or "|".join(getattr(parameter.type, "choices", ()))
    if parameter.param_type_name == "argument":
        return f"`{metavar}`"
    names = sorted([*parameter.opts, *parameter.secondary_opts], key=lambda name: name[:2] == "--")
    if not getattr(parameter, "is_flag", False):
        names[-1] += f" {metavar or parameter.type.name.upper()}"
    return ", ".join(f"`{name}`" for name in names)


def parameters_of(words: str) -> str:
    """Return the table of a stage's parameters: of its name, and its model if it has several."""
    try:
        stage = stage_named(*words.split())
    except KeyError:
        raise ValueError(f"no stage {words!r}") from None
    return markdown_table(
        ["parameter", "default", "unit", "meaning"],
        [
            (
                f"`{name}`",
                _default_of(parameter),
                parameter.unit.symbol if parameter.unit else "m" * (parameter.kind is Footprint),
                stage.meanings[name].replace("``", "`"),
            )
            for name, parameter in stage.parameters.items()
        ],
    )


def layers_of_costmaps(_: str) -> str:
    """Return the table of the layers that a costmap can have, and what can be set of each."""
    rows = []
    for layer in (StaticLayer(), InflationLayer()):
        ((kind, values),) = described_layer(layer).items()
        meanings = meanings_of(type(layer))
        for name, default in values.items():
            words = {None: "none", True: "yes", False: "no"}
            told = words[default] if default is None or isinstance(default, bool) else str(default)
            rows.append((f"`{kind}`", f"`{name}`", told, meanings[name].replace("``", "`")))
    return markdown_table(["layer", "parameter", "default", "meaning"], rows)


def stages(_: str) -> str:
    """Return the table of all stages: their files in a run, and the memory that they take."""
    return markdown_table(
        ["stage", "model", "files in a folder of outputs", "works on", "bytes a cell in memory"],
        [
            (
                f"`{stage.name}`",
                f"`{stage.model}`" if stage.model else "",
                ", ".join(f"`{path.name}`" for path in _files(stage)),
                _taken(stage),
                f"{stage.memory:g}{', of both maps' * (stage.cells is not None)}",
            )
            for stage in STAGES
        ],
    )


def _taken(stage: Stage) -> str:
    names = {DistanceField: "a field", Costmap: "costs"}
    *before, last = ["a map", *(names[kind] for kind in stage.takes if kind in names)]
    return " or ".join(filter(None, [", ".join(before), last]))


def _files(stage: Stage) -> list[Path]:
    return paths_of(Step(stage, {}), Path(), images=True)


def _default_of(parameter: Parameter) -> str:
    default = parameter.default
    if isinstance(default, bool):
        return "yes" if default else "no"
    if default is None:
        return "none"
    if parameter.is_required:
        return "required"
    if default == ():
        return "[]"
    if parameter.kind == LayerList:
        layers: Any = default
        return ", ".join(f"`{kind}`" for layer in layers for kind in described_layer(layer))
    if isinstance(default, tuple):
        return ", ".join(str(value) for value in default)
    others = [f"`{choice}`" for choice in parameter.choices if choice != default]
    if others:
        return f"`{default}`, or {' or '.join(others)}"
    return str(default)


def stage_commands(_: str) -> str:
    """Return the table of the commands that run one stage."""
    first = {stage.name: stage for stage in reversed(STAGES)}
    rows = [(f"`{name}`", first[name].summary) for name in STAGE_NAMES]
    return markdown_table(["command", "what it does"], rows)


PAGES: dict[str, dict[str, MadeTable]] = {
    "cli.md": {
        "options of": options_of,
        "shared options": shared_options,
        "stage commands": stage_commands,
    },
    "stages.md": {
        "parameters of": parameters_of,
        "layers of costmaps": layers_of_costmaps,
        "stages": stages,
    },
}
"""For each page, what makes a table, by the words that its comment begins with."""

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
