"""How grids and results are displayed: one line of text, and a picture in notebooks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence

Drawer = Callable[[object], bytes | None]
"""Returns the picture of something as the bytes of a PNG, None if it is better not drawn."""

MOST_COUNTED = 100_000_000
"""Cells whose values a line of text counts: that takes some tenths of a second."""

_MOST_LISTED = 6

_drawers: list[Drawer] = []


def draw_with(drawer: Drawer) -> None:
    """Set the function that draws pictures for notebooks; grids cannot draw themselves."""
    _drawers[:] = [drawer]


class OneLine:
    """Base class of objects whose repr is one line, whatever arrays they contain."""

    __slots__ = ()

    @abstractmethod
    def _told(self) -> Iterator[str]:
        """Yield what there is to say, piece by piece."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._told())})"


class Drawn(OneLine):
    """Base class of objects that notebooks also show as a picture."""

    __slots__ = ()

    def _repr_png_(self) -> bytes | None:
        """Return the picture that IPython and Jupyter show, None if there is none."""
        return _drawers[0](self) if _drawers else None


def numbers_text(numbers: Iterable[float]) -> str:
    """Return numbers in brackets, such as an origin.

    Examples
    --------
    >>> numbers_text((1.5, -2.0, 0.1 + 0.2))
    '(1.5, -2, 0.3)'
    """
    return f"({', '.join(f'{number + 0.0:.10g}' for number in numbers)})"


def points_text(points: Sequence[Sequence[float]]) -> str:
    """Return points in brackets, or of many the first and how many there are.

    Examples
    --------
    >>> points_text([(0, 0), (1, 0.5)])
    '[(0, 0), (1, 0.5)]'
    >>> points_text([(0, 0)] * 10)
    '10 points from (0, 0)'
    """
    if len(points) > _MOST_LISTED:
        return f"{len(points)} points from {numbers_text(points[0])}"
    return f"[{', '.join(map(numbers_text, points))}]"


def count_text(count: int, what: str) -> str:
    """Return a count with its noun, which gets an s if there are several.

    Examples
    --------
    >>> count_text(1, "point"), count_text(0, "point")
    ('1 point', '0 points')
    """
    return f"{count} {what}{'s' * (count != 1)}"
