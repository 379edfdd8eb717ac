import inspect
from pathlib import Path
from typing import get_args

import pytest
import typer

from drawn import grid_from_text
from mapdeal import Footprint, RobotParameters, write_map
from mapdeal.cli import terminal
from mapdeal.cli.main import app, command_names
from mapdeal.cli.options import SHARED_OPTIONS, with_shared_options
from mapdeal.command import split_optional
from mapdeal.errors import ParameterError
from mapdeal.pipeline.settings import Settings


@pytest.fixture
def room(tmp_path):
    write_map(tmp_path / "room.yaml", grid_from_text("...#\n..?.\n....", 0.1, (1.5, -2.0, 0.4)))
    return tmp_path / "room.yaml"


def _run(function, *words):
    """Call a command as typer does, with what the words say."""
    single = typer.Typer(rich_markup_mode=None, add_completion=False)
    single.command()(function)
    command = typer.main.get_command(single)
    return command.main(args=list(words), prog_name="test", standalone_mode=False)


def shared_options(*names, **more):
    """Decorate a command with its own options and shared ones, less what these become."""

    def decorate(function):
        own = inspect.signature(function, eval_str=True).parameters.values()
        own = [one for one in own if one.name not in ("settings", "footprint", "robot")]
        return with_shared_options(function, own, names, **more)

    return decorate


def _commands(group, path=()):
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from _commands(command, (*path, name))
        else:
            yield (*path, name), command


ALL_COMMANDS = dict(_commands(typer.main.get_command(app)))


def test_options_become_settings():
    seen = []

    @shared_options("files", "image_max", "no_images")
    def draw(source: Path, *, settings: Settings) -> None:
        seen.append((source, settings))

    _run(draw, "a.yaml", "--image", "a.png", "--dialect", "ros1", "--max-cells", "9", "--force",
         "--threads", "2", "--max-memory", "3K", "--image-max", "7", "--no-images")  # fmt: skip
    expected = Settings(
        "ros1", 9, True, 2, 3072, Path("a.png"), False, 7, progress=terminal.blocks_done
    )
    assert seen == [(Path("a.yaml"), expected)]


def test_robot_options_become_a_footprint():
    seen = []

    @shared_options("robot")
    def draw(
        *, settings: Settings, footprint: Footprint | None, robot: RobotParameters | None
    ) -> None:
        assert robot is None
        seen.append(footprint)

    _run(draw)
    _run(draw, "--robot-radius", "0.2", "--footprint-padding", "0.1")
    _run(draw, "--robot-radius", "0.2", "--robot-16-gon")
    _run(draw, "--footprint", "[[1,1],[-1,1],[-1,-1],[1,-1]]")
    assert seen == [
        None,
        Footprint.circle(0.2).padded(0.1),
        Footprint.sixteen_gon(0.2),
        Footprint.parse("[[1,1],[-1,1],[-1,-1],[1,-1]]"),
    ]
    with pytest.raises(ParameterError, match="needs --robot-radius"):
        _run(draw, "--robot-16-gon")


@pytest.mark.parametrize(
    ("names", "texts", "message"),
    [
        (["threds"], None, "draw: no option or group 'threds'"),
        (["files", "force"], None, "draw: option 'force' comes twice"),
        (["force", "force"], None, "draw: option 'force' comes twice"),
        (["quiet"], None, "draw: option 'quiet' comes twice"),
        (["own", "own"], None, "draw: option 'own' comes twice"),
        (["image_max"], None, "draw: option 'image_max' comes twice"),
        (["force"], {"threads": "Some."}, "draw: no shared option 'threads'"),
    ],
)
def test_names_that_make_no_sense_fail_where_the_command_is_defined(names, texts, message):
    def draw(own: int = 1, image_max: int = 3, *, settings: Settings) -> None: ...

    with pytest.raises(ValueError, match=message):
        shared_options(*names, help_texts=texts)(draw)


@pytest.mark.parametrize("path", ALL_COMMANDS, ids=" ".join)
def test_every_command_ends_with_strict_quiet_and_verbose(path):
    parameters = [parameter.name for parameter in ALL_COMMANDS[path].params]
    assert [one for one in parameters if one != "help"][-3:] == ["strict", "quiet", "verbose"]
    assert path[0] in command_names()


@pytest.mark.parametrize("path", ALL_COMMANDS, ids=" ".join)
def test_a_shared_option_is_the_same_in_all_commands(path):
    for parameter in ALL_COMMANDS[path].params:
        if parameter.name in SHARED_OPTIONS:
            shared = SHARED_OPTIONS[parameter.name]
            assert parameter.opts[0] == f"--{parameter.name.replace('_', '-')}"
            assert parameter.default == shared.default
            choices = "|".join(map(str, get_args(split_optional(shared.kind)[0])))
            assert parameter.metavar in (shared.metavar, choices)


FLAGS = [
    (path, name)
    for path, command in ALL_COMMANDS.items()
    for parameter in command.params
    for name in parameter.opts
    if parameter.secondary_opts
]


@pytest.mark.parametrize(("path", "name"), FLAGS, ids=lambda part: str(part))
def test_every_flag_with_two_names_takes_yes_and_no(command, path, name):
    code, _, err = command(*path, f"{name}=perhaps")
    assert (code, err) == (2, f"error: {name}: must be yes or no, got 'perhaps'\n")
    for words in ([name, "no"], [f"{name}=Off"], [name], [name, "TRUE"], [f"--no-{name[2:]}"]):
        code, _, err = command(*path, *words)
        # lint needs a map, or parameter files
        assert (code, "missing" in err or "needs" in err) == (2, True), err


def test_trinary_costmap_no_keeps_graded_costs(command, sh, room, tmp_path):
    made = []
    for index, words in enumerate((["--trinary-costmap", "no"], ["--no-trinary-costmap"], [])):
        output = tmp_path / f"{index}.npz"
        graded = tmp_path / "graded.yaml"
        sh(f"edit circle {room} -o {graded} --point 1.6,-1.8 --radius 0.1 --value 40 --force")
        code, _, err = command("convert", graded, "-o", output, "--encoding", "costmap2d",
                               "--static-layer", *words)  # fmt: skip
        assert (code, err) == (0, "")
        made.append(output.read_bytes())
    assert made[0] == made[1] != made[2]


def test_a_flag_with_one_name_takes_no_word(command, room):
    code, _, err = command("info", "--json", "no", room)
    assert code == 4
    assert "no: " in err


def test_words_behind_two_dashes_are_no_options(command, room, tmp_path):
    code, _, err = command("inflate", "-o", tmp_path / "a.npz", "--", room, "--inflate-unknown=no")
    assert code == 2
    assert "(--inflate-unknown=no)" in err
