"""``mapdeal completion``: typer's script for a shell, and the words that mapdeal offers."""

from __future__ import annotations

import os
import re
import sys
from typing import Annotated, Any, Literal

from mapdeal.cli import terminal
from mapdeal.command import Words, command

VARIABLE = "_MAPDEAL_COMPLETE"  # set by the scripts when they request words


@command(
    group="CI and reports", shared=(), json="never",
    example="mapdeal completion bash > mapdeal.bash",
)  # fmt: skip
def completion(
    shell: Annotated[Literal["bash", "zsh", "fish", "powershell"], Words("SHELL")],
) -> None:
    """Print a completion script for commands, options, values and files.

    bash, in ~/.bashrc: eval "$(mapdeal completion bash)". zsh, in ~/.zshrc after compinit: eval
    "$(mapdeal completion zsh)". fish: mapdeal completion fish >
    ~/.config/fish/completions/mapdeal.fish. PowerShell, in $PROFILE: mapdeal completion
    powershell | Out-String | Invoke-Expression. The script asks mapdeal for words at each TAB.

    Parameters
    ----------
    shell : str
        The shell: bash, zsh, fish or powershell.
    """
    from typer._completion_shared import get_completion_script

    terminal.result(get_completion_script(prog_name="mapdeal", complete_var=VARIABLE, shell=shell))


def prepare_completion() -> None:
    try:
        from typer._completion_classes import BashComplete, completion_init
    except ImportError:  # typer before 0.12
        from typer._completion_click8 import (  # type: ignore[import-not-found, no-redef]
            BashComplete,
            completion_init,
        )

    class Bash(BashComplete):
        """Bash splits words at ``=`` and completes the part after the last one."""

        def get_completion_args(self) -> tuple[list[str], str]:
            words = os.environ["COMP_WORDS"].split("\n")[: int(os.environ["COMP_CWORD"]) + 1]
            line = re.sub(r"\n=\n?", "=", "\n".join(words))
            os.environ.update(COMP_WORDS=line, COMP_CWORD=str(line.count("\n")))
            return super().get_completion_args()

        def format_completion(self, item: Any) -> str:
            before = os.environ["COMP_WORDS"].rpartition("\n")[2].rpartition("=")[0]
            return str(item.value).removeprefix(f"{before}=")

    completion_init()
    sys.modules[BashComplete.__bases__[0].__module__].add_completion_class(Bash, "bash")
