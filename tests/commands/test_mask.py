import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

import mapdeal
from mapdeal.ros.ros2_files import read_ros2

ROOT = Path(__file__).parents[2]
OFFICE = ROOT / "examples" / "maps" / "office.yaml"


@pytest.fixture
def folder(tmp_path, command):
    zones = ROOT / "examples/shapes/office_filters.geojson"
    code, out, err = command("mask", OFFICE, "--file", zones, "-o", tmp_path / "f", "--json")
    assert (code, err) == (0, "")
    return tmp_path / "f", json.loads(out)


def test_the_folder_has_masks_parameters_and_a_launch_file(folder):
    path, document = folder
    assert sorted(entry.name for entry in path.iterdir()) == [
        "binary_mask.pgm", "binary_mask.yaml", "filters.launch.py", "filters.yaml",
        "keepout_mask.pgm", "keepout_mask.yaml", "speed_mask.pgm", "speed_mask.yaml",
    ]  # fmt: skip
    keepout, speed, binary = document["masks"]
    assert [document["type"] for document in (keepout, speed, binary)] == [0, 1, 3]
    assert {(limit["limit"]) for limit in speed["limits"]} == {20, 40}
    assert [zone["name"] for zone in speed["zones"]] == ["corridor", "crossing"]


@pytest.mark.parametrize("dialect", ["nav2", "humble"])
def test_map_server_serves_the_values_that_the_filters_need(folder, dialect):
    path, _ = folder
    for kind, values in (("keepout", {-1, 100}), ("speed", {0, 60, 80}), ("binary", {0, 100})):
        grid = mapdeal.read_map(path / f"{kind}_mask.yaml", dialect=dialect)
        assert set(grid.occupancy.ravel().tolist()) == values
        assert grid.frame == mapdeal.read_map(OFFICE).frame


def test_servers_and_filters_agree(folder):
    path, _ = folder
    read = read_ros2([path / "filters.yaml"])
    nodes = {node.name: read.for_node(node.name) for node in read.nodes}
    (managed,) = (node["node_names"].value for node in nodes.values() if "node_names" in node)
    for kind, number in {"keepout": 0, "speed": 1, "binary": 3}.items():
        info = nodes[f"/{kind}_costmap_filter_info_server"]
        kinds = {name: (parameter.kind, parameter.value) for name, parameter in info.items()}
        assert kinds["type"] == ("integer", number)
        assert kinds["base"][0] == kinds["multiplier"][0] == "double"
        assert kinds["mask_topic"][1] == nodes[f"/{kind}_filter_mask_server"]["topic_name"].value
        assert {f"{kind}_filter_mask_server", f"{kind}_costmap_filter_info_server"} < set(managed)
        costmap = nodes["/global_costmap/global_costmap"]
        assert f"{kind}_filter" in costmap["filters"].value
        assert costmap[f"{kind}_filter.filter_info_topic"].value == kinds["filter_info_topic"][1]


def test_lint_finds_nothing_in_the_parameters_with_a_robots_own(folder, command, real_maps):
    path, _ = folder
    nav2 = real_maps / "params/ros-navigation__navigation2/nav2_bringup/params/nav2_params.yaml"
    for own in (ROOT / "examples/robots/nav2_params.yaml", nav2):
        before = command("lint", "--params-file", own)[1].count("\n")
        words = ("lint", "--params-file", own, "--params-file", path / "filters.yaml")
        code, out, _ = command(*words, "--ignore", "params.layer-disabled")
        assert code == 0, out
        assert "filter" not in out
        assert out.count("\n") <= before + 1


def test_the_launch_file_starts_all_nodes_of_the_parameters(folder, monkeypatch):
    path, _ = folder

    def record(*entities, **arguments):
        return SimpleNamespace(entities=entities, **arguments)

    for name, contents in (
        ("launch", {"LaunchDescription": list}), ("launch_ros.actions", {"Node": record}),
        ("launch.actions", {"DeclareLaunchArgument": record}), ("launch_ros", {}),
        ("launch.substitutions", {"LaunchConfiguration": str}),
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**contents))
    description = runpy.run_path(str(path / "filters.launch.py"))["generate_launch_description"]()
    nodes = {entity.name: entity for entity in description if hasattr(entity, "executable")}
    parameters = yaml.safe_load((path / "filters.yaml").read_text())
    assert set(nodes) == {name for name in parameters if not name.endswith("_costmap")}
    for name, node in nodes.items():
        assert node.parameters[0] == str(path / "filters.yaml")
        assert (node.executable == "map_server") == (len(node.parameters) == 3)
        if node.executable == "map_server":
            file = Path(node.parameters[2]["yaml_filename"])
            assert file.name == f"{name.partition('_')[0]}_mask.yaml"
            assert file.exists()


def test_a_zone_in_a_door_is_named(tmp_path, command):
    door = [[[-8.2, -1.0], [-6.8, -1.0], [-6.8, -0.6], [-8.2, -0.6], [-8.2, -1.0]]]
    geometry = {"type": "Polygon", "coordinates": door}
    zone = {"type": "Feature", "properties": {"name": "paint"}, "geometry": geometry}
    (tmp_path / "z.geojson").write_text(json.dumps(zone))
    words = ["mask", OFFICE, "--file", tmp_path / "z.geojson", "-o", tmp_path / "f", "--kind"]
    words += ["keepout", "--robot-radius", "0.22", "--from", "0,0.9", "--to", "room=-7,-3"]
    code, _, err = command(*words)
    assert code == 1
    assert "error: " in err
    assert "paint at -7.525,-0.775 cuts off 12.98 m2" in err
    assert "room is cut off by keepout zones" in err
    code, _, err = command(*words, "--strict", "--force")
    assert code == 1


def test_info_report_and_lint_know_the_filter_and_its_limits(folder, tmp_path, command):
    path, _ = folder
    _, out, _ = command("info", path / "speed_mask.yaml")
    assert "limit 20 %  6.253 m2" in out
    _, out, _ = command("info", path / "keepout_mask.yaml", "--json")
    assert json.loads(out)["filter"]["area_m2"] == pytest.approx(12.9625)
    command("report", path / "speed_mask.yaml", "-o", tmp_path / "r.html")
    assert '<th scope="row">limit 20 %</th><td>6.253 m2</td>' in (tmp_path / "r.html").read_text()
    _, out, _ = command("lint", path / "speed_mask.yaml", "--select", "yaml")
    assert "unknown" not in out
    _, _, err = command("lint", OFFICE, "--from", "0,0.9", "--mask", path / "binary_mask.yaml")
    assert "applies to keepout masks, not to binary" in err


def test_lint_ends_with_4_without_its_mask_and_with_3_without_an_image(tmp_path, command):
    (tmp_path / "m.yaml").write_text("resolution: 0.1\n")
    codes = [command("lint", OFFICE, "--mask", tmp_path / n)[0] for n in ("no.yaml", "m.yaml")]
    assert codes == [4, 3]
