"""Build the documentation site: ``python docs/site/build.py [FOLDER]``.

Pages of docs and README are gathered in FOLDER (build/site if not given), with a page for each
command and for each group of Python names, and the schemas of JSON documents; Zensical makes
FOLDER/html of them. Links to files that are not pages lead to the repository. The build fails on a
link or anchor that leads nowhere, and on a page that would load anything from another host.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import mapdeal
from mapdeal.cli.main import app, in_groups, sections_of
from mapdeal.stages.catalogue import STAGES

SITE = Path(__file__).parent
DOCS = SITE.parent
ROOT = DOCS.parent
FILES = "files"  # where the site keeps what pages link to beside pages and pictures
LOADED = re.compile(r"(?:url\(|@import )[\"']?((?:https?:)?//[^\"')]+)")
CODE_WITH_BARS = re.compile(r"`([^`\n]*\\\|[^`\n]*)`")
LINK = re.compile(r"(\]\()([^)\s]+)(\))")

EXIT_CODES = "See [exit codes](../../cli.md#exit-codes)."
API = {
    "Reading and writing": (
        "read_map", "write_map", "read_bit_map", "write_bit_map", "read_shapes", "read_cloud",
        "read_poses", "read_map_from_bag", "read_route_graph", "write_route_graph",
    ),
    "Stages": (
        "active_region", "inflate", "esdf", "field_view", "exponential_cost", "threshold_cost",
        "ring_cost", "layered_cost", "StaticLayer", "InflationLayer", "DenoiseLayer",
        "apply_keepout_mask",
        "potential", "reach", "footprint_costs", "cost_curve", "route",
    ),
    "As the commands do": (
        "run", "load_recipe", "apply_recipe", "read_robot_parameters", "lint", "diff", "score",
        "align", "merge", "graph", "info", "write_report", "draw_picture", "write_picture",
    ),
    "Changing maps": (
        "draw", "blank", "window", "shift_origin", "reset_region", "rotate", "straighten",
        "yaw_to_straighten", "rescale", "clean", "xy_ahead",
    ),
    "Maps from sensors": (
        "local_map", "LocalMapper", "RollingMapper", "LocalOptions", "build_map",
        "build_map_from_log", "cloud_map", "build_map_from_clouds", "build_map_from_world",
        "CloudMapper", "CloudMap", "CloudOptions", "MapBuilder", "BeamLimits", "Scans",
    ),
}  # fmt: skip
"""Public names by the title of their page; all others are types and errors."""


def main(folder: Path) -> None:
    """Gather the pages, build the site, and check that it is complete in itself."""
    shutil.rmtree(folder, ignore_errors=True)
    pages = folder / "docs"
    shutil.copytree(DOCS / "images", pages / "images")
    shutil.copy(SITE / "site.css", pages)
    sources = {page.relative_to(DOCS).as_posix(): page for page in DOCS.rglob("*.md")}
    sources |= {"index.md": ROOT / "README.md", "changelog.md": ROOT / "CHANGELOG.md"}
    for name, source in sources.items():
        write(pages / name, with_site_links(source.read_text(), source, pages / name, pages))
    commands = [{name: page} for name, page in write_commands(pages)]
    names = [{title: page} for title, page in write_api(pages)]
    configuration = (SITE / "zensical.toml").read_text()
    for title, listed in (("Commands", commands), ("Python API", names)):
        empty = f'{{ "{title}" = [] }}'
        if empty not in configuration:
            raise SystemExit(f"zensical.toml has no {empty}")
        rows = ", ".join(f'{{ "{k}" = "{v}" }}' for one in listed for k, v in one.items())
        configuration = configuration.replace(empty, f'{{ "{title}" = [{rows}] }}')
    copy_sources(folder / "src")
    command = [sys.executable, str(DOCS / "schemas.py"), str(pages / "schemas")]
    subprocess.run(command, check=True)  # noqa: S603 - ours
    write(folder / "zensical.toml", configuration)
    command = [sys.executable, "-m", "zensical", "build", "--strict"]
    subprocess.run(command, cwd=folder, check=True)  # noqa: S603 - ours
    foreign = sorted(set(foreign_assets(folder / "html")))
    if foreign:
        raise SystemExit("\n".join(["the site loads from other hosts:", *foreign]))
    print(f"{folder / 'html'}: {len(list((folder / 'html').rglob('*.html')))} pages")


def copy_sources(folder: Path) -> None:
    """Copy the modules that docstrings are read from.

    mkdocstrings knows the constructors of data classes by the standard decorator alone.
    """
    package = ROOT / "src" / "mapdeal"
    for module in package.rglob("*.py*"):
        if module.suffix in (".py", ".pyi"):
            text = module.read_text().replace(
                "from mapdeal.records import dataclass", "from dataclasses import dataclass"
            )
            write(folder / "mapdeal" / module.relative_to(package), text)


def write(path: Path, text: str) -> None:
    """Write a file, and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def with_site_links(text: str, source: Path, page: Path, pages: Path) -> str:
    """Return a page for the site: links lead to its pages, or else to copies of files."""

    def led(match: re.Match[str]) -> str:
        target, mark, anchor = match[2].partition("#")
        if not target or "://" in target:
            return match[0]
        path = (source.parent / target).resolve()
        special = {ROOT / "README.md": "index.md", ROOT / "CHANGELOG.md": "changelog.md"}
        if path in special:
            inside = special[path]
        elif path.is_relative_to(DOCS) and path.suffix in (".md", ".png"):
            inside = path.relative_to(DOCS).as_posix()
        else:
            inside = f"{FILES}/{path.relative_to(ROOT).as_posix()}"
            inside += ".txt" if path.suffix in (".md", "") else ""  # shown, not rendered
            write(pages / inside, path.read_text())
        above = "../" * (len(page.relative_to(pages).parts) - 1)
        return f"{match[1]}{above}{inside}{mark}{anchor}{match[3]}"

    def barred(match: re.Match[str]) -> str:  # which the site's tables would show with backslashes
        return f"<code>{escape(match[1]).replace(chr(92) + '|', '&#124;')}</code>"

    return CODE_WITH_BARS.sub(barred, LINK.sub(led, text))


