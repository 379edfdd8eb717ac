"""What shells complete, by the shells themselves."""

import os
import pty
import re
import select
import shutil
import subprocess
import time

import pytest

from mapdeal.checks.finding import CHECKS
from mapdeal.cli.main import command_names
from mapdeal.cli.shells import SHELLS
from mapdeal.cli.words import CommandWords, OptionWords, Value, check_words
from mapdeal.pipeline.recipe import BUILT_IN
from mapdeal.stages.catalogue import STAGES

FILES = ["map.yaml", "cloud.pcd", "scan.log", "field.npz", "picture.png", "bits.pbm", "notes.md"]

# Words of a command line, the last of them to be completed, and what it can become.
CASES = [
    (["r"], {"run", "reach", "route", "rotate", "rescale", "report"}),
    (["comp"], {"completion"}),
    (["completion", ""], {"bash", "zsh", "fish"}),
    (["edit", ""], {"polygon", "line", "circle", "reset"}),
    (["edit", "polygon", "--ov"], {"--overlay"}),
    (["edit", "polygon", "--overlay", ""], {"seq", "max", "min"}),
    (["--ver"], {"--version"}),
    (["inflate", "--ker"], {"--kernel"}),
    (["inflate", "--kernel", ""], {"disc", "square"}),
    (["inflate", "map.yaml", "--kernel", "s"], {"square"}),
    (["esdf", "--convention", "c"], {"center"}),
    (["convert", "--encoding", "a"], {"amcl"}),
    (["info", "--dialect", ""], {"nav2", "humble", "ros1"}),
    (["run", "map.yaml", "--recipe", "design-"], {"design-real", "design-sim", "design-local"}),
    (["run", "--set", "inflate.ker"], {"inflate.kernel=disc", "inflate.kernel=square"}),
    (["run", "--set", "esdf.strengt"], {"esdf.strength="}),
    (["run", "--set", "cost.model=t"], {"cost.model=threshold"}),
    (["inflate", "m"], {"map.yaml", "maps"}),
    (["inflate", ""], {"map.yaml", "maps", "field.npz", "bits.pbm"}),
    (["run", "map.yaml", "ma"], {"map.yaml", "maps"}),
    (["local", "--cloud", "c"], {"cloud.pcd"}),
    (["build", "s"], {"scan.log"}),
    (["unpack", "b"], {"bits.pbm"}),
    (["inflate", "--image", "p"], {"picture.png"}),
    (["run", "-o", "m"], {"maps"}),
    (["inflate", "--radius", "m"], set()),
    (["nonsense", "x"], set()),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with files, and the scripts of all shells."""
    path = tmp_path_factory.mktemp("completion")
    here = path / "here"
    (here / "maps").mkdir(parents=True)
    for name in FILES:
        (here / name).touch()
    from mapdeal.cli.completion import script_for

    for shell in SHELLS:
        (path / f"{shell}.script").write_text(script_for(shell) + "\n")
    return path


def needs(shell):
    return pytest.mark.skipif(shutil.which(shell) is None, reason=f"needs {shell}")


def run(shell, script, folder):
    done = subprocess.run(
        [shell, "-c", script], cwd=folder / "here", capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout


def in_bash(folder, lines, script="bash.script"):
    """Return what bash completes, calling its function as bash does."""
    code = f"source ../{script}\n"
    for words in lines:
        # as readline splits words: at = and : too
        split = [part for word in words for part in re.findall(r"[=:]+|[^=:]+", word) or [""]]
        quoted = " ".join(f"'{one}'" for one in ["mapdeal", *split])
        code += f"COMP_WORDS=({quoted}); COMP_CWORD={len(split)}; COMPREPLY=()\n"
        code += 'COMP_WORDBREAKS=" =:"; _mapdeal; printf "%s|" "${COMPREPLY[@]}"; echo\n'
    return [set(line.split("|")) - {""} for line in run("bash", code, folder).splitlines()]


@needs("bash")
def test_bash_completes(folder):
    found = in_bash(folder, [words for words, _ in CASES])
    for (words, expected), made in zip(CASES, found, strict=True):
        before = words[-1].rpartition("=")[0]
        kept = {one.removeprefix(f"{before}=") if before else one for one in expected}
        assert made == kept, words


@needs("bash")
def test_bash_completes_values_behind_an_equals_sign(folder):
    found = in_bash(folder, [["inflate", "--kernel=s"], ["inflate", "--kernel="],
                             ["run", "--set=cost.model=r"]])  # fmt: skip
    assert found == [{"square"}, {"disc", "square"}, {"rings"}]


@needs("bash")
def test_bash_knows_every_option_that_help_tells_of(folder, command):
    names = [name for name in command_names() if name != "edit"]
    names += [f"edit {name}" for name in ("polygon", "line", "circle", "reset")]
    found = in_bash(folder, [[*name.split(), "-"] for name in names])
    for name, made in zip(names, found, strict=True):
        told = command(*name.split(), "--help")[1]
        listed = re.findall(r"(?m)^  (-.*?)(?:  |$)", told)
        expected = set(re.findall(r"(?<![\w-])--?[a-z][a-z0-9-]*", " ".join(listed)))
        assert {one for one in expected if len(one) > 2} <= made, name
        assert made - {"-h"} <= set(re.findall(r"--?[\w-]+", told)), name


@needs("bash")
def test_bash_knows_every_parameter_and_recipe(folder):
    settings, recipes = in_bash(folder, [["run", "--set", ""], ["run", "--recipe", ""]])
    assert {one.partition("=")[0] for one in settings} >= {
        f"{stage.name}.{name}" for stage in STAGES for name in stage.parameters
    }
    assert recipes >= set(BUILT_IN)


@needs("bash")
def test_bash_completes_lists_of_checks(folder):
    select = OptionWords(("--select",), "Checks.", Value(("map.specks", "map.empty", "yaml.mode")))
    root = CommandWords("mapdeal", "", (), None, (CommandWords("lint", "", (select,)),))
    (folder / "lists.script").write_text(SHELLS["bash"](root))
    found = in_bash(folder, [["lint", "--select", "map."], ["lint", "--select", "yaml.mode,map.s"]],
                    "lists.script")  # fmt: skip
    assert found == [{"map.specks", "map.empty"}, {"yaml.mode,map.specks"}]
    assert set(check_words()) == set(CHECKS)


@needs("bash")
def test_bash_starts_nothing(folder):
    code = "PATH=; source ../bash.script; COMP_WORDS=(mapdeal r); COMP_CWORD=1; _mapdeal\n"
    assert (
        run("bash", code + 'echo "${COMPREPLY[@]}"', folder)
        == "run reach route rotate rescale report\n"
    )


@needs("fish")
def test_fish_completes(folder):
    code = "source ../fish.script\n"
    for words, _ in CASES:
        code += f"complete -C 'mapdeal {' '.join(words)}'; echo ----\n"
    blocks = run("fish", code, folder).split("----\n")
    for (words, expected), block in zip(CASES, blocks, strict=False):
        made = {line.partition("\t")[0].rstrip("/") for line in block.splitlines()}
        assert made == expected, words


@needs("zsh")
def test_zsh_completes(folder):
    unique = [(words, *expected) for words, expected in CASES if len(expected) == 1]
    made = in_zsh(folder, [" ".join(words) for words, _ in unique])
    for (words, expected), line in zip(unique, made, strict=True):
        assert line == [*words[:-1], expected], words


def in_zsh(folder, lines):
    """Return the words of lines that are typed into zsh, each with a tab at its end.

    The program is a function there that prints what it is given.
    """
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder / "here")
        os.environ.update(TERM="dumb", ZDOTDIR=str(folder))
        os.execlp("zsh", "zsh", "-f", "-i")  # noqa: S606 - it needs a terminal of its own
    try:
        type_in(terminal, "PS1=; stty -echo; autoload -Uz compinit; compinit -u -D; "
                          'mapdeal() { print -r -- "GOT<${(j:|:)@}>" }; '
                          "source ../zsh.script; print READ''Y\n")  # fmt: skip
        read_until(terminal, rb"READY")
        made = []
        for line in lines:
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


@pytest.mark.parametrize("shell", SHELLS)
def test_the_command_prints_the_script(command, folder, shell):
    assert command("completion", shell) == (0, (folder / f"{shell}.script").read_text(), "")


def test_another_shell_is_refused(command):
    code, _, err = command("completion", "fsh")
    assert (code, err.splitlines()[-1]) == (2, "hint: did you mean fish?")
