"""Our data classes beside those of the standard library, which are the oracle."""

import copy
import dataclasses
import inspect
import pickle
from dataclasses import FrozenInstanceError, field
from typing import ClassVar

import pytest

from mapdeal import records

ORACLE = dataclasses.dataclass


def made_by(dataclass):
    """Return classes of all kinds that are in use, made by a decorator."""

    @dataclass(frozen=True)
    class Plain:
        a: int
        b: str = "x"

    @dataclass(frozen=True)
    class Derived(Plain):
        c: list = field(default_factory=list, compare=False)
        d: int = field(default=3, repr=False)

        def __post_init__(self):
            if self.a < 0:
                raise ValueError("negative")

    @dataclass
    class Open:
        kind: ClassVar[str] = "open"
        a: int
        seen: dict = field(default_factory=dict, init=False)
        _c: int = 1

    @dataclass(frozen=True, eq=False, repr=False)
    class Identity:
        a: int

    @dataclass(frozen=True)
    class Own:
        a: int

        def __repr__(self):
            return f"<{self.a}>"

        def __eq__(self, other):
            return isinstance(other, Own) and self.a % 2 == other.a % 2

    @dataclass(frozen=True)
    class Hashed:
        a: int
        b: int = field(default=0, hash=False)

        def __hash__(self):
            return 7

    @dataclass(frozen=True)
    class Empty:
        pass

    @dataclass
    class Bare:
        a: int = 2

    return {
        made.__name__: made for made in (Plain, Derived, Open, Identity, Own, Hashed, Empty, Bare)
    }


OURS, THEIRS = made_by(records.dataclass), made_by(ORACLE)

CALLS = [
    ("Plain", (1,), {}),
    ("Plain", (1, "y"), {}),
    ("Plain", (), {"b": "z", "a": 4}),
    ("Plain", (1,), {"b": "w"}),
    ("Derived", (1,), {}),
    ("Derived", (1, "q", [1], 9), {}),
    ("Derived", (2,), {"d": 4, "c": [2]}),
    ("Open", (5,), {}),
    ("Open", (5, 6), {}),
    ("Identity", (1,), {}),
    ("Own", (3,), {}),
    ("Hashed", (3, 4), {}),
    ("Empty", (), {}),
    ("Bare", (), {}),
]
WRONG = [
    ("Plain", (), {}),
    ("Plain", (), {"b": "x"}),
    ("Plain", (1, 2, 3), {}),
    ("Plain", (1,), {"a": 2}),
    ("Plain", (1,), {"other": 2}),
    ("Open", (1,), {"seen": {}}),
    ("Empty", (1,), {}),
    ("Derived", (-1,), {}),
]


def pair(name, values, named):
    return OURS[name](*values, **named), THEIRS[name](*values, **named)


def text_of(made):
    """Return the text without the name of the enclosing function, or the bare object's."""
    return "object" if type(made).__repr__ is object.__repr__ else repr(made)


@pytest.mark.parametrize(("name", "values", "named"), CALLS)
def test_instances_are_those_of_the_library(name, values, named):
    ours, theirs = pair(name, values, named)

    assert vars(ours) == vars(theirs)
    assert list(vars(ours)) == list(vars(theirs))
    assert text_of(ours) == text_of(theirs)
    assert dataclasses.asdict(ours) == dataclasses.asdict(theirs)


@pytest.mark.parametrize(("name", "values", "named"), WRONG)
def test_what_the_library_refuses_is_refused(name, values, named):
    with pytest.raises((TypeError, ValueError)) as theirs:
        THEIRS[name](*values, **named)
    with pytest.raises(theirs.type):
        OURS[name](*values, **named)


@pytest.mark.parametrize("name", OURS)
def test_signatures_and_fields_are_those_of_the_library(name):
    ours, theirs = OURS[name], THEIRS[name]

    assert str(inspect.signature(ours)) == str(inspect.signature(theirs))
    assert [f.name for f in dataclasses.fields(ours)] == [
        f.name for f in dataclasses.fields(theirs)
    ]
    assert ours.__match_args__ == theirs.__match_args__


@pytest.mark.parametrize(("name", "values", "named"), CALLS)
@pytest.mark.parametrize(("other", "others", "others_named"), CALLS)
def test_what_is_equal_is_equal(name, values, named, other, others, others_named):
    ours, theirs = pair(name, values, named)
    our_other, their_other = pair(other, others, others_named)

    assert (ours == our_other) is (theirs == their_other)


@pytest.mark.parametrize(("name", "values", "named"), CALLS)
def test_hashes_follow_the_library(name, values, named):
    ours, theirs = pair(name, values, named)

    if type(theirs).__hash__ is None:
        with pytest.raises(TypeError, match="unhashable"):
            hash(ours)
    elif type(theirs).__hash__ is object.__hash__:
        assert type(ours).__hash__ is object.__hash__
    else:
        assert hash(ours) == hash(theirs)


@pytest.mark.parametrize("name", ["Plain", "Derived", "Identity", "Own"])
def test_frozen_ones_cannot_be_changed(name):
    made = OURS[name](1)

    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'a'"):
        made.a = 2
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'other'"):
        made.other = 2
    with pytest.raises(FrozenInstanceError, match="cannot delete field 'a'"):
        del made.a
    assert made.a == 1


def test_open_ones_can_be_changed():
    made = OURS["Open"](1)
    made.a = 2
    made.seen["x"] = 1

    assert (made.a, OURS["Open"](1).seen) == (2, {})


def test_a_plain_class_below_a_frozen_one_has_attributes_of_its_own():
    class Below(OURS["Plain"]):
        pass

    below = Below(1)
    below.note = "n"
    del below.note
    with pytest.raises(FrozenInstanceError):
        below.a = 2
    assert not hasattr(below, "note")


def test_a_changed_copy_leaves_the_first_alone():
    made = OURS["Derived"](1, "b", [1])

    assert dataclasses.replace(made, a=5) == OURS["Derived"](5, "b")
    assert made.a == 1
    assert copy.deepcopy(made) == made
    assert copy.copy(made).c is made.c


def test_a_record_that_holds_itself_can_be_printed():
    made = OURS["Open"](1)
    made.a = made

    assert "..." in repr(made)


@records.dataclass(frozen=True)
class Pickled:
    a: int
    b: tuple = ()


def test_records_go_from_process_to_process():
    made = pickle.loads(pickle.dumps(Pickled(1, (2,))))  # noqa: S301 - our own
    assert made == Pickled(1, (2,))


def test_a_record_without_methods_of_its_own_is_not_compiled():
    """What this module is for: the methods of all classes share one code."""

    @records.dataclass(frozen=True)
    class Other:
        x: int

    for method in ("__init__", "__eq__", "__hash__", "__repr__", "__setattr__", "__delattr__"):
        ours = inspect.unwrap(vars(Pickled)[method])
        assert ours.__code__ is inspect.unwrap(vars(Other)[method]).__code__
