"""What a command was asked for beside the parameters of its stages: one type, all the way."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from numbers import Integral
from pathlib import Path
from typing import Any, Literal

from mapdeal.errors import ParameterError
from mapdeal.formats.budget import use_memory
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.values import check_choice
from mapdeal.records import dataclass
from mapdeal.render.raster import DEFAULT_IMAGE_MAX
from mapdeal.render.shown import DEFAULT_EXTENT, ImageExtent

Canvas = Literal["crop", "full"]

Advance = Callable[[int], object]
"""Called with the number of steps that have just been taken."""

ProgressCallback = Callable[[int], AbstractContextManager[Advance]]
"""Called with the number of all steps; gives, within a ``with`` block, what to call."""


def is_whole(value: object) -> bool:
    """Return whether a value is a whole number, of Python's or numpy's."""
    return isinstance(value, Integral) and not isinstance(value, bool)


@dataclass(frozen=True)
class Settings:
    """How a command reads its inputs, computes, draws and writes its outputs."""

    dialect: Dialect = "nav2"
    max_cells: int | None = None
    force: bool = False
    threads: int | None = None
    max_memory: int | None = None
    image: Path | None = None
    images: bool = True
    image_max: int = DEFAULT_IMAGE_MAX
    image_extent: ImageExtent = DEFAULT_EXTENT
    canvas: Canvas = "crop"
    progress: ProgressCallback | None = None
    strict: bool = False
    memory_is_chosen: bool = True

    def __post_init__(self) -> None:
        check_choice(self.dialect, Dialect, "dialect")
        check_choice(self.canvas, Canvas, "canvas")
        check_choice(self.image_extent, ImageExtent, "image_extent")
        for name, least in (("max_cells", 1), ("threads", 1), ("max_memory", 1), ("image_max", 0)):
            value = getattr(self, name)
            if value is not None and not (is_whole(value) and value >= least):
                rule = f"must be a whole number, at least {least}"
                raise ParameterError(rule, place=name, got=value)

    def memory(self, *, anew: bool = False) -> AbstractContextManager[None]:
        """Hold readers to the memory within a ``with`` block, see `use_memory`."""
        return use_memory(self.max_memory, is_chosen=self.memory_is_chosen, anew=anew)

    @property
    def picture_size(self) -> int | None:
        """`image_max` of the pictures in a folder, None if it gets none."""
        return self.image_max if self.images else None

    @property
    def picture_options(self) -> dict[str, Any]:
        """What shapes the pictures in a folder, as JSON can hold it."""
        return {
            "images": bool(self.images),
            "image_max": int(self.image_max),
            "image_extent": self.image_extent,
        }


DEFAULT_SETTINGS = Settings()
