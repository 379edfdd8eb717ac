"""Write the tables in the documentation that repeat definitions of the code.

Run it as ``python docs/tables.py`` after a change to an option or a stage; ``--check`` writes
nothing and exits with 1 if a page would change.

A table stands between two comments. The words of the first say what it is made of::

    <!-- parameters of inflate -->

    | parameter | default | unit | meaning |
    ...

    <!-- end -->

`PAGES` says which function makes a table of these words.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

import typer

from mapdeal.checks.findings import CHECKS
from mapdeal.cli.main import app, in_groups
from mapdeal.cli.options import SHARED_OPTIONS, expanded
from mapdeal.command import Parameter, Stage, meanings_of
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.footprint import Footprint
from mapdeal.layers.catalogue import LAYERS, class_name
from mapdeal.maps.formats import FORMATS
from mapdeal.pipeline.folder import PICTURE, files_of
from mapdeal.stages.catalogue import STAGES
from mapdeal.stages.structured import LayerList

DOCS = Path(__file__).parent

MadeTable = Callable[[str], str]

_END = "end"
_COMMENT = re.compile(r"^<!-- (.+?) -->\n", re.MULTILINE)
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
        made = with_tables(with_new_stages(text) if name == "stages.md" else text, makers)
        if made != text:
            changed.append(name)
            if not is_check:
                page.write_text(made)
    for name in changed:
        print(f"{name}: {'is out of date; run docs/tables.py' if is_check else 'written'}")
    return 1 if is_check and changed else 0


def with_new_stages(text: str) -> str:
    """Return the page of stages with a section for each stage that has no table there."""
    for stage in STAGES:
        words = " ".join(filter(None, (stage.name, stage.model)))
        comment = f"<!-- parameters of {words} -->\n"
        if comment not in text:
            text += f"\n## {words}\n\n{stage.summary}\n\n{comment}<!-- {_END} -->\n"
    return text


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


def commands(_: str) -> str:
    """Return the table of all commands, by the groups of ``mapdeal --help``."""
    groups = in_groups(typer.main.get_command(app), None)
    return markdown_table(
        ["", "command", "what it does"],
        [
            (title if one is members[0] else "", f"`{one.name}`", one.short_help)
            for title, members in groups.items()
            for one in members
        ],
    )


def shared_options(names: str) -> str:
    """Return the table of options that many commands have, by the names of their groups."""
    rows = []
    for name in expanded(names.split(", ")):
        if name not in SHARED_OPTIONS:
            raise ValueError(f"no shared option {name!r}")
        option = SHARED_OPTIONS[name]
        text, _, default = option.text.partition("  [default: ")
        chosen = "" if option.default is None or option.kind is bool else str(option.default)
        metavar = option.metavar or ", ".join(get_args(option.kind) if option.default else ())
        shown = " ".join(filter(None, [f"--{name.replace('_', '-')}", metavar]))
        rows.append((f"`{shown}`", _with_code(default[:-1] or chosen), _with_code(text)))
    return markdown_table(["option", "default", "meaning"], rows)


def checks(_: str) -> str:
    """Return the table of all checks of ``lint``."""
    rows = []
    for name, check in sorted(CHECKS.items()):
        severity = f"{check.severity}, on request" if check.on_request else check.severity
        rows.append((f"`{name}`", severity, check.explanation.about))
    return markdown_table(["check", "severity", "finds"], rows)


def _with_code(text: str) -> str:
    return _CODE.sub(lambda code: f"`{code[0]}`", text)


def parameters_of(words: str) -> str:
    """Return the table of a stage's parameters: of its name, and its model if it has several."""
    name, *models = words.split()
    named = [stage for stage in STAGES if stage.name == name]
    stage = next((stage for stage in named if not models or stage.model in models), None)
    if stage is None:
        raise ValueError(f"no stage {words!r}")
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
    """Return the table of the parameters of costmap layers; layers with equal rows share them."""
    layers_by_row: dict[tuple[str, str, str], list[str]] = {}
    for layer_class in LAYERS:
        ((kind, values),) = layer_class().described().items()
        meanings = meanings_of(layer_class) or meanings_of(layer_class.__base__)
        for name in (key for key in values if key != "name"):  # the text above the table has it
            words = {None: "none", True: "yes", False: "no"}
            default = values[name]
            is_word = default is None or isinstance(default, bool)
            row = (f"`{name}`", words[default] if is_word else str(default), meanings[name])
            layers_by_row.setdefault(row, []).append(f"`{kind}`")
    return markdown_table(
        ["layer", "parameter", "default", "meaning"],
        [
            (", ".join(kinds), name, default, meaning.replace("``", "`"))
            for (name, default, meaning), kinds in layers_by_row.items()
        ],
    )