def write_commands(pages: Path) -> Iterator[tuple[str, str]]:
    """Write a page for each command; yield names and pages in the order of ``--help``."""
    import typer

    group: Any = typer.main.get_command(app)
    for members in in_groups(group, None).values():
        for command in members:
            name = command.name
            kinds = getattr(command, "commands", {})
            parts = [f"# mapdeal {name}\n\n{_description(command)}\n"]
            if kinds:
                parts += [
                    _section(below, f"{name} {kind}", f"## mapdeal {name} {kind}\n\n")
                    for kind, below in kinds.items()
                ]
            else:
                parts.append(_section(command, name, ""))
            parts.append(f"\n{EXIT_CODES}\n")
            page = f"reference/commands/{name}.md"
            write(pages / page, "".join(parts))
            yield name, page


def _description(command: Any) -> str:
    return escape(command.help or "", quote=False).replace("[", "\\[")


def _section(command: Any, name: str, head: str) -> str:
    """Return usage, options and examples of a command."""
    context = command.make_context(name, [], resilient_parsing=True)
    usage = " ".join(command.collect_usage_pieces(context))
    lines = [f"{head}{_description(command) if head else ''}\n\n```\nmapdeal {name} {usage}\n```\n"]
    level = "###" if head else "##"
    for title, rows in sections_of(command, context).items():
        what = "argument" if title == "Arguments" else "option"
        lines.append(f"\n{level} {title}\n\n| {what} | meaning |\n|---|---|\n")
        for names, text in rows:
            meaning = escape(text).replace("|", "&#124;").replace("[", "\\[")
            shown = escape(names).replace("|", "&#124;")
            lines.append(f"| <code>{shown}</code> | {meaning} |\n")
    lines.append(f"\n{level} Examples\n\n```sh\n{command.epilog}\n```\n")
    return "".join(lines)


def write_api(pages: Path) -> Iterator[tuple[str, str]]:
    """Write the pages of the Python API, from docstrings; yield titles and pages."""
    public = dict(_public_names())
    grouped = {name for names in API.values() for name in names}
    if not grouped <= set(public):
        raise SystemExit(f"not public: {', '.join(sorted(grouped - set(public)))}")
    rest = tuple(name for name in public if name not in grouped)
    for title, names in {**API, "Types and errors": rest}.items():
        blocks = [f"::: {public[name]}\n" for name in names]
        page = f"reference/python/{title.lower().replace(' ', '_')}.md"
        write(
            pages / page,
            f"# {title}\n\nAll names are those of `import mapdeal`.\n\n" + "\n".join(blocks),
        )
        yield title, page


def _public_names() -> Iterator[tuple[str, str]]:
    """Yield the public names, and the module and name of each."""
    for stage in STAGES:
        yield stage.function.__name__, f"{stage.function.__module__}.{stage.function.__name__}"
    stubs = Path(mapdeal.__file__).with_suffix(".pyi")
    for node in ast.parse(stubs.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            for one in node.names:
                if one.name != "*" and not one.name.startswith("_"):
                    yield one.asname or one.name, f"{node.module}.{one.name}"


class _Assets(HTMLParser):
    """Collects what a page loads by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note scripts, images, frames, styles and what is fetched beforehand."""
        given = dict(attrs)
        is_loaded = tag in ("script", "img", "iframe", "source", "video", "audio", "embed")
        if is_loaded and given.get("src"):
            self.found.append(str(given["src"]))
        if tag == "link" and "canonical" not in (given.get("rel") or ""):
            self.found.append(given.get("href") or "")


def foreign_assets(html: Path) -> Iterator[str]:
    """Yield what pages and styles of a site load from other hosts."""
    for page in html.rglob("*.html"):
        parser = _Assets()
        parser.feed(page.read_text())
        for one in parser.found:
            if one.startswith(("http:", "https:", "//")):
                yield f"{page.relative_to(html)}: {one}"
    for style in html.rglob("*.css"):
        for one in re.findall(
            r"(?:url\(|@import )[\"']?((?:https?:)?//[^\"')]+)", style.read_text()
        ):
            yield f"{style.relative_to(html)}: {one}"


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "site").absolute())
