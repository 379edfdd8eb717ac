"""What is wrong with maps, as a value."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from mapdeal.checks.reports.report import LintReport
from mapdeal.errors import ParameterError
from mapdeal.grid.framed import Framed
from mapdeal.pipeline.lint import LintRules, lint_maps, list_sources
from mapdeal.pipeline.settings import Settings


def lint(
    paths: str | PathLike[str] | Iterable[str | PathLike[str]],
    *,
    select: str | Iterable[str] = (),
    ignore: str | Iterable[str] = (),
    strict: bool = False,
    config: str | PathLike[str] | bool = True,
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> LintReport:
    """Report what is wrong with maps, by named checks, as the command does.

    Parameters
    ----------
    paths : path or str, or several
        Files: map_server ``.yaml``, ``.pbm`` with its YAML beside it, ``.npz``; folders of maps
        or of runs; patterns such as ``maps/**/*.yaml``; ``@LIST.txt``.
    select, ignore : str or several
        Names of checks, or of their areas such as ``image``: those that count, all if not given,
        and those that do not.
    strict : bool
        Whether warnings, too, make `LintReport.passes` false.
    config : path, str or bool
        The file of configuration of all maps; True for the nearest ``mapdeal.toml`` or
        ``pyproject.toml`` of each, False for none.
    max_cells : int, optional
        Cells up to which a file is read; by default 2e8 for compressed images, 1e9 for others.
    max_memory : int, optional
        Bytes of memory that may be taken; by default half of what is free.

    Returns
    -------
    LintReport
        A sequence of `Finding`; ``print`` shows each as the command does. A file that cannot be
        read is a finding, and no error.

    Raises
    ------
    ParameterError
        If there are no names, a check is not known, a pattern matches no map, or a
        configuration says what cannot be.
    FileAccessError, MalformedInputError
        If a list or a file of configuration cannot be read.

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
    names = _names(paths)
    with settings.memory():
        listing = list_sources(names, _no_standard_input)
        return lint_maps([one.path for one in listing.maps], rules, settings)


def _names(paths: str | PathLike[str] | Iterable[str | PathLike[str]] | Framed) -> tuple[str, ...]:
    """Return the names of maps; none at all would be a gate that has lost its maps, and passes."""
    if isinstance(paths, Framed):
        hint = "write_map writes a grid to a file"
        raise ParameterError("takes names or paths", place="lint", got=paths, hint=hint)
    names = _several(paths)
    if not names:
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
    raise ParameterError("is for the command line", source="@-", hint="give the names as a list")
