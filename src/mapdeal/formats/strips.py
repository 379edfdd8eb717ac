"""Pictures that come in strips of rows, so that nobody needs all their pixels at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from mapdeal.formats.picture import Picture

_PIXELS_TOGETHER = 1 << 22


@dataclass(frozen=True, eq=False)
class Strips:
    """A picture whose rows are decoded some at a time, from the north to the south.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of the whole picture.
    pictures : callable
        Called without arguments, it starts anew and yields one picture after the other: all of
        the same width, colour, maxval and palette, whose rows make the whole, row 0 of each in
        the north. What is damaged is found when its strip is asked for, or at the end.
    """

    shape: tuple[int, int]
    pictures: Callable[[], Iterator[Picture]]

    def placed(self) -> Iterator[tuple[slice, Picture]]:
        """Yield each strip and its rows, counted from the south, as grids count them."""
        stop = self.shape[0]
        for picture in self.pictures():
            start = stop - picture.shape[0]
            yield slice(start, stop), picture
            stop = start


def strips_of(picture: Picture) -> Strips:
    """Return the strips of a picture that is in memory; they are views of it."""
    height, width = picture.shape
    step = max(1, _PIXELS_TOGETHER // width)

    def parts() -> Iterator[Picture]:
        for first in range(0, height, step):
            rows = slice(first, first + step)
            alpha = None if picture.alpha is None else picture.alpha[rows]
            yield replace(picture, samples=picture.samples[rows], alpha=alpha)

    return Strips(picture.shape, parts)
