"""Settings of a command that are not parameters of stages, and collected warnings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from numbers import Integral
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeVar

from mapdeal.errors import ParameterError, collect_warnings, one_line
from mapdeal.files.source import use_memory
from mapdeal.grid import frame, values
from mapdeal.kernels.blocks import rows_reported
from mapdeal.maps import dialects, map_server
from mapdeal.pictures.overlay import DEFAULT_EXTENT, DEFAULT_IMAGE_MAX, ImageExtent
from mapdeal.records import dataclass

Canvas = Literal["crop", "full"]
Advance = Callable[[int], object]  # called with the number of steps since the last call
ProgressCallback = Callable[[int], AbstractContextManager[Advance]]
"""Called with the number of all steps; its context is the function that reports progress."""


def is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


@dataclass(frozen=True)
class Settings:
    dialect: dialects.Dialect = "nav2"
    max_cells: int | None = None
    resolution: float | None = None  # of an image that is read without its YAML file
    origin: frame.Origin = (0.0, 0.0, 0.0)
    force: bool = False
    threads: int | None = None
    max_memory: int | None = None
    image: Path | None = None
    mask: Path | None = None
    images: bool = True
    image_max: int = DEFAULT_IMAGE_MAX
    image_extent: ImageExtent = DEFAULT_EXTENT
    canvas: Canvas = "crop"
    progress: ProgressCallback | None = None
    strict: bool = False
    memory_is_chosen: bool = True

    def __post_init__(self) -> None:
        values.check_choice(self.dialect, dialects.Dialect, "dialect")
        values.check_choice(self.canvas, Canvas, "canvas")
        values.check_choice(self.image_extent, ImageExtent, "image_extent")
        if self.resolution is not None:
            object.__setattr__(self, "resolution", frame.check_resolution(self.resolution))
        object.__setattr__(self, "origin", frame.check_origin(self.origin))
        for name, least in (("max_cells", 1), ("threads", 1), ("max_memory", 1), ("image_max", 0)):
            value = getattr(self, name)
            if value is not None and not (is_whole(value) and value >= least):
                rule = f"must be a whole number, at least {least}"
                raise ParameterError(rule, place=name, got=value)

    @contextmanager
    def reading(self, *, anew: bool = False) -> Iterator[None]:
        """Apply the memory limit and the resolution of images without a YAML file to readers."""
        images: AbstractContextManager[None] = nullcontext()
        if self.resolution is not None:
            images = map_server.bare_images(self.resolution, self.origin)
        with use_memory(self.max_memory, is_chosen=self.memory_is_chosen, anew=anew), images:
            yield

    @property
    def picture_size(self) -> int | None:
        return self.image_max if self.images else None

    @property
    def picture_options(self) -> dict[str, Any]:
        shown = {"images": bool(self.images), "image_max": int(self.image_max)}
        return {**shown, "image_extent": self.image_extent}


DEFAULT_SETTINGS = Settings()
Item = TypeVar("Item")
_STEPS = 1000  # of progress in one pass through a layer


@contextmanager
def passes_reported(progress: ProgressCallback | None, passes: int) -> Iterator[None]:
    if progress is None:
        yield
        return
    lock, most = Lock(), passes * _STEPS
    passes_made, steps_reported = 0.0, 0
    with progress(most) as advance:

        def report(rows: int, height: int) -> None:  # from any thread
            nonlocal passes_made, steps_reported
            with lock:
                passes_made += rows / height
                if (reached := min(int(_STEPS * passes_made + 1e-6), most)) > steps_reported:
                    advance(reached - steps_reported)
                    steps_reported = reached

        with rows_reported(report):
            yield
        if steps_reported < most:  # a result needed no pass
            advance(most - steps_reported)


@contextmanager
def report_nothing(_: int) -> Iterator[Advance]:
    yield lambda _: None


@contextmanager
def adding_warnings(texts: list[str]) -> Iterator[None]:
    with collect_warnings() as caught:
        try:
            yield
        finally:
            texts += map(str, caught)


def collected_from(items: Iterable[Item], texts: list[str]) -> Iterator[Item]:
    """Yield items; add the texts of warnings raised while each is computed to a list."""
    iterator = iter(items)
    while True:
        with adding_warnings(texts):
            try:
                item = next(iterator)
            except StopIteration:
                return
        yield item


def portable(texts: Iterable[str], files: Iterable[Path]) -> list[str]:
    """Return each warning once, with names of files instead of their paths."""
    return renamed(texts, {str(file): file.name for file in files})


def renamed(texts: Iterable[str], names: dict[str, str]) -> list[str]:
    """Return each text once, on one line; rename the file that it begins with."""
    # A colon follows the name, perhaps a line number.
    renamed: dict[str, None] = {}
    for text in texts:
        old = next((name for name in names if text.startswith(f"{name}:")), None)
        renamed[one_line(text if old is None else names[old] + text.removeprefix(old))] = None
    return list(renamed)
