"""What is wrong with maps, as a value."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import get_args

from mapdeal.checks.formats import LintReport
from mapdeal.commands.lint import LintRules, ParameterFiles, lint_maps, list_sources
from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.framed import Framed
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.robot import CostmapName


def lint(
    paths: str | PathLike[str] | Iterable[str | PathLike[str]] = (),
    *,
    params_file: str | PathLike[str] | Iterable[str | PathLike[str]] = (),
    costmap: CostmapName | None = None,
    namespace: str | None = None,
    footprint: Footprint | None = None,
    select: str | Iterable[str] = (),
    ignore: str | Iterable[str] = (),
    strict: bool = False,
    config: str | PathLike[str] | bool = True,
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> LintReport:
    """Check maps and robot parameter files for problems, like ``mapdeal lint``.

    Parameters
    ----------
    paths : path or str, or several
        Files: map_server ``.yaml``, ``.pbm`` with its YAML next to it, ``.npz``; folders of maps
        or runs; patterns such as ``maps/**/*.yaml``; ``@LIST.txt``.
    params_file : path or str, or several
        Robot parameter files, in the order in which ROS loads them: a Nav2 file, or ROS 1
        costmap files.
    costmap : {'global', 'local'}, optional
        Costmap to check. By default both, as far as the files define them.
    namespace : str, optional
        Namespace of the robot, if the files describe several.
    footprint : Footprint, optional
        Shape of a robot that should be able to pass through the maps. Areas connected only by
        passages too narrow for its inscribed radius are reported. By default the shape in the
        parameter files, if any.
    select, ignore : str or several
        Names of checks, or of their areas such as ``image``, to run (by default all) and to skip.
    strict : bool
        Whether warnings also make `LintReport.passes` false.
    config : path, str or bool
        Configuration file for all maps; True for the nearest ``mapdeal.toml`` or
        ``pyproject.toml`` of each map, False for none.
    max_cells : int, optional
        Maximum size of a file to read, cells; by default 2e8 for compressed images, 1e9 for
        others.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    LintReport
        Sequence of `Finding`; ``print`` shows each one as the command does. A file that cannot be
        read is a finding, not an error.

    Raises
    ------
    ParameterError
        If there are neither maps nor parameter files, a check is unknown, a pattern matches no
        map, `footprint` is not a footprint or is given without maps, or a configuration is
        invalid.
    FileAccessError, MalformedInputError
        If a list or configuration file cannot be read.

    Examples
    --------
    In a script for CI::

        report = mapdeal.lint("maps", ignore="yaml.origin-off-lattice")
        for finding in report:
            print(finding)
        sys.exit(0 if report.passes else 1)
    """
    settings = Settings(max_cells=max_cells, max_memory=max_memory)
    rules = LintRules(
        _several(select),
        _several(ignore),
        strict=strict,
        config=None if isinstance(config, bool) else Path(config),
        is_isolated=config is False,
    )
    files = tuple(map(Path, _several(params_file)))
    names = _names(paths, is_needed=not files)
    parameters = ParameterFiles(files, costmap, namespace) if files else None
    if parameters is None and (costmap, namespace) != (None, None):
        raise ParameterError("costmap and namespace need params_file", place="lint")
    if costmap not in (None, *get_args(CostmapName)):
        raise ParameterError("must be global or local", place="costmap", got=costmap)
    if footprint is not None and not isinstance(footprint, Footprint):
        raise ParameterError("must be a Footprint", place="footprint", got=footprint)
    if footprint is not None and not names:
        raise ParameterError("needs paths of maps", place="footprint")
    with settings.memory():
        listing = list_sources(names, _no_standard_input)
        paths_of = [one.path for one in listing.maps]
        return lint_maps(paths_of, rules, settings, parameters=parameters, footprint=footprint)


def _names(
    paths: str | PathLike[str] | Iterable[str | PathLike[str]] | Framed, *, is_needed: bool
) -> tuple[str, ...]:
    """Return the names of maps; none at all would be a gate that has lost its maps, and passes."""
    if isinstance(paths, Framed):
        hint = "write_map writes a grid to a file"
        raise ParameterError("takes names or paths", place="lint", got=paths, hint=hint)
    names = _several(paths)
    if not names and is_needed:
        raise ParameterError("names no map", place="lint", got=paths)
    return names


def _several(given: str | PathLike[str] | Iterable[str | PathLike[str]]) -> tuple[str, ...]:
    names: Iterable[object] = (given,)
    if isinstance(given, Iterable) and not isinstance(given, str | bytes):
        names = tuple(given)
    for one in names:
        if not isinstance(one, str | PathLike):
            raise ParameterError("takes names or paths", place="lint", got=one)
    return tuple(map(str, names))


def _no_standard_input() -> Iterable[bytes]:
    raise ParameterError(
        "applies to the command line", source="@-", hint="give the names as a list"
    )
