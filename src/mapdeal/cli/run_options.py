"""Options that the commands share which run a recipe into a folder."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.pipeline.recipe import BUILT_IN, DEFAULT

Recipe = Annotated[
    str, typer.Option(metavar="NAME|FILE", help=f"One of {', '.join(BUILT_IN)}, or a file.")
]
RunRecipe = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        help=f"One of {', '.join(BUILT_IN)}, or a file.  [default: {DEFAULT}; with --params-file "
        "the robot's costmap]",
        show_default=False,
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="STAGE.PARAMETER=VALUE",
        help="Set a parameter of a stage; can be repeated.",
    ),
]
