"""Recipes as files say them: stages and their parameters, with the line of each."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import yaml

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.kinds import RECIPE, kind_of, other_kind, recognised
from mapdeal.formats.yaml_text import OF_RECIPES, Entry, read_mapping
from mapdeal.spelling import as_known
from mapdeal.stages.catalogue import STAGE_NAMES, models_of
from mapdeal.stages.parameters import unknown_name

_NO_STAGES = "a recipe needs stages: a list of stages"
_LOOKS = (
    'a recipe is the key stages: and below it a list, of items such as "- inflate: {radius: 0.3}"'
)
_LINE = re.compile(
    r"(?:(?P<key>[^(]*) \()?line (?P<line>\d+)(?:, (?P<column>column \d+))?\)?"
)  # fmt: skip


class Given(dict[str, object]):
    """The parameters that a stage is given, and where each comes from."""

    def __init__(
        self, values: Mapping[str, object] | None = None, sources: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(values or {})
        self.sources = dict(sources or {})

    def put(self, values: Mapping[str, object], source: str | None = None) -> None:
        """Set parameters, in the place of those of the same name."""
        self.update(values)
        for name in values:
            self.sources.pop(name, None)
            if source is not None:
                self.sources[name] = source

    def located(self, error: ParameterError, stage: str) -> ParameterError:
        place = (error.place or "").replace(" ", ".")  # "inflate.footprint vertex 1"
        for name, source in self.sources.items():
            if error.source is None and f"{place}.".startswith(f"{stage}.{name}."):
                error.source = source
        return error


Draft = list[tuple[str, Given]]


def read_recipe_file(path: Path, name: str) -> Draft:
    """Return the stages of a recipe's file, of which only names and order are checked."""
    try:
        entries = _entries_in(path)
        for key, entry in entries.items():
            if key != "stages":
                error = unknown_name("key", key, ["stages"])
                error.hint = _LOOKS if models_of(as_known(key, STAGE_NAMES)) else error.hint
                raise _at(entry, error, name)
        if not entries:
            raise ParameterError(_NO_STAGES, source=name, hint=_LOOKS)
        items = _items_of(entries["stages"], name)
        draft: Draft = []
        for item in items:
            stage, given = _stage_of(item, name)
            _check_place(item, stage, [done for done, _ in draft], name)
            draft.append((stage, given))
    except MalformedInputError as error:
        raise _as_usage(error, name) from None
    return draft


def _entries_in(path: Path) -> dict[str, Entry]:
    with recognised(path, "a recipe", RECIPE):
        entries = _mapping_in(path)
    kind = None if "stages" in entries else kind_of(path)
    if kind is not None:
        raise other_kind(path, kind, "a recipe")
    return entries


def _mapping_in(path: Path) -> dict[str, Entry]:
    try:
        return read_mapping(path, OF_RECIPES)
    except MalformedInputError as error:
        if error.place is None:  # no mapping: an empty file, or stages without their key
            error.hint = error.hint or _LOOKS
        raise


def _items_of(entry: Entry, name: str) -> list[Entry]:
    if not isinstance(entry.node, yaml.SequenceNode) or not entry.node.value:
        raise _at(entry, ParameterError(_NO_STAGES, hint=_LOOKS), name)
    return entry.items()


def _stage_of(item: Entry, name: str) -> tuple[str, Given]:
    """Return stage and parameters of a list item, ``stage`` or ``stage: {...}``."""
    rule = "an item of stages must look like stage: {parameter: value}"
    if isinstance(item.node, yaml.ScalarNode) and not item.is_nothing():
        return item.text(), Given()
    if not isinstance(item.node, yaml.MappingNode) or len(item.node.value) != 1:
        raise item.error(rule)
    ((stage, below),) = item.fields().items()
    if below.is_nothing():
        return stage, Given()
    if not isinstance(below.node, yaml.MappingNode):
        raise item.error(rule)
    fields = below.merged_fields()
    values: dict[str, object] = {
        key: Entry(field.source, f"{stage}.{key}", field.node).plain_value()
        for key, field in fields.items()
    }
    return stage, Given(values, {key: f"{name}:{field.line}" for key, field in fields.items()})


def _check_place(item: Entry, stage: str, before: Iterable[str], name: str) -> None:
    """Refuse a stage that is not known, or cannot come where it stands."""
    done = list(before)
    if not models_of(stage):
        raise _at(item, unknown_name("stage", stage, STAGE_NAMES), name)
    if stage in done:
        raise _at(item, ParameterError("a stage can run once", place=stage), name)
    first = {one: next(iter(models_of(one).values())) for one in (*done, stage)}
    works_on = next((one for one in reversed(done) if first[one].hands_on), None)
    if works_on is None or not first[works_on].is_last:
        return
    if first[works_on].makes not in first[stage].takes:
        rule = f"cannot follow {works_on}"
        raise _at(item, ParameterError(rule, place=stage), name)


def _at(entry: Entry, error: ParameterError, name: str) -> ParameterError:
    error.source = f"{name}:{entry.line}"
    return error


def _as_usage(error: MalformedInputError, name: str) -> ParameterError:
    """Return an error about what a file holds as one of usage, the line behind the file's name."""
    found = _LINE.fullmatch(error.place or "")
    source = name
    if found is not None:
        source += f":{found['line']}"
        error.place = found["key"] or found["column"]
    error.source = source
    return ParameterError(str(error), hint=error.hint)
