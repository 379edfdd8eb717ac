"""What shells complete, by the shells themselves."""

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mapdeal.checks.findings import CHECKS
from mapdeal.cli.main import command_names, main
from mapdeal.command import meanings_of
from mapdeal.commands.local import local
from mapdeal.commands.run import run_maps
from mapdeal.pipeline.recipe import BUILT_IN
from mapdeal.stages.catalogue import STAGES

# Words of a command line, the last of them to be completed, with their completions. Where there
# are none, the shell offers files.
CASES = [
    (["r"], {"run", "reach", "route", "rotate", "rescale", "report"}),
    (["edit", "polygon", "--overlay", ""], {"seq", "max", "min"}), (["--ver"], {"--version"}),
    (["inflate", "--kernel=s"], {"square"}), (["cost", "--model", "r"], {"rings"}),
    (["convert", "--encoding", "a"], {"amcl"}),
    (["run", "map.yaml", "--recipe", "design-"], {"design-real", "design-sim", "design-local"}),
    (["run", "--set", "inflate.ker"], {"inflate.kernel=disc", "inflate.kernel=square"}),
    (["run", "--set", "cost.model=t"], {"threshold"}),  # bash replaces what follows =
    (["lint", "--select", "yaml.mode,map.spe"], {"yaml.mode,map.specks"}),
    (["inflate", "m"], set()), (["run", "-o", "m"], set()), (["nonsense", "x"], set()),
    (["inflate", "--radius", "not a number", "--nonsense", "--ker"], {"--kernel"}),
]  # fmt: skip


@pytest.fixture
def answer(monkeypatch, capsys):
    def ask(shell, **variables):
        with monkeypatch.context() as patch, pytest.raises(SystemExit) as ended:
            patch.setenv("_MAPDEAL_COMPLETE", f"complete_{shell}")
            for name, value in variables.items():
                patch.setenv(name, value)
            main([])
        out, err = capsys.readouterr()
        assert (ended.value.code, err) == (0, "")
        return out

    return ask


@pytest.fixture
def offered(answer):
    """What mapdeal offers to bash, which asks as its script has it ask."""

    def words_for(*words):
        # as readline splits words: at = too
        split = [part for word in words for part in re.findall(r"=|[^=]+", word) or [""]]
        typed = [f"'{word}'" if " " in word else word for word in ("mapdeal", *split)]
        out = answer("bash", COMP_WORDS="\n".join(typed), COMP_CWORD=str(len(split)))
        return set(out.splitlines()) - {""}

    return words_for


@pytest.mark.parametrize(("words", "expected"), CASES)
def test_offered_words(offered, words, expected):
    assert offered(*words) == expected


def test_powershell_is_answered(answer):
    variables = {"ARGS": "mapdeal inflate --ker", "WORD_TO_COMPLETE": "--ker"}
    variables = {f"_TYPER_COMPLETE_{name}": value for name, value in variables.items()}
    assert answer("powershell", **variables).startswith("--kernel:::")


def test_every_option_in_the_help_is_offered(offered, command):
    names = [name for name in command_names() if name != "edit"]
    for name in (*names, *(f"edit {shape}" for shape in offered("edit", ""))):
        completions = offered(*name.split(), "-")
        help_text = command(*name.split(), "--help")[1]
        listed = " ".join(re.findall(r"(?m)^  (-.*?)(?:  |$)", help_text))
        assert set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", listed)) <= completions, name
        assert completions - {"-h"} <= set(re.findall(r"--?[\w-]+", help_text)), name


def test_every_parameter_recipe_and_check_is_offered(offered):
    settings = {setting.partition("=")[0] for setting in offered("run", "--set", "")}
    assert settings >= {f"{stage.name}.{name}" for stage in STAGES for name in stage.parameters}
    assert offered("run", "--recipe", "") == set(BUILT_IN)
    assert offered("lint", "--ignore", "") == set(CHECKS)


@pytest.mark.parametrize("function", [run_maps, local])
def test_help_names_all_built_in_recipes(function):
    assert f"One of {', '.join(BUILT_IN)}, or a file." in meanings_of(function)["recipe"]


# Lines that have one completion: the word that the shell makes of the last one.
TYPED = {
    "comp": "completion", "inflate --ker": "--kernel",
    "run --set cost.model=t": "cost.model=threshold", "inflate map.y": "map.yaml",
}  # fmt: skip
# The program is a function there that prints its arguments; the script starts the process.
PRINT = "mapdeal() { local IFS='|'; printf 'GO''T<%s>\\n' \"$*\"; }"
STARTS = {
    "bash": (["--norc", "--noprofile"], ""),
    "zsh": (["-f"], "autoload -Uz compinit; compinit -u -D; "),
}


@pytest.fixture
def shell_finds(command, here, monkeypatch):
    def prepare(shell):
        if shutil.which(shell) is None:
            pytest.skip(f"needs {shell}")
        Path("script").write_text(command("completion", shell)[1])
        monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
        monkeypatch.setenv("TERM", "dumb")
        monkeypatch.setenv("ZDOTDIR", str(here))
        Path("work").mkdir()
        Path("work/map.yaml").touch()

    return prepare


@pytest.mark.slow
def test_fish_completes(shell_finds):
    shell_finds("fish")
    lines = "".join(f"complete -C 'mapdeal {line}'; echo ----\n" for line in TYPED)
    words = ["fish", "-c", f"source ../script\n{lines}"]
    answers = subprocess.check_output(words, cwd="work", text=True).split("----\n")[:-1]
    assert [re.sub(r"\t.*", "", text).strip() for text in answers] == list(TYPED.values())


@pytest.mark.slow
@pytest.mark.parametrize("shell", STARTS)
def test_completes_at_tab(shell_finds, shell):
    """Type lines into a terminal of its own, each with a tab at its end."""
    shell_finds(shell)
    options, start = STARTS[shell]
    child, terminal = pty.fork()
    if child == 0:
        os.chdir("work")
        os.execlp(shell, shell, *options, "-i")  # noqa: S606 - it needs a terminal of its own
    try:
        line = f"PS1=; stty -echo; {start}{PRINT}; source ../script; echo READ''Y\n"
        os.write(terminal, line.encode())
        read_until(terminal, rb"READY")
        for line, expected in TYPED.items():
            os.write(terminal, f"mapdeal {line}\t\n".encode())
            found = read_until(terminal, rb"GOT<(.*?)>")
            assert found[1].decode().split("|") == [*line.split()[:-1], expected]
        os.write(terminal, b"exit\n")
    finally:
        os.close(terminal)
        os.waitpid(child, 0)


def read_until(terminal, pattern, seconds=60):
    shown, end = b"", time.monotonic() + seconds
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            shown += os.read(terminal, 1 << 16)
            found = re.search(pattern, shown)
            if found:
                return found
    raise AssertionError(shown)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_scripts_ask_mapdeal(sh, shell):
    script = sh.ok(f"completion {shell}")
    assert "_MAPDEAL_COMPLETE" in script
    assert f"complete_{shell}" in script
