"""``diff MAP --params-file A --against B``: what a change of parameters means for the robot."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, strategies as st

import mapdeal
from mapdeal import OccupancyGrid, compare_costmaps, write_map
from mapdeal.grid.reach import Goal
from pipeline.reported import entries_of, layer_names
from strategies import examples

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")  # of the yaw
RESOLUTION = 0.1
ORIGIN = (1.5, -2.0, 0.4)
PARAMETERS = """
global_costmap: {{global_costmap: {{ros__parameters: {{
  robot_radius: {radius}, footprint_padding: 0.0, track_unknown_space: true,
  plugins: [static_layer, inflation_layer],
  static_layer: {{plugin: "nav2_costmap_2d::StaticLayer"}},
  inflation_layer: {{plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: {inflation},
    cost_scaling_factor: 3.0}}}}}}}}
"""


def rooms(doors):
    """Return a corridor with a room behind each door, of so many free cells."""
    height, width = 47, 2 + 31 * len(doors)
    cells = np.full((height, width), 100, np.int8)
    cells[1:23, 1:-1] = 0  # the corridor
    for index, door in enumerate(doors):
        first = 1 + 31 * index
        cells[24:46, first : first + 30] = 0
        middle = first + 15 - door // 2
        cells[23, middle : middle + door] = 0
    return OccupancyGrid(cells, RESOLUTION, ORIGIN)


def place(grid, row, col):
    return tuple(grid.frame.xy_from_rowcol([(row, col)])[0].round(6).tolist())


def robot_file(name, radius, inflation=0.9):
    Path(name).write_text(PARAMETERS.format(radius=radius, inflation=inflation))
    return name


def robot(name, radius, inflation=0.9):
    return mapdeal.read_robot_parameters(robot_file(name, radius, inflation))


@pytest.fixture
def site(here):
    """Two rooms behind doors of 8 and 14 free cells, and parameters of a slim and a wide robot."""
    grid = rooms((8, 14))
    write_map("site.yaml", grid)
    robot_file("slim.yaml", 0.3)
    robot_file("wide.yaml", 0.5)
    points = [place(grid, row, col) for row, col in ((12, 12), (35, 16), (35, 47))]
    start, left, right = (f"{x},{y}" for x, y in points)
    return ["--from", start, "--to", f"left={left}", f"right={right}"]


def words(first, second, *more):
    return ["diff", "site.yaml", "--params-file", first, "--against", second, *more]


def test_a_door_that_closes_is_a_finding(command, site):
    code, out, _ = command(*words("slim.yaml", "wide.yaml", *site, "--json"))
    document = json.loads(out)
    assert (code, document["passes"]) == (1, False)
    (closed,) = document["passages"]["closed"]
    assert closed["width_m"] == 0.8  # twice from the middle of the door to its nearer post
    door = place(rooms((8, 14)), 23, 15.5)
    assert np.hypot(closed["x"] - door[0], closed["y"] - door[1]) < 2 * RESOLUTION
    assert document["passages"]["opened"] == []
    assert document["goals"] == {"lost": ["left"], "gained": []}
    assert document["parameters"]["robot_radius"] == [0.3, 0.5]
    radii = {"robot_radius", "inscribed_radius", "circumscribed_radius"}
    assert document["parameters"].keys() == {*radii, "inflation_layer.inscribed_radius"}
    before, after = document["reachable_m2"]
    assert before > after > 0
    code, out, _ = command(*words("slim.yaml", "wide.yaml", *site))
    assert code == 1
    assert out.startswith("site.yaml, slim -> wide: 1 passage closes, 1 goal is lost\n")
    assert "  parameter robot_radius 0.3 -> 0.5\n" in out
    assert "  closes    passage at " in out
    assert "  lost      goal left: its " not in out
    assert "  lost      goal left: a passage at" in out


def test_the_picture_does_not_replace_the_goals(command, site):
    Path("goals.png").write_text("2,1\n")
    more = ("--points", "goals.png", "--image", "goals.png")
    code, _, error = command(*words("slim.yaml", "wide.yaml", *more))
    assert (code, error) == (4, "error: goals.png: the output is the input\n")


def test_a_door_that_opens_is_none(command, site):
    code, out, _ = command(*words("wide.yaml", "slim.yaml", *site, "--json"))
    document = json.loads(out)
    assert (code, document["passes"]) == (0, True)
    assert [len(document["passages"][key]) for key in ("closed", "opened")] == [0, 1]
    assert document["goals"] == {"lost": [], "gained": ["left"]}
    _, out, _ = command(*words("wide.yaml", "slim.yaml", *site))
    assert "1 passage opens, 1 goal is gained" in out


def test_costs_alone_may_differ(command, site):
    robot_file("far.yaml", 0.3, 1.5)
    code, out, _ = command(*words("slim.yaml", "far.yaml", *site, "--json"))
    document = json.loads(out)
    assert (code, document["passes"]) == (0, True)
    assert document["costs"]["changes"]["rose"]["cells"] > 0
    assert document["parameters"] == {"inflation_layer.inflation_radius": [0.9, 1.5]}


def test_numbers_that_read_the_same_do_not_differ(command, site):
    """ROS 1 has parameters as doubles, Nav2 has a padding as float32."""
    own = "robot_radius: 0.3, footprint_padding: 0.01"
    of_node = f"global_costmap: {{global_costmap: {{ros__parameters: {{{own}}}}}}}\n"
    Path("nav2.yaml").write_text(of_node)
    layers = "plugins: [{name: static, type: 'costmap_2d::StaticLayer'}]"
    Path("ros1.yaml").write_text(f"global_costmap: {{{own}, {layers}}}\n")
    _, out, err = command(*words("ros1.yaml", "nav2.yaml", *site, "--json"))
    assert out, err
    names = json.loads(out)["parameters"]
    assert "flavour" in names
    assert names.keys().isdisjoint({"footprint_padding", "robot_radius", "inscribed_radius"})


def test_costs_and_reach_are_those_of_the_other_commands(command, site):
    for name in ("slim", "wide"):
        command("cost", "site.yaml", "--params-file", f"{name}.yaml", "-o", f"{name}.npz")
    first, second = (mapdeal.read_map(f"{name}.npz") for name in ("slim", "wide"))
    _, out, _ = command(*words("slim.yaml", "wide.yaml", *site, "--json"))
    document = json.loads(out)
    a, b = (costmap.cost.astype(int) for costmap in (first, second))
    assert document["costs"]["differing"] == (a != b).sum()
    assert document["costs"]["changes"]["closed"]["cells"] == ((a < 253) & (b >= 253)).sum()
    _, out, _ = command("diff", "slim.npz", "wide.npz", "--json")
    assert json.loads(out)["changes"] == document["costs"]["changes"]
    for name, reached in zip(("slim", "wide"), document["reach"], strict=True):
        _, out, _ = command("reach", "site.yaml", "--params-file", f"{name}.yaml", *site, "--json")
        alone = json.loads(out)
        assert {key: alone[key] for key in reached} == reached
    result = mapdeal.compare_robots(
        "site.yaml", *map(mapdeal.read_robot_parameters, ("slim.yaml", "wide.yaml")),
        start=document["start"],
        goals=[Goal(goal["x"], goal["y"], goal["name"]) for goal in reached["goals"]],
    )  # fmt: skip
    assert result.document() == document
    assert np.array_equal(result.costs.masks["rose"], compare_costmaps(first, second).masks["rose"])


@examples(25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    doors=st.lists(st.integers(3, 16), min_size=1, max_size=3),
    radii=st.tuples(st.sampled_from([0.2, 0.35, 0.5, 0.65]), st.sampled_from([0.25, 0.45, 0.7])),
)  # fmt: skip
def test_a_passage_closes_if_it_is_between_as_wide_as_both_robots(tmp_path, doors, radii):
    grid = rooms(doors)
    robots = [robot(tmp_path / f"{k}.yaml", radius) for k, radius in enumerate(radii)]
    goals = [Goal(*place(grid, 35, 16 + 31 * index), str(index)) for index in range(len(doors))]
    result = mapdeal.compare_robots(grid, *robots, start=place(grid, 12, 12), goals=goals)
    widths = [2 * ((door + 1) // 2) * RESOLUTION for door in doors]
    first, second = (
        {str(k) for k, width in enumerate(widths) if 2 * shape.inscribed_radius < width - 1e-6}
        for shape in robots
    )
    closed, opened = sorted(first - second), sorted(second - first)
    found = sorted(passage.width for passage in result.closed)
    assert found == pytest.approx(sorted(widths[int(k)] for k in closed))
    assert len(result.opened) == len(opened)
    assert [goal.goal.name for goal in result.lost] == closed
    assert [goal.goal.name for goal in result.gained] == opened
    assert result.passes is (not closed)


@pytest.mark.parametrize("second", [10, 12, 16])
@pytest.mark.parametrize("shape", ["[[.4,.4],[.4,-.4],[-.4,-.4],[-.4,.4]]", None])
def test_a_passage_behind_one_that_closes_does_not_close(tmp_path, second, shape):
    cells = np.full((32, 94), 100, np.int8)
    for room in range(3):
        cells[1:31, 1 + 31 * room : 31 + 31 * room] = 0
    cells[12:20, 31] = cells[16 - second // 2 : 16 + second // 2, 62] = 0
    robots = [robot(tmp_path / f"{radius}.yaml", radius) for radius in (0.2, 0.42)]
    if shape:
        path = tmp_path / "0.42.yaml"
        path.write_text(path.read_text().replace("robot_radius: 0.42", f'footprint: "{shape}"'))
        robots[1] = mapdeal.read_robot_parameters(path)
    grid = OccupancyGrid(cells, RESOLUTION, ORIGIN)
    result = mapdeal.compare_robots(grid, *robots, start=place(grid, 15, 15))
    assert [passage.width for passage in result.closed] == [0.8]


def test_a_mask_closes_a_door_to_the_robot_that_inflates_it(command, site):
    mask = np.full((47, 64), -1, np.int8)
    mask[23, 38:52] = mask[23, 7:12] = 100
    write_map("mask.yaml", OccupancyGrid(mask, RESOLUTION, ORIGIN))
    for name in ("slim", "wide"):
        text = Path(f"{name}.yaml").read_text()
        filters = 'filters: [keepout], keepout: {plugin: "nav2_costmap_2d::KeepoutFilter", enabled'
        for is_on, on in (("true", name), ("false", f"{name}-off")):
            filtered = text.replace("robot_radius", f"{filters}: {is_on}}}, robot_radius")
            Path(f"{on}.yaml").write_text(filtered)
    line = words("slim-off.yaml", "slim.yaml", "--mask", "mask.yaml", *site)
    code, out, err = command(*line, "--json")
    assert (code, json.loads(out)["goals"]["lost"]) == (1, ["right"])
    assert "the keepout mask has no effect: keepout is switched off" in err
    assert json.loads(out)["mask"]["file"] == "mask.yaml"
    Path("diff.json").write_text(out)
    (entry,) = entries_of(Path("diff.json"))
    assert [item.tone for item in entry.items if item.kind == "goal"] == ["good", "error"]
    code, out, _ = command(*words("slim.yaml", "slim.yaml", "--mask", "mask.yaml", *site, "--json"))
    assert (code, json.loads(out)["costs"]["differing"]) == (0, 0)


def test_without_a_start_it_is_one_that_suits_both(command, site):
    for pair in (("slim.yaml", "wide.yaml"), ("wide.yaml", "slim.yaml")):
        document = json.loads(command(*words(*pair, "--json"))[1])
        starts = [(reach["start"]["x"], reach["start"]["y"]) for reach in document["reach"]]
        assert starts[0] == starts[1] == tuple(document["start"])


def test_unknown_cells_open_to_the_wider_robot_alone_are_no_start(command, site):
    cells = np.full((60, 200), -1, np.int8)
    cells[5:25, 5:25] = 0  # all that is known; the wider robot has most room far from it
    cells[5:25, 4] = 100
    write_map("site.yaml", OccupancyGrid(cells, RESOLUTION, ORIGIN), force=True)
    through = Path("wide.yaml").read_text().replace("space: true", "space: false")
    Path("through.yaml").write_text(through)
    code, out, err = command(*words("slim.yaml", "through.yaml", "--json"))
    assert code in (0, 1), err
    x, y = json.loads(out)["start"]
    assert mapdeal.read_map("site.yaml").query([x, y]).values.tolist() == [0]


def test_later_files_win_and_points_are_goals(command, site):
    wider = "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.5}}}\n"
    Path("wider.yaml").write_text(wider)
    Path("goals.csv").write_text(f"{site[-2]}\n{site[-1]}\n")
    more = ["--against", "wider.yaml", *site[:2], "--points", "goals.csv", "--json"]
    document = json.loads(command(*words("slim.yaml", "slim.yaml", *more))[1])
    alone = json.loads(command(*words("slim.yaml", "wide.yaml", *site, "--json"))[1])
    assert [file["file"] for file in document["robots"][1]["files"]] == ["slim.yaml", "wider.yaml"]
    same = ("parameters", "costs", "passages", "goals", "reach")
    assert {key: document[key] for key in same} == {key: alone[key] for key in same}


ROBOTS = "--params-file slim.yaml --against wide.yaml"
TWO_FILES = "needs two files, or --params-file and --against"
ONE_MAP = "applies to one map"


@pytest.mark.parametrize(("words", "error"), [
    ("", TWO_FILES), ("--params-file slim.yaml", TWO_FILES), ("--against slim.yaml", TWO_FILES),
    (f"{ROBOTS} --tolerance 1", "--tolerance: applies to two files"),
    (f"{ROBOTS} --align", "--align: applies to two files"),
    ("site.yaml --from 1,2", f"--from: {ONE_MAP}"),
    (f"site.yaml {ROBOTS}", f"--params-file: {ONE_MAP}"),
    ("site.yaml --mask site.yaml", f"--mask: {ONE_MAP}"),
    ("--costmap local --against slim.yaml", "--costmap: needs --params-file"),
])  # fmt: skip
def test_options_that_do_not_belong_are_refused(command, site, words, error):
    code, _, err = command("diff", "site.yaml", *words.split())
    assert (code, err.splitlines()[0]) == (2, f"error: {error}")
    assert ("--params-file A --against B" in err) == (TWO_FILES in error or ONE_MAP in error)


def test_costs_in_place_of_the_map_are_refused(command, site):
    err = command("diff", "slim.yaml", "wide.yaml")[2]
    assert "hint: mapdeal diff MAP --params-file slim.yaml --against wide.yaml\n" in err
    command("cost", "site.yaml", "--params-file", "slim.yaml", "-o", "cost.npz")
    line = ("diff", "cost.npz", "--params-file", "slim.yaml", "--against", "wide.yaml")
    code, _, err = command(*line)
    assert code == 2
    assert err.startswith("error: cost.npz: holds costs; parameters are compared on a map\n")


def page_of(command, site, *pair):
    Path("diff.json").write_text(command(*words(*pair, *site, "--json"))[1])
    (entry,) = entries_of(Path("diff.json"))
    return entry


def test_the_page_shows_both_costmaps_and_what_they_mean(command, site):
    entry = page_of(command, site, "slim.yaml", "wide.yaml")
    assert entry.name == "site: slim → wide"
    assert layer_names(entry) == ["map", "first", "second", "difference"]
    assert (entry.compared, entry.opens_swiped) == (("first", "second"), False)
    claims = {claim.about: claim for claim in entry.claims}
    assert {about: claim.state for about, claim in claims.items()} == {
        "run": "good", "goals": "error", "costmap": "warning",
    }  # fmt: skip
    assert claims["goals"].text.startswith("1 passage closes, 1 goal is lost; reached from ")
    assert "robot_radius" in claims["run"].text
    (passage,) = (item for item in entry.items if item.kind == "passage")
    assert (passage.tone, passage.text[:24]) == ("error", "passage that closes: at ")
    assert [item.tone for item in entry.items if item.kind == "goal"] == ["error", "good"]
    tables = {table.title: dict(table.rows) for table in entry.tables}
    assert tables["Parameters that differ"]["robot_radius"] == "0.3 → 0.5"
    assert tables["Reach"]["lost"].startswith("left: a passage at ")
    entry = page_of(command, site, "wide.yaml", "slim.yaml")
    assert {claim.state for claim in entry.claims if claim.about == "goals"} == {"good"}
    (passage,) = (item for item in entry.items if item.kind == "passage")
    assert (passage.tone, passage.text[:23]) == ("good", "passage that opens: at ")
    assert command("report", "diff.json", "-o", "page.html")[0] == 0
    page_of(command, site, "slim.yaml", "wide.yaml")
    code, _, err = command("report", "diff.json", "-o", "closed.html")
    assert (code, "1 passage closes, 1 goal is lost" in err) == (1, True)


def test_a_page_of_parameters_that_changed_says_so(command, site):
    page_of(command, site, "slim.yaml", "wide.yaml")
    robot_file("wide.yaml", 0.6)
    with pytest.warns(mapdeal.MapdealWarning, match=r"wide\.yaml: is not the file that diff\.json"):
        (entry,) = entries_of(Path("diff.json"))
    assert len(entry.warnings) == 1
    Path("wide.yaml").unlink()
    code, _, err = command("report", "diff.json", "-o", "page.html")
    assert (code, err.startswith("error: wide.yaml: ")) == (4, True)
