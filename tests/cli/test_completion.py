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

SHELLS = ["bash", "zsh", "fish", "powershell"]

# Words of a command line, the last of them to be completed, and what is offered; nothing, and the
# shell offers files.
CASES = [
    (["r"], {"run", "reach", "route", "rotate", "rescale", "report"}),
    (["completion", ""], set(SHELLS)),
    (["edit", ""], {"polygon", "line", "circle", "reset"}),
    (["edit", "polygon", "--ov"], {"--overlay"}),
    (["edit", "polygon", "--overlay", ""], {"seq", "max", "min"}),
    (["--ver"], {"--version"}),
    (["inflate", "--ker"], {"--kernel"}),
    (["inflate", "--kernel", ""], {"disc", "square"}),
    (["inflate", "--kernel=s"], {"square"}),
    (["cost", "--model", "r"], {"rings"}),
    (["esdf", "--convention", "c"], {"center"}),
    (["convert", "--encoding", "a"], {"amcl"}),
    (["info", "--dialect", ""], {"nav2", "humble", "ros1"}),
    (["run", "map.yaml", "--recipe", "design-"], {"design-real", "design-sim", "design-local"}),
    (["run", "--set", "inflate.ker"], {"inflate.kernel=disc", "inflate.kernel=square"}),
    (["run", "--set", "esdf.strengt"], {"esdf.strength="}),
    (["run", "--set", "cost.model=t"], {"threshold"}),  # bash replaces what follows =
    (["run", "--local-set", "inflate.inflate_unknown="], {"yes", "no"}),
    (["lint", "--select", "yaml.mode,map.spe"], {"yaml.mode,map.specks"}),
    (["inflate", "m"], set()),
    (["run", "-o", "m"], set()),
    (["nonsense", "x"], set()),
    (["inflate", "--radius", "not a number", "--nonsense", "--ker"], {"--kernel"}),
]


@pytest.fixture
def offered(monkeypatch, capsys):
    """What mapdeal offers to bash, which asks as its script has it ask."""

    def words_for(*words):
        # as readline splits words: at = too
        split = [part for word in words for part in re.findall(r"=|[^=]+", word) or [""]]
        monkeypatch.setenv("_MAPDEAL_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", "\n".join(["mapdeal", *map(as_typed, split)]))
        monkeypatch.setenv("COMP_CWORD", str(len(split)))
        with pytest.raises(SystemExit) as ended:
            main([])
        out, err = capsys.readouterr()
        assert (ended.value.code, err) == (0, "")
        return set(out.splitlines()) - {""}

    return words_for


def as_typed(word):
    return f"'{word}'" if " " in word else word


@pytest.mark.parametrize(("words", "expected"), CASES)
def test_offered_words(offered, words, expected):
    assert offered(*words) == expected


def test_every_option_that_help_tells_of_is_offered(offered, command, monkeypatch):
    names = [name for name in command_names() if name != "edit"]
    names += [f"edit {name}" for name in ("polygon", "line", "circle", "reset")]
    for name in names:
        made = offered(*name.split(), "-")
        monkeypatch.delenv("_MAPDEAL_COMPLETE")
        told = command(*name.split(), "--help")[1]
        listed = re.findall(r"(?m)^  (-.*?)(?:  |$)", told)
        expected = set(re.findall(r"(?<![\w-])--?[a-z][a-z0-9-]*", " ".join(listed)))
        assert {one for one in expected if len(one) > 2} <= made, name
        assert made - {"-h"} <= set(re.findall(r"--?[\w-]+", told)), name


def test_every_parameter_recipe_and_check_is_offered(offered):
    settings = offered("run", "--set", "")
    assert {one.partition("=")[0] for one in settings} >= {
        f"{stage.name}.{name}" for stage in STAGES for name in stage.parameters
    }
    assert offered("run", "--recipe", "") == set(BUILT_IN)
    assert offered("lint", "--ignore", "") == set(CHECKS)


@pytest.mark.parametrize("function", [run_maps, local])
def test_help_names_all_built_in_recipes(function):
    assert f"One of {', '.join(BUILT_IN)}, or a file." in meanings_of(function)["recipe"]


