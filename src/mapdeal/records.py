"""Dataclasses that are quick to define.

The standard library compiles six functions for a frozen dataclass. A run defines over a hundred
such classes, which would take a sixth of its time. Here they share all functions but ``__init__``.
Costmap layers are dataclasses of the standard library, which can be extended by such classes only.
"""

from __future__ import annotations

import dataclasses
from dataclasses import asdict, astuple, field, fields, is_dataclass, replace
from functools import partial
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any

__all__ = ["asdict", "astuple", "dataclass", "field", "fields", "is_dataclass", "replace"]


def _set_once(self: Any, name: str, value: object) -> None:
    if name in self.__dict__ or name not in self.__dataclass_fields__:  # __init__ has set all
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
    object.__setattr__(self, name, value)


def _refuse_to_delete(_: Any, name: str) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


def _is_equal(self: Any, value: Any) -> Any:
    if value.__class__ is not self.__class__:
        return NotImplemented
    return self._compared(self) == self._compared(value)


def _hash(self: Any) -> int:
    return hash(self._compared(self))


@recursive_repr()
def _repr(self: Any) -> str:
    shown = (own.name for own in fields(self) if own.repr)
    values = ", ".join(f"{name}={getattr(self, name)!r}" for name in shown)
    return f"{type(self).__qualname__}({values})"


if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, **options):
        """Define a class as `dataclasses.dataclass` does."""
        if cls is None:
            return partial(dataclass, **options)
        if not options.get("frozen") or "slots" in options:
            return dataclasses.dataclass(cls, **options)
        shared = {"__setattr__": _set_once, "__delattr__": _refuse_to_delete}
        if options.get("repr", True):
            shared["__repr__"] = _repr
        if options.get("eq", True):
            shared |= {"__eq__": _is_equal, "__hash__": _hash}
            if vars(cls).get("__hash__", _hash) is None:  # as the class has its own __eq__
                del cls.__hash__
        for name in shared.keys() - vars(cls).keys():
            setattr(cls, name, shared[name])
        text = cls.__doc__
        cls.__doc__ = text or cls.__name__  # the standard library would format the signature
        dataclasses.dataclass(cls, **options | {"frozen": False, "eq": False, "repr": False})
        cls.__doc__ = text
        compared = [own.name for own in fields(cls) if own.compare]
        cls._compared = staticmethod(attrgetter(*compared) if compared else type)
        return cls
