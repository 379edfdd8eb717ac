"""What is wrong with a recipe's file, and on which line of it."""

import re

import pytest

from mapdeal.errors import ParameterError
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.stages.catalogue import STAGES

# In each text, the line that is at fault ends with this mark; it is a comment to YAML.
MARK = "# here"

WRONG = {
    "unknown key": ("# a recipe\nsteps: # here\n  - esdf\n", "no such key"),
    "no list": ("# a recipe\n\nstages: esdf # here\n", "a list of stages"),
    "unknown stage": ("stages:\n  - esdf\n  - inflat: # here\n", "no such stage"),
    "unknown parameter": (
        "stages:\n  - inflate:\n      kernel: disc\n      radios: 1 # here\n",
        "inflate.radios: no such parameter",
    ),
    "of another model": (
        "stages:\n  - cost:\n      model: rings\n      down: 4 # here\n",
        "cost.down: is a parameter of model",
    ),
    "wrong type": (
        "stages:\n  - esdf:\n      strength: 2\n  - inflate:\n      radius: wide # here\n",
        "inflate.radius: must be a finite number",
    ),
    "out of bounds": (
        "stages:\n  - inflate:\n      radius: -1 # here\n      kernel: disc\n",
        "inflate.radius: must be a finite number, at least 0, got -1",
    ),
    "wrong choice": (
        "stages:\n  - inflate:\n      kernel: round # here\n",
        "inflate.kernel: must be one of",
    ),
    "wrong model": (
        "stages:\n  - esdf\n  - cost:\n      model: ring # here\n",
        "cost.model: no such cost model",
    ),
    "yes or no": (
        "stages:\n  - inflate:\n      inflate_unknown: maybe # here\n",
        "must be yes or no",
    ),
    "in a list": (
        "stages:\n  - cost:\n      model: rings\n      values: [80, -5] # here\n",
        "cost.values: ",
    ),
    "nested": (
        "stages:\n  - inflate:\n      footprint: {radius: -1} # here\n",
        "inflate.footprint.radius: must be",
    ),
    "given together": (
        "stages:\n  - inflate:\n      footprint: {radius: 0.3}\n      radius: 0.4 # here\n",
        "inflate.radius: cannot be given together",
    ),
    "once": ("stages:\n  - esdf\n  - esdf: # here\n", "esdf: a stage can run once"),
    "order": ("stages:\n  - cost\n  - esdf # here\n", "esdf: cannot follow cost"),
    "no mapping": ("stages:\n  - esdf\n  - inflate: 3 # here\n", "must look like"),
    "nothing": ("stages:\n  - esdf\n  - # here\n", "must look like"),
    "syntax": ("stages:\n  - inflate: {radius: 1]} # here\n", "not valid YAML"),
    "tab": ("stages:\n\t- inflate # here\n", "not valid YAML"),
    "tag": ("stages:\n  - inflate:\n      radius: !!python/none 1 # here\n", "tag not allowed"),
    "octal": ("stages:\n  - inflate:\n      radius: 010 # here\n", "must be a decimal number"),
    "minutes": ("stages:\n  - inflate:\n      radius: 1:30 # here\n", "must be a decimal number"),
    "underscore": ("stages:\n  - esdf:\n      strength: 1_0 # here\n", "must be a decimal number"),
    "in a merged mapping": (
        "stages:\n  - inflate: &a\n      radius: 0.3 # here\n  - esdf:\n      <<: *a\n",
        "esdf.radius: no such parameter",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_the_line_that_is_wrong_is_named(tmp_path, name):
    text, rule = WRONG[name]
    (line,) = [k for k, one in enumerate(text.splitlines(), 1) if one.endswith(MARK)]
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_recipe(str(path))
    said = str(caught.value)
    assert said.startswith(f"{path}:{line}: "), said
    assert rule in said


def test_every_parameter_of_every_stage_has_its_line(tmp_path):
    path = tmp_path / "r.yaml"
    for stage in STAGES:
        for name in stage.parameters:
            model = f"      model: {stage.model}\n" if stage.model else ""
            path.write_text(f"stages:\n\n  - {stage.name}:\n{model}      {name}: [[a, b], {{}}]\n")
            with pytest.raises(ParameterError) as caught:
                load_recipe(str(path))
            assert str(caught.value).startswith(f"{path}:{5 if model else 4}: {stage.name}.{name}")


def test_what_an_option_has_set_names_the_option_and_not_the_file(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n  - inflate:\n      radius: 0.3\n      kernel: disc\n")
    with pytest.raises(ParameterError, match=r"^--set: inflate\.radius: must be"):
        load_recipe(str(path), changes=["inflate.radius=-1"])
    with pytest.raises(ParameterError, match=r"^--set: inflate\.radios: no such parameter"):
        load_recipe(str(path), changes=["inflate.radios=1"])


def test_mappings_that_are_merged_give_way_to_what_stands_beside_them(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(
        "stages:\n  - inflate: &a {lethal_threshold: &n 60}\n"
        "  - esdf: &b {lethal_threshold: 70}\n"
        "  - cost:\n      <<: [{lethal_threshold: 80, model: threshold}, *b]\n"
    )
    steps = load_recipe(str(path)).steps
    assert [step.parameters["lethal_threshold"] for step in steps] == [60, 70, 80]
    path.write_text(path.read_text() + "      lethal_threshold: *n\n")
    assert load_recipe(str(path)).steps[2].parameters["lethal_threshold"] == 60
    path.write_text(path.read_text() + "      lethal_threshold: 50\n")
    with pytest.raises(ParameterError, match="appears twice, on lines 6 and 7"):
        load_recipe(str(path))


def test_built_in_recipes_have_no_lines():
    with pytest.raises(ParameterError) as caught:
        load_recipe("nav2", changes=["cost.inscribed_radius=-1"])
    assert str(caught.value).startswith("--set: cost.inscribed_radius: must be")


@pytest.mark.parametrize(
    "text",
    [
        "- inflate: {radius: 0.3}\n- esdf\n",  # the list without its key
        "inflate: {radius: 0.3}\nesdf:\n",
        "",
        "stages:\n",
        "stages: esdf\n",
    ],
)
def test_a_recipe_of_another_shape_is_told_how_one_looks(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_recipe(str(path))
    assert str(caught.value).startswith(f"{path}:")
    example = re.search(r'"(.*)"', caught.value.hint)[1]
    path.write_text(f"stages:\n{example}\n")
    assert [step.name for step in load_recipe(str(path)).steps] == ["inflate"]