# Lines that have one completion: the word that the shell makes of the last one.
TYPED = [
    ("comp", "completion"),
    ("inflate --ker", "--kernel"),
    ("inflate map.yaml --kernel s", "square"),
    ("run --set cost.model=t", "cost.model=threshold"),
    ("inflate map.y", "map.yaml"),
    ("run -o ou", "out"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with files, and the scripts of all shells."""
    path = tmp_path_factory.mktemp("completion")
    (path / "here" / "out").mkdir(parents=True)
    (path / "here" / "map.yaml").touch()
    for shell in SHELLS:
        script = process("completion", shell)
        (path / f"{shell}.script").write_text(script)
    return path


def process(*words, **variables):
    """Return what a process of mapdeal prints."""
    done = subprocess.run(
        ["mapdeal", *words], env=environment() | variables, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout


def environment():
    """Variables with which shells find this mapdeal."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "TERM": "dumb"}


def needs(shell):
    return pytest.mark.skipif(shutil.which(shell) is None, reason=f"needs {shell}")


@pytest.mark.slow
@needs("fish")
def test_fish_completes(folder):
    code = "source ../fish.script\n"
    for line, _ in TYPED:
        code += f"complete -C 'mapdeal {line}'; echo ----\n"
    done = subprocess.run(
        ["fish", "-c", code], cwd=folder / "here", env=environment(), capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    blocks = done.stdout.split("----\n")
    for (line, expected), block in zip(TYPED, blocks, strict=False):
        made = {one.partition("\t")[0].rstrip("/") for one in block.splitlines()}
        assert made == {expected}, line


PRINT = "mapdeal() { local IFS='|'; printf 'GO''T<%s>\\n' \"$*\"; }"
STARTS = {
    "bash": (["--norc", "--noprofile"], ""),
    "zsh": (["-f"], "autoload -Uz compinit; compinit -u -D; "),
}


@pytest.mark.slow
@pytest.mark.parametrize("shell", [pytest.param(shell, marks=needs(shell)) for shell in STARTS])
def test_completes_at_tab(folder, shell):
    for (line, expected), made in zip(TYPED, typed(folder, shell), strict=True):
        assert [one.rstrip("/") for one in made] == [*line.split()[:-1], expected], line


def typed(folder, shell):
    """Return the words of lines that are typed into a shell, each with a tab at its end.

    The program is a function there that prints what it is given; the script starts the process.
    """
    options, start = STARTS[shell]
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder / "here")
        os.environ.update(environment(), ZDOTDIR=str(folder))
        os.execlp(shell, shell, *options, "-i")  # noqa: S606 - it needs a terminal of its own
    try:
        type_in(terminal, f"PS1=; stty -echo; {start}{PRINT}; source ../{shell}.script; "
                          "echo READ''Y\n")  # fmt: skip
        read_until(terminal, rb"READY")
        made = []
        for line, _ in TYPED:
            type_in(terminal, f"mapdeal {line}\t\n")
            found = read_until(terminal, rb"GOT<(.*?)>")
            made.append(found[1].decode().split("|") if found else [])
        type_in(terminal, "exit\n")
        return made
    finally:
        os.close(terminal)
        os.waitpid(child, 0)


def type_in(terminal, text):
    os.write(terminal, text.encode())


def read_until(terminal, pattern, seconds=60):
    """Return the match of what a terminal shows; None if that does not come."""
    shown, end = b"", time.monotonic() + seconds
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            shown += os.read(terminal, 1 << 16)
            found = re.search(pattern, shown)
            if found:
                return found
    return None


def test_powershell_is_answered():
    answer = process(
        _MAPDEAL_COMPLETE="complete_powershell",
        _TYPER_COMPLETE_ARGS="mapdeal inflate --ker",
        _TYPER_COMPLETE_WORD_TO_COMPLETE="--ker",
    )
    assert answer.startswith("--kernel:::")


def test_scripts_ask_mapdeal(command):
    for shell in SHELLS:
        code, script, err = command("completion", shell)
        assert (code, err) == (0, "")
        assert "_MAPDEAL_COMPLETE" in script
        assert f"complete_{shell}" in script


def test_help_tells_of_the_command_alone(command):
    assert "--install-completion" not in command("--help")[1]


def test_another_shell_is_refused(command):
    code, _, err = command("completion", "fsh")
    assert (code, err.splitlines()[-1]) == (2, "hint: did you mean fish?")
