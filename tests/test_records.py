"""Frozen dataclasses behave as those of the standard library."""

import copy
import dataclasses
from functools import cached_property

import pytest

from mapdeal import records


def define(dataclass):
    @dataclass(frozen=True)
    class Base:
        width: float
        name: str = dataclasses.field(default="a", compare=False)

        @cached_property
        def half(self):
            return self.width / 2

    @dataclass(frozen=True)
    class Derived(Base):
        heights: list[int] = dataclasses.field(default_factory=list, repr=False)
        area: float = dataclasses.field(init=False)

        def __post_init__(self):
            object.__setattr__(self, "area", self.width * sum(self.heights))

        def __eq__(self, other):
            return abs(self.area - other.area) < 1

    @dataclass(frozen=True, eq=False, repr=False)
    class Plain(Base):
        pass

    @dataclass(frozen=True)
    class Empty:
        pass

    return Base, Derived, Plain, Empty


def behaviour(dataclass):
    Base, Derived, Plain, Empty = define(dataclass)  # noqa: N806
    a, b, c = Base(1.5), Base(1.5, "b"), Base(2)
    yield a == b, a == c, a != c, a == 1.5, hash(a) == hash(b), len({a, b, c}), a.half
    yield repr(a).rpartition(".")[2], repr(Derived(2, heights=[3])).rpartition(".")[2]
    yield Derived(1, heights=[2]) == Derived(2.0, heights=[1]), Derived(1).area
    yield (
        Plain(1) == Plain(1),
        hash(Plain(1)) == hash(Base(1)),
        Empty() == Empty(),
        {Empty(): 1}[Empty()],
    )
    yield dataclasses.replace(a, width=3).half, dataclasses.asdict(b), copy.copy(b) == b
    yield Base.__match_args__, [field.name for field in dataclasses.fields(Derived)]
    for change in (setattr, delattr):
        for name in ("width", "unknown"):
            with pytest.raises(dataclasses.FrozenInstanceError) as caught:
                change(a, name, *[1] * (change is setattr))
            yield str(caught.value), vars(a) == {"width": 1.5, "name": "a", "half": 0.75}
    with pytest.raises(TypeError, match="unhashable"):
        hash(Derived(1, heights=[]))


def test_classes_behave_as_those_of_the_standard_library():
    assert list(behaviour(records.dataclass)) == list(behaviour(dataclasses.dataclass))