def plugins(_: str) -> str:
    """Return the table of the plugins of Nav2 and ROS 1 whose costs are computed."""
    return markdown_table(
        ["layer", "Nav2", "ROS 1", "effect on the costs"],
        [
            (f"`{layer.key}`", _classes(layer.nav2_plugins), _classes(layer.ros1_plugins),
             layer.about)
            for layer in LAYERS
        ],
    )  # fmt: skip


def plugins_in_chinese(_: str) -> str:
    """Return the table of `plugins` in Chinese; the page itself has the translated effects."""
    page = (DOCS / "robots.zh.md").read_text("utf-8")
    effects = dict(re.findall(r"(?m)^\| `(\w+)` \| .*\| (.+) \|$", page))
    return markdown_table(
        ["图层", "Nav2", "ROS 1", "对代价的作用"],
        [
            (f"`{layer.key}`", _classes(layer.nav2_plugins), _classes(layer.ros1_plugins),
             effects.get(layer.key, "见英文页面"))
            for layer in LAYERS
        ],
    )  # fmt: skip


def _classes(names: Sequence[str]) -> str:
    return ", ".join(f"`{class_name(name)}`" for name in names)


def stages(_: str) -> str:
    """Return the table of all stages: their files in a run, and the memory that they take."""
    return markdown_table(
        ["stage", "model", "files in a folder of outputs", "works on", "bytes per cell in memory"],
        [
            (
                f"`{stage.name}`",
                f"`{stage.model}`" if stage.model else "",
                ", ".join(f"`{path.name}`" for path in _files(stage)),
                _taken(stage),
                f"{stage.memory:g}{', of input and output' * (stage.cells is not None)}",
            )
            for stage in STAGES
        ],
    )


def _taken(stage: Stage) -> str:
    names = {DistanceField: "a field", Costmap: "costs"}
    *before, last = ["a map", *(names[kind] for kind in stage.takes if kind in names)]
    return " or ".join(filter(None, [", ".join(before), last]))


def _files(stage: Stage) -> list[Path]:
    endings = (*files_of(stage.product_type).in_folder, PICTURE)
    return [Path(f"{stage.product}{ending}") for ending in endings]


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
        return ", ".join(f"`{kind}`" for layer in layers for kind in layer.described())
    if isinstance(default, tuple):
        return ", ".join(str(value) for value in default)
    others = [f"`{choice}`" for choice in parameter.choices if choice != default]
    if others:
        return f"`{default}`, or {' or '.join(others)}"
    return str(default)


def map_formats(_: str) -> str:
    """Return the table of the formats of maps."""
    return markdown_table(
        ["a map is", "endings", "found in folders", "written"],
        [
            (entry.name, ", ".join(f"`{ending}`" for ending in entry.endings),
             "yes" * entry.in_folders, "yes" * (entry.write is not None))
            for entry in FORMATS
        ],
    )  # fmt: skip


PAGES: dict[str, dict[str, MadeTable]] = {
    "cli.md": {"commands": commands, "shared options": shared_options},
    "formats.md": {"map formats": map_formats},
    "lint.md": {"checks": checks},
    "robots.md": {"plugins": plugins},
    "robots.zh.md": {"plugins": plugins_in_chinese},
    "stages.md": {
        "parameters of": parameters_of,
        "layers of costmaps": layers_of_costmaps,
        "stages": stages,
    },
}
"""For each page, what makes a table, by the words that its comment begins with."""

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
