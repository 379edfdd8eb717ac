"""``mapdeal completion``: typer's script for a shell, and the words that mapdeal then offers."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import typer

from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.pipeline.settings import Settings

VARIABLE = "_MAPDEAL_COMPLETE"
"""What the scripts set where they ask for words."""

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options()
def completion(
    shell: Annotated[
        Literal["bash", "zsh", "fish", "powershell"],
        typer.Argument(metavar="SHELL", help="bash, zsh, fish or powershell."),
    ],
    *,
    settings: Settings,  # noqa: ARG001 - every command takes them
) -> None:
    """Print a completion script for commands, options, values and files.

    bash, in ~/.bashrc: eval "$(mapdeal completion bash)". zsh, in ~/.zshrc after compinit: eval
    "$(mapdeal completion zsh)". fish: mapdeal completion fish >
    ~/.config/fish/completions/mapdeal.fish. PowerShell, in $PROFILE: mapdeal completion
    powershell | Out-String | Invoke-Expression. The script asks mapdeal for words at each TAB.
    """
    from typer._completion_shared import get_completion_script

    terminal.result(get_completion_script(prog_name="mapdeal", complete_var=VARIABLE, shell=shell))


def prepare_completion() -> None:
    """Have typer answer a shell in place of running a command."""
    from typer._completion_classes import BashComplete, completion_init

    class Bash(BashComplete):
        """Bash, which splits words at ``=`` and replaces what stands behind the last one."""

        def get_completion_args(self) -> tuple[list[str], str]:
            words = os.environ["COMP_WORDS"].split("\n")[: int(os.environ["COMP_CWORD"]) + 1]
            whole = re.sub(r"\n=\n?", "=", "\n".join(words))
            os.environ.update(COMP_WORDS=whole, COMP_CWORD=str(whole.count("\n")))
            return super().get_completion_args()

        def format_completion(self, item: Any) -> str:
            typed = os.environ["COMP_WORDS"].rpartition("\n")[2]
            before = typed.rpartition("=")[0]
            return str(item.value).removeprefix(f"{before}=")

    completion_init()
    sys.modules[BashComplete.__bases__[0].__module__].add_completion_class(Bash, "bash")


def recipe_words() -> Iterable[str]:
    from mapdeal.pipeline.recipe import BUILT_IN

    return BUILT_IN


def setting_words() -> Iterable[str]:
    """Return ``stage.parameter=`` for each parameter of each stage, with its choices behind."""
    from mapdeal.stages.catalogue import STAGES

    words: dict[str, None] = {}  # models of a stage share parameters
    for stage in STAGES:
        if stage.model:
            words[f"{stage.name}.model={stage.model}"] = None
        for name, parameter in stage.parameters.items():
            choices = ("yes", "no") if parameter.kind is bool else parameter.choices
            words |= dict.fromkeys(f"{stage.name}.{name}={choice}" for choice in choices or ("",))
    return words


def check_words(incomplete: str) -> Iterable[str]:
    """Return the names of the checks of lint, behind those that are already listed."""
    from mapdeal.checks import lint  # noqa: F401 - which registers them
    from mapdeal.checks.findings import CHECKS

    listed = incomplete.rpartition(",")[0]
    return [f"{listed},{name}" if listed else name for name in sorted(CHECKS)]
