"""``mapdeal completion``: a script that has a shell complete the words of mapdeal."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.shells import SHELLS
from mapdeal.cli.words import command_words
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options()
def completion(
    shell: Annotated[
        Literal["bash", "zsh", "fish"], typer.Argument(metavar="SHELL", help="bash, zsh or fish.")
    ],
    *,
    settings: Settings,  # noqa: ARG001 - every command takes them
) -> None:
    """Print a completion script for commands, options, values and files.

    bash, in ~/.bashrc: eval "$(mapdeal completion bash)". zsh, in ~/.zshrc after compinit: eval
    "$(mapdeal completion zsh)". fish: mapdeal completion fish >
    ~/.config/fish/completions/mapdeal.fish. The script contains all words, so that completion
    starts no process; make it again after an upgrade.
    """
    terminal.result(script_for(shell))


def script_for(shell: str) -> str:
    """Return the script of a shell."""
    from mapdeal.cli import main  # which imports this module

    return SHELLS[shell](command_words("mapdeal", typer.main.get_command(main.app)))
