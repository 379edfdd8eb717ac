"""Options of ``mapdeal run`` that say where a robot stands on the map, and what is made there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.completion import recipe_words, setting_words
from mapdeal.errors import ParameterError
from mapdeal.grid.footprint import Footprint
from mapdeal.mapping.local_map import CloudFrame, LocalOptions
from mapdeal.mapping.transforms import check_pose
from mapdeal.pipeline.recipe import BUILT_IN, load_recipe
from mapdeal.pipeline.run import LOCAL_RECIPE
from mapdeal.stages.definition import unknown_name

if TYPE_CHECKING:
    from mapdeal.pipeline.local import Around

_SET = "--local-set"

PoseOption = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,YAW",
        help="Also make the local map around a robot at this pose, as `mapdeal local` does, in "
        "the subfolder local of the map's folder.",
    ),
]
CloudOption = Annotated[
    str | None,
    typer.Option(
        "--cloud",
        metavar="FILE",
        help="The point cloud that the robot at --pose sees. Without it the local map is a "
        "window of the map.",
    ),
]
FrameOption = Annotated[
    CloudFrame | None,
    typer.Option(
        help="The frame of the cloud's coordinates.  [default: robot]", show_default=False
    ),
]
LocalRecipe = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        autocompletion=recipe_words,
        help=f"Recipe of the local map: one of {', '.join(BUILT_IN)}, or a file.  "
        f"[default: {LOCAL_RECIPE}]",
    ),
]
LocalChanges = Annotated[
    list[str] | None,
    typer.Option(
        _SET,
        metavar="STAGE.PARAMETER=VALUE",
        autocompletion=setting_words,
        help="Change a parameter of the local recipe, or an option of `mapdeal local`, such as "
        "local.size=12,8; can be repeated.",
    ),
]


def refuse_in_set(changes: Sequence[str]) -> None:
    """Refuse options of the local map among those of the recipe, and name where they go."""
    for text in changes:
        if text.strip().startswith(f"{LOCAL_RECIPE}."):
            hint = f"with --pose, {_SET} takes what the local map is made with"
            raise ParameterError(
                "is not a parameter of a stage", source="--set", got=text, hint=hint
            )


def around_of(
    pose: str | None,
    cloud: str | None,
    frame: CloudFrame | None,
    recipe: str | None,
    changes: Sequence[str] | None,
    footprint: Footprint | None,
) -> Around | None:
    if pose is None:
        given = {"--cloud": cloud, "--frame": frame, "--local-recipe": recipe, _SET: changes}
        for name, value in given.items():
            if value not in (None, []):
                raise ParameterError("needs --pose", source=name)
        return None
    if cloud is None and frame is not None:
        raise ParameterError("needs --cloud", source="--frame")
    from mapdeal.pipeline.local import Around, only_cloud

    place = check_pose(opt.numbers(pose, 3, "X,Y,YAW", "--pose"), "--pose")
    own = [text for text in changes or [] if text.strip().startswith(f"{LOCAL_RECIPE}.")]
    others = [text for text in changes or [] if text not in own]
    options = dict(map(_option_of, own))
    if cloud is None:
        for name in options:
            if name not in _OF_WINDOWS:
                raise ParameterError("needs --cloud", source=_SET, got=f"{LOCAL_RECIPE}.{name}")
    return Around(
        place,
        load_recipe(
            LOCAL_RECIPE if recipe is None else recipe,
            footprint=footprint,
            settings=others,
            prefix="--local-",
        ),
        LocalOptions(frame or "robot", **options),
        None if cloud is None else only_cloud([cloud]).path,
        takes_cells=cloud is None and "resolution" not in options,
    )


def _number(text: str, name: str) -> float:
    (value,) = opt.numbers(text, 1, "V", name)
    return value


def _word(text: str, _: str) -> str:
    return text


_OPTIONS: dict[str, Callable[[str, str], Any]] = {
    "offset": opt.pair,
    "size": opt.pair,
    "resolution": _number,
    "min_height": _number,
    "max_height": _number,
    "min_range": _number,
    "max_range": _number,
    "raytrace_range": _number,
    "unknown": _word,
}
_OF_WINDOWS = ("size", "resolution", "unknown")


def _option_of(text: str) -> tuple[str, Any]:
    """Return name and value of a change of the command local's options."""
    target, equals, value = text.partition("=")
    name = target.strip().removeprefix(f"{LOCAL_RECIPE}.").replace("-", "_")
    if not equals:
        raise ParameterError("must look like stage.parameter=value", source=_SET, got=text)
    if name not in _OPTIONS:
        raise unknown_name("option", name, list(_OPTIONS), place=_SET)
    return name, _OPTIONS[name](value.strip(), f"{_SET} {LOCAL_RECIPE}.{name}")
