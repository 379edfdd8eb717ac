"""What a report is of: the paths that were named, put together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from mapdeal.commands.build import DOCUMENT
from mapdeal.commands.report_answers import (
    Answer,
    ComparisonAnswer,
    DiffAnswer,
    LintAnswer,
    read_answer,
)
from mapdeal.commands.report_draft import Draft, Grids, Opened, folder_of
from mapdeal.commands.report_items import finding_items, items_of, lint_table, tables_of
from mapdeal.commands.report_runs import (
    INPUT,
    NOT_SHOWN,
    add_layers,
    aligned_maps,
    columns_of,
    drafts_about,
    fill_from_run,
    give_score,
    map_of,
    methods_in,
    rows_of,
    runs_in,
    two_maps,
)
from mapdeal.errors import (
    BatchError,
    FileAccessError,
    MapdealError,
    ParameterError,
    emit_warning,
    one_line,
)
from mapdeal.files.budget import size_text
from mapdeal.files.source import NAMED_MAPS, exists, identity_of, is_folder, status_of
from mapdeal.files.transaction import Transaction
from mapdeal.grid.display import count_text
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.inputs.kinds import SHAPES, kind_of
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.batch import SUMMARY
from mapdeal.pipeline.documents import AlignmentAnswer, ScoreAnswer
from mapdeal.pipeline.folder import MANIFEST
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings
from mapdeal.report.document import Report, Table
from mapdeal.report.page import page_of
from mapdeal.version import __version__


def gathered(
    paths: Sequence[Path], grids: Grids, *, title: str | None = None, inputs: Sequence[Path] = ()
) -> Report:
    gathering = _Gathering(grids)
    first_names: dict[object, Path] = {}
    for path in paths:
        first_names.setdefault(identity_of(path) or path, path)
    paths = list(first_names.values())
    seen: set[object] = set()
    entries_of = {path: _entries_of(path, grids, seen) for path in paths}
    gathering.runs = [draft for found in entries_of.values() for draft in found or ()]
    for path in paths:
        found = entries_of[path]
        if found is not None:
            gathering.drafts += found
        elif _is_grid(path):
            gathering.add_grid(path)
        else:
            gathering.add_document(path)
    for path in inputs:
        with suppress(MapdealError):  # whoever made the run has told of it
            gathering.add_input(grids.open(path, quietly=True))
    gathering.settle(paths[0])
    files = {*paths, *grids.files, *(one for draft in gathering.drafts for one in draft.places)}
    names = {*gathering.named, *map(str, files)}
    folders = {folder for name in names if (folder := folder_of(name)) is not None}
    entries = tuple(draft.entry(folders) for draft in gathering.drafts)
    if title is None:
        title = entries[0].name if len(entries) == 1 else count_text(len(entries), "map")
    return Report(title, entries, __version__)


def _entries_of(path: Path, grids: Grids, seen: set[object]) -> list[Draft] | None:
    """Return the entries in a folder, but for runs that were `seen`; None of another file."""
    folder = path.parent if path.name in (MANIFEST, SUMMARY, DOCUMENT) else path
    status_of(folder)
    if not is_folder(folder):
        return None
    if exists(folder / DOCUMENT):
        return [methods_in(folder, grids)] if _is_first(folder, seen) else []
    found = runs_in(folder)
    if found is None:
        rule = f"contains no run: no {MANIFEST} in it or below"
        hint = "mapdeal run MAP -o DIR makes one; maps in a folder are named one by one"
        raise FileAccessError(rule, source=folder, hint=hint)
    found = [one for one in found if one.status == NOT_SHOWN or _is_first(one.path, seen)]
    for draft in found:
        try:
            fill_from_run(draft, grids)
        except MapdealError as error:
            if len(found) == 1:
                raise
            draft.miss(f"{one_line(str(error))}, so this run is not shown", draft.path)
    return found


def _is_first(path: Path, seen: set[object]) -> bool:
    """Return whether a file or folder, by whatever name, is met for the first time."""
    key = identity_of(path) or path
    is_first = key not in seen
    seen.add(key)
    return is_first


def _is_grid(path: Path) -> bool:
    if path.suffix.lower() not in NAMED_MAPS:
        return False
    kind = kind_of(path)
    return kind is None or kind.name != SHAPES


def _files_in(answer: Answer) -> Iterator[str]:
    """Yield the names of the files that a document is about."""
    if isinstance(answer, DiffAnswer | AlignmentAnswer):
        yield from (one.file for one in (answer.first, answer.second) if one is not None)
    elif isinstance(answer, LintAnswer):
        yield from (told.file for told in answer.files)
    elif isinstance(answer, ScoreAnswer):
        yield from (one for one in (answer.file, answer.truth) if one is not None)


class _Gathering:
    """The drafts of a report, as they come together."""

    def __init__(self, grids: Grids) -> None:
        self._grids = grids
        self.runs: list[Draft] = []
        self.drafts: list[Draft] = []
        self.named: set[str] = set()
        self._seen: set[object] = set()
        self._documents: list[tuple[Path, Answer, Draft | None]] = []
        self._linted: list[tuple[Path, LintAnswer]] = []
        self._scored: list[tuple[Path, ScoreAnswer]] = []

    def add_grid(self, path: Path) -> None:
        """Add the grid of a file to the draft that it belongs to, or to a new one, once."""
        if not _is_first(path, self._seen):
            return
        opened = self._grids.open(path)
        if self.add_input(opened):
            return
        draft = self.drafts[-1] if self.drafts else None
        if opened.kind is OccupancyGrid or draft is None or not self._fits(draft, path):
            draft = Draft(path.stem, path)
            self.drafts.append(draft)
        self._add(draft, opened)

    def _fits(self, draft: Draft, path: Path) -> bool:
        frame = self._grids.grid(path).frame
        return any(layer.frame == frame for layer in draft.layers)

    def add_input(self, opened: Opened) -> bool:
        """Add a map to the runs that were made of it; return whether there are any."""
        runs = [run for run in self.runs if run.takes(opened.sums.values())]
        for run in runs:
            name = run.free_name(INPUT)
            above = run.layers
            run.layers = self._grids.layers(opened.path, name, "Map as read")
            add_layers(run, above)
            of_map = columns_of({name: self._grids.grid(opened.path).figures()})
            run.figures = {**of_map, **{k: v for k, v in run.figures.items() if k not in of_map}}
            run.paths.append(opened.path)
            run.warn(opened.heard, opened.files)
        return bool(runs)

    def _add(self, draft: Draft, opened: Opened) -> None:
        grid = self._grids.grid(opened.path)
        name = draft.free_name(opened.path.stem)
        add_layers(draft, self._grids.layers(opened.path, name, grid.kind.capitalize()))
        draft.paths.append(opened.path)
        figures = grid.figures()
        draft.figures |= {**columns_of({name: figures}), **draft.figures}
        draft.tables += [
            Table(f"{name}: figures", rows_of(figures)),
            Table(f"{name}: SHA-256", rows_of(opened.sums)),
        ]
        draft.warn(opened.heard, opened.files)

    def add_document(self, path: Path) -> None:
        """Read a document; its content goes where it belongs, at the end."""
        answer = read_answer(path)
        self.named |= set(_files_in(answer))
        if isinstance(answer, DiffAnswer):
            draft = two_maps(path, answer, self._grids, self._grids.settings)
            self.drafts.append(draft)
            draft.tables += tables_of(answer)
        elif isinstance(answer, AlignmentAnswer):
            draft = aligned_maps(path, answer, self._grids)
            self.drafts.append(draft)
            draft.tables[:0] = tables_of(answer)
        elif isinstance(answer, LintAnswer):
            self._linted.append((path, answer))
        elif isinstance(answer, ScoreAnswer):
            self._scored.append((path, answer))
        elif isinstance(answer, ComparisonAnswer):
            rule = "is what build --compare has written beside its maps"
            raise ParameterError(rule, source=path, hint=f"name the folder, {path.parent}")
        else:
            self._documents.append((path, answer, self.drafts[-1] if self.drafts else None))

    def settle(self, first: Path) -> None:
        """Add the content of documents, `first` among them, to the entries that they belong to."""
        if not self.drafts:
            for _, linted in self._linted:
                self._add_maps(Path(told.file) for told in linted.files if not told.is_parameters)
            places = (map_of(answer, path) for path, answer in self._scored)
            self._add_maps(place for place in places if place is not None)
        if not self.drafts:  # such as findings about parameter files alone
            rule = "belongs to a map or a run, and none is named"
            raise ParameterError(rule, source=first, hint="name it before this file")
        for _, answer, draft in self._documents:
            owner = draft or self.drafts[0]
            owner.items += items_of(answer)
            owner.tables += tables_of(answer)
        for path, linted in self._linted:
            self._add_findings(path, linted)
        for path, scored in self._scored:
            give_score(path, scored, self.drafts, self._grids)

    def _add_maps(self, paths: Iterable[Path]) -> None:
        """Add the maps that documents name, where nothing else is named."""
        for path in paths:
            try:
                self.add_grid(path)
            except MapdealError as error:
                draft = Draft(path.stem, path)
                draft.miss(f"{one_line(str(error))}, so this map is not shown", path)
                self.drafts.append(draft)

    def _add_findings(self, path: Path, answer: LintAnswer) -> None:
        lost = []
        for told in answer.files:
            drafts = drafts_about(told.file, self.drafts)
            if not drafts and len(answer.files) == len(self.drafts) == 1:
                drafts = self.drafts
            for draft in drafts:
                draft.items += finding_items(told)
                draft.tables.append(lint_table(told))
            if not drafts and told.findings:
                lost.append(told.file)
        if lost:
            more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
            which = f"{one_line(lost[0])}{more}"
            text = f"{path}: findings of {which} are left out: the map is not shown here"
            emit_warning(text, stacklevel=2)


LARGEST_PAGE = 25_000_000
"""Bytes of a page: what goes into an e-mail."""

_SMALLEST_PAGE = 100_000
_ENDINGS = (".html", ".htm")


@dataclass(frozen=True)
class Made:
    """What has become of a report."""

    path: Path
    entries: int
    size: int

    @property
    def text(self) -> str:
        return f"{count_text(self.entries, 'map')}, {size_text(self.size)}"


def write_report(
    paths: Sequence[Path],
    output: Path,
    settings: Settings = DEFAULT_SETTINGS,
    *,
    title: str | None = None,
    size: int = LARGEST_PAGE,
    inputs: Sequence[Path] = (),
) -> Made:
    """Write one page of what is at some paths, see `gathered`.

    Parameters
    ----------
    paths : sequence of Path
        What it is of.
    output : Path
        The page, ``.html``.
    settings : Settings
        How files are read and written.
    title : str, optional
        What stands above all.
    size : int
        Bytes that the page may have; maps that would make it larger are shown in larger cells.
    inputs : sequence of Path
        Maps that join the runs that were made of them.

    Raises
    ------
    MapdealError
        If a path cannot be read, or the output exists; nothing is changed then.
    """
    if output.suffix.lower() not in _ENDINGS:
        raise ParameterError("the page must end in .html", source=output)
    if size < _SMALLEST_PAGE:
        rule = f"must be at least {size_text(_SMALLEST_PAGE)}"
        raise ParameterError(rule, place="max_size", got=size)
    with settings.memory(), use_threads(settings.threads), Grids(settings) as grids:
        report = gathered(paths, grids, title=title, inputs=inputs)
        with Transaction(
            [output], inputs=[*paths, *grids.files], force=settings.force
        ) as transaction:
            sizes: list[int] = []
            transaction.write_parts(output, _measured(page_of(report, size=size), sizes))
    return Made(output, len(report.entries), sum(sizes))


def _measured(parts: Iterable[bytes], sizes: list[int]) -> Iterator[bytes]:
    for part in parts:
        sizes.append(len(part))
        yield part


@contextmanager
def reported(
    page: Path,
    paths: Sequence[Path],
    inputs: Sequence[Path],
    settings: Settings,
    *,
    on_made: Callable[[Made], object],
) -> Iterator[None]:
    """Write a page of the runs that are made within a ``with`` block, even if some have failed."""
    # `on_made` is called with it.
    settings = replace(settings, force=True)
    try:
        yield
    except BatchError:
        on_made(write_report(paths, page, settings, inputs=inputs))
        raise
    on_made(write_report(paths, page, settings, inputs=inputs))
