"""Options that the commands share which run a recipe into a folder."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.pipeline.recipe import BUILT_IN

Recipe = Annotated[
    str, typer.Option(metavar="NAME|FILE", help=f"One of {', '.join(BUILT_IN)}, or a file.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="STAGE.PARAMETER=VALUE", help="Change a parameter; can be repeated."
    ),
]
ImageMax = Annotated[
    int,
    typer.Option(metavar="PIXELS", min=0, help="Longest side of pictures; 0 for a pixel per cell."),
]
NoImages = Annotated[bool, typer.Option("--no-images", help="Write no pictures.")]
