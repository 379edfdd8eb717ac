"""Frozen dataclasses behave as those of the standard library."""

import copy
import dataclasses
from functools import cached_property

import pytest

from mapdeal import records


def behaviour(dataclass):
    @dataclass(frozen=True)
    class Box:
        width: float
        name: str = dataclasses.field(default="a", compare=False)

        @cached_property
        def half(self):
            return self.width / 2

    @dataclass(frozen=True)
    class Stack(Box):
        heights: list[int] = dataclasses.field(default_factory=list, repr=False)
        area: float = dataclasses.field(init=False)

        def __post_init__(self):
            object.__setattr__(self, "area", self.width * sum(self.heights))

        def __eq__(self, other):
            return abs(self.area - other.area) < 1

    @dataclass(frozen=True, eq=False, repr=False)
    class Unshown(Box):
        pass

    box, named, wide = Box(1.5), Box(1.5, "b"), Box(2)
    yield (
        box == named,
        box != wide,
        box == 1.5,
        hash(box) == hash(named),
        len({box, wide}),
        box.half,
    )
    yield [repr(item).rpartition(".")[2] for item in (box, Stack(2, heights=[3]))]
    yield Stack(1, heights=[2]) == Stack(2.0, heights=[1]), Stack(1).area, Unshown(1) == Unshown(1)
    yield dataclasses.replace(box, width=3).half, dataclasses.asdict(named), copy.copy(box) == box
    yield Box.__match_args__, [field.name for field in dataclasses.fields(Stack)]
    for change, *value in [(setattr, 1), (delattr,)]:
        for name in ("width", "unknown"):
            with pytest.raises(dataclasses.FrozenInstanceError) as caught:
                change(box, name, *value)
            yield str(caught.value), vars(box) == {"width": 1.5, "name": "a", "half": 0.75}
    with pytest.raises(TypeError, match="unhashable"):
        hash(Stack(1, heights=[]))


def test_classes_behave_as_those_of_the_standard_library():
    assert list(behaviour(records.dataclass)) == list(behaviour(dataclasses.dataclass))
