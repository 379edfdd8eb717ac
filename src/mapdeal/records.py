"""Data classes whose methods are not compiled anew at each start.

The standard decorator writes the source of six methods for each class and compiles it when the
module is imported: half a millisecond a class, which for a command's hundred classes is as long
as all the rest of its start. Here all classes share the same methods. The classes are data classes
like any other: `dataclasses.fields`, `replace` and `asdict` take them, and type checkers see the
standard decorator.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    import dataclasses
    from dataclasses import MISSING, FrozenInstanceError
    from reprlib import recursive_repr

    def dataclass(cls=None, /, *, frozen=False, eq=True, repr=True):  # noqa: A002 - as in the library
        """Make a class a data class: `dataclasses.dataclass` without its generated code."""
        if cls is None:
            return lambda made: _made(made, frozen, eq, repr)
        return _made(cls, frozen, eq, repr)

    def _made(cls, frozen, eq, shows):
        has_hash = cls.__dict__.get("__hash__") is not None
        if not cls.__doc__:  # else the library looks for a signature, for milliseconds
            cls.__doc__ = cls.__name__
        cls = dataclasses.dataclass(init=False, repr=False, eq=False)(cls)
        fields = dataclasses.fields(cls)
        _add(cls, "__init__", _initialiser(fields, hasattr(cls, "__post_init__")))
        if "__init__" in cls.__dict__ and "__signature__" not in cls.__dict__:
            cls.__signature__ = _Signature()
        if shows:
            _add(cls, "__repr__", _representation([f.name for f in fields if f.repr]))
        if eq:
            compared = [f for f in fields if f.compare]
            _add(cls, "__eq__", _comparison([f.name for f in compared]))
            if not has_hash:
                hashed = [f.name for f in compared if f.hash is not False]
                cls.__hash__ = _hashing(hashed) if frozen else None
        if frozen:
            _freeze(cls, frozenset(f.name for f in fields))
        return cls

    def _add(cls, name, method):
        """Give a class a method, unless it has its own."""
        if name not in cls.__dict__:
            method.__name__ = name
            method.__qualname__ = f"{cls.__qualname__}.{name}"
            setattr(cls, name, method)

    def _initialiser(fields, has_more):
        given = tuple(f.name for f in fields if f.init)
        count, known = len(given), frozenset(given)
        defaults = {f.name: f.default for f in fields if f.default is not MISSING}
        factories = {f.name: f.default_factory for f in fields if f.default_factory is not MISSING}
        names = tuple(f.name for f in fields)

        def __init__(self, /, *values, **named):  # noqa: N807 - it becomes the method
            attributes = self.__dict__
            if named or len(values) != len(names):
                if len(values) > count:
                    rule = f"takes {count} values but {len(values)} were given"
                    raise TypeError(f"{type(self).__name__}() {rule}")
                found = dict(zip(given, values, strict=False))
                for name, value in named.items():
                    if name not in known or name in found:
                        rule = "is given twice" if name in known else "is not one of its fields"
                        raise TypeError(f"{type(self).__name__}(): {name!r} {rule}")
                    found[name] = value
                for name in names:
                    if name in found:
                        attributes[name] = found[name]
                    elif name in defaults:
                        attributes[name] = defaults[name]
                    elif name in factories:
                        attributes[name] = factories[name]()
                    elif name in known:
                        raise TypeError(f"{type(self).__name__}() needs {name!r}")
            else:
                attributes.update(zip(names, values, strict=True))
            if has_more:
                self.__post_init__()

        return __init__

    class _Factory:
        """Stands in signatures for a default that is made for each instance."""

        def __repr__(self):
            return "<factory>"

    _FACTORY = _Factory()

    class _Signature:
        """The parameters of a class, found out when somebody asks, such as ``help``."""

        def __get__(self, instance, owner=None):
            import inspect

            if instance is not None:
                raise AttributeError("__signature__")
            kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
            parameters = []
            for field in dataclasses.fields(owner):
                default = field.default
                if field.default_factory is not MISSING:
                    default = _FACTORY
                elif default is MISSING:
                    default = inspect.Parameter.empty
                if field.init:
                    parameter = inspect.Parameter(
                        field.name, kind, default=default, annotation=field.type
                    )
                    parameters.append(parameter)
            return inspect.Signature(parameters, return_annotation=None)

    def _representation(names):
        @recursive_repr()
        def __repr__(self):  # noqa: N807 - it becomes the method
            text = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
            return f"{type(self).__qualname__}({text})"

        return __repr__

    def _comparison(names):
        def __eq__(self, other):  # noqa: N807 - it becomes the method
            if other.__class__ is not self.__class__:
                return NotImplemented
            mine = tuple([getattr(self, name) for name in names])
            return mine == tuple([getattr(other, name) for name in names])

        return __eq__

    def _hashing(names):
        def __hash__(self):  # noqa: N807 - it becomes the method
            return hash(tuple([getattr(self, name) for name in names]))

        return __hash__

    def _freeze(cls, names):
        def __setattr__(self, name, value):  # noqa: N807 - it becomes the method
            if type(self) is cls or name in names:
                raise FrozenInstanceError(f"cannot assign to field {name!r}")
            super(cls, self).__setattr__(name, value)

        def __delattr__(self, name):  # noqa: N807 - it becomes the method
            if type(self) is cls or name in names:
                raise FrozenInstanceError(f"cannot delete field {name!r}")
            super(cls, self).__delattr__(name)

        for method in (__setattr__, __delattr__):
            method.__qualname__ = f"{cls.__qualname__}.{method.__name__}"
            setattr(cls, method.__name__, method)
