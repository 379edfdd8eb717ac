"""Options that the commands share which run a recipe into a folder."""

from __future__ import annotations

from typing import Annotated

import typer

from mapdeal.cli.completion import recipe_words, setting_words
from mapdeal.pipeline.recipe import BUILT_IN, DEFAULT

Recipe = Annotated[
    str,
    typer.Option(
        metavar="NAME|FILE",
        autocompletion=recipe_words,
        help=f"One of {', '.join(BUILT_IN)}, or a file.",
    ),
]
RunRecipe = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        autocompletion=recipe_words,
        help=f"One of {', '.join(BUILT_IN)}, or a file.  [default: {DEFAULT}; with --params-file "
        "the robot's costmap]",
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="STAGE.PARAMETER=VALUE",
        autocompletion=setting_words,
        help="Set a parameter of a stage; can be repeated.",
    ),
]
