import ast
import base64
import contextlib
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mapdeal

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
NOTEBOOK = ROOT / "examples" / "notebooks" / "office.ipynb"
SHOWN = {"map", "field", "recipe", "route", "diff"}
"""Cells that end in a picture."""

CELLS = {cell["id"]: cell for cell in json.loads(NOTEBOOK.read_text())["cells"]}
CODE = {name: "".join(cell["source"]) for name, cell in CELLS.items() if "outputs" in cell}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    examples = tmp_path_factory.mktemp("notebook") / "examples"
    shutil.copytree(ROOT / "examples", examples)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(examples / "notebooks")
        yield examples / "notebooks"


def _executed(code, names):
    tree = ast.parse(code)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)  # noqa: S102
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307


def _untitled(png):
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB"))[60:]


@pytest.fixture(scope="module")
def shown(folder):
    """What each cell shows, as a notebook would ask for it: a picture, a line, printed text."""
    names, found = {}, {}
    for name, code in CODE.items():
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            value = _executed(code, names)
        draw = getattr(value, "_repr_png_", None)
        found[name] = (draw() if draw else None, repr(value), printed.getvalue())
    return found


def test_no_outputs_are_stored():
    assert all(cell.get("outputs", []) == [] for cell in CELLS.values())
    assert all(cell.get("execution_count") is None for cell in CELLS.values())


def test_each_cell_shows_the_expected_output(shown):
    assert {name for name, (png, _, _) in shown.items() if png} == SHOWN
    assert all("\n" not in line for _, line, _ in shown.values())
    assert shown["map"][1].startswith("OccupancyGrid(544 x 544 cells, 0.05 m, ")
    assert shown["lint"][1].startswith("LintReport(3 maps: ")
    assert "map.mostly-unknown" in shown["lint"][2]
    assert shown["diff"][1].startswith("DiffReport(different, ")
    assert "'cost.npz'" in shown["run"][1]
    assert shown["query"][1].startswith("FieldSamples(2 points, 2 inside, distance ")


def test_its_pictures_and_files_are_those_of_the_commands(shown, folder, command):
    office = folder.parent / "maps" / "office.yaml"
    shape = ["--footprint", "[[0.3,0.2],[0.3,-0.2],[-0.3,-0.2],[-0.3,0.2]]"]
    change = ["--set", "cost.inflation_radius=0.8"]
    out = folder / "by_command"
    for words in (
        ["convert", office, "-o", out / "map.npz", "--image", out / "map.png"],
        ["esdf", office, "-o", out / "field.npz", "--image", out / "field.png"],
        ["run", office, "-o", out / "shape", "--recipe", "nav2", *shape, *change],
        ["run", office, "-o", out, "--recipe", "nav2", *change],
        ["route", out / "shape/office/cost.npz", "--from", "-7.5,2.5", "--to", "9,5",
         "--image", out / "cost.png"],
    ):  # fmt: skip
        assert command(*words)[0] == 0
    # what a run draws of a robot's costs has the robot in a corner
    costs = mapdeal.read_map(out / "shape/office/cost.npz")
    mapdeal.write_picture(out / "shape.png", costs, title="t", image_max=1200)
    # titles are others: that of the route names cost.npz
    titled = {"map": "map.png", "field": "field.png", "recipe": "shape.png", "route": "cost.png"}
    for name, picture in titled.items():
        assert np.array_equal(_untitled(shown[name][0]), _untitled((out / picture).read_bytes()))
    assert (folder / "out" / "route.png").read_bytes() == shown["route"][0]
    for file in (folder / "out" / "office").iterdir():
        assert file.read_bytes() == (out / "office" / file.name).read_bytes()


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_jupyter_runs_it_and_keeps_its_pictures(shown, folder):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    shutil.rmtree(folder / "out")
    book = nbformat.read(folder / NOTEBOOK.name, as_version=4)
    where = {"metadata": {"path": str(folder)}}
    nbclient.NotebookClient(book, timeout=300, kernel_name="python3", resources=where).execute()
    for cell in book.cells:
        if cell.cell_type != "code":
            continue
        png, line, printed = shown[cell.id]
        kinds = {output.output_type: output for output in cell.outputs}
        assert set(kinds) <= {"stream", "execute_result"}, cell.outputs
        assert kinds.get("stream", {}).get("text", "") == printed
        result = kinds.get("execute_result", {}).get("data", {})
        assert ("image/png" in result) == (cell.id in SHOWN)
        if png:
            assert base64.b64decode(result["image/png"]) == png
            assert result["text/plain"] == line
