"""Every reader of the project, with checks of its results.

Each takes a path and the bytes that are there. `readers` says which files they are given.
"""

import json
import math
import os
import zlib
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal.bags import messages
from mapdeal.bags.reader import open_bag
from mapdeal.checks.findings import CHECKS, read_lint_config, selection_of
from mapdeal.checks.lint import lint_file
from mapdeal.checks.map_checks import RUN_FOLDERS
from mapdeal.commands.report import gathered
from mapdeal.commands.report_documents import read_results
from mapdeal.commands.report_entries import Grids
from mapdeal.compare.merge import chosen_layers, evidence_of
from mapdeal.files.source import size_of
from mapdeal.grid.frame import FARTHEST
from mapdeal.mapping.transforms import FrameOptions
from mapdeal.maps import images
from mapdeal.maps.dialects import DIALECTS, MapMetadata, read_metadata, yaml_of
from mapdeal.maps.kinds import kind_of
from mapdeal.maps.listing import list_maps
from mapdeal.maps.npz import open_npz, read_npz, read_reach
from mapdeal.maps.picture import opened
from mapdeal.maps.reading import open_map
from mapdeal.maps.shapes import read_zones
from mapdeal.pipeline.bag_maps import BagClouds, describe_bag, from_bag
from mapdeal.pipeline.folder import differences_from_golden
from mapdeal.pipeline.inputs import numbers_of
from mapdeal.pipeline.settings import DEFAULT_SETTINGS
from mapdeal.report.page import page_of
from mapdeal.ros.nav2 import nav2_robot
from mapdeal.ros.ros1 import ros1_robot
from mapdeal.ros.ros2_files import read_ros2
from mapdeal.sensors.clouds import cloud_chunks
from mapdeal.sensors.points import has_times, read_trajectory, read_transform
from mapdeal.sensors.scans import ScanTexts, open_log
from mapdeal.stages.catalogue import STAGES
from maps.pictures import joined, read_image
from sensors.test_points import READERS as LINES

MEMORY = 70_000_000
"""Bytes that readers may take, of which they count 50 million as taken by the program."""

_LARGEST_RATIO = 300
"""How many numbers a byte of a file may stand for: what LZF, the densest, can do."""


def kind_of_file(path, data):
    kind = kind_of(path)
    if kind is None:
        return None
    assert kind.name
    assert kind.what.isprintable()
    json.dumps(kind.figures(), allow_nan=False)
    return kind.name


def read_picture(path, data):
    picture = read_image(path)
    height, width = picture.shape
    assert 0 < height * width <= MEMORY
    assert images.read_image_size(path) == (height, width)
    bits = {b"P1": 1, b"P4": 1, b"P2": 8, b"P3": 24, b"P5": 8, b"P6": 24}.get(data[:2], 0)
    assert height * width * bits <= 8 * len(data)  # no PNM stands for more than it holds
    assert picture.samples.shape == (height, width, 3)[: 2 + (picture.colour == "rgb")]
    assert picture.samples.dtype in (np.uint8, np.uint16)
    if picture.colour == "palette":
        assert picture.palette is not None
        assert picture.samples.max() < len(picture.palette)
    else:
        assert picture.samples.max() <= picture.maxval
    if picture.alpha is not None:
        assert picture.alpha.shape == (height, width)
        assert picture.alpha.max() <= picture.maxval
    chance = zlib.crc32(data)
    dialect = "humble" if chance % 32 == 0 else "ros1" if chance % 2 else "nav2"  # humble is slow
    mode = ("trinary", "scale", "raw")[chance % 3]
    occupancy = DIALECTS[dialect](picture, MapMetadata("m", 0.5, (0.0, 0.0, 0.0), mode=mode))
    _check_occupancy(occupancy, picture.shape)
    return picture


def _check_occupancy(occupancy, shape):
    assert occupancy.dtype == np.int8
    assert occupancy.shape == shape
    assert occupancy.min() >= -1
    assert occupancy.max() <= 100


@contextmanager
def _refused_alike(read, path):
    """Check that a second reader refuses a file, too, with the same type of error."""
    try:
        yield
    except mapdeal.MapdealError as error:
        with pytest.raises(type(error)):
            read(path)
        raise


def read_by_rows(path, data):
    """Read an image at once and by rows: both give the same pixels, or neither any."""
    with images.open_image(path) as image:
        part = image.rows() if isinstance(image, images.PnmImage) else None
        if part is None:
            return read_image(path)
        height, width = image.shape
        if height * width > MEMORY:
            return None
        with _refused_alike(read_image, path):
            strips = list(part(slice(0, height)).pictures())
        rows = [joined(part(slice(k, min(k + 4, height)))) for k in range(0, height, 4)]
    image = read_image(path)
    for parts in (strips, rows[::-1]):
        assert np.array_equal(np.concatenate([part.samples for part in parts]), image.samples)
    return image


def map_reader(dialect):
    def read(path, data):
        with open_map(path, dialect=dialect) as file:
            grid = file.read().grid
            assert file.shape() == grid.shape
            if file.shape_by_rows is not None:
                rows = file.by_rows(block_height=4).grid.occupancy
                assert np.array_equal(np.vstack([rows[:4], rows[4:]]), grid.occupancy)
        _check_grid(grid)
        metadata = file.metadata
        path.with_name("again.yaml").write_bytes(yaml_of(metadata))
        assert read_metadata(path.with_name("again.yaml")) == metadata
        return grid

    return read


def _check_grid(grid):
    assert len(grid.shape) == 2
    assert grid.shape[0] * grid.shape[1] > 0
    assert 1e-6 <= grid.resolution <= 1e6
    assert all(abs(value) <= FARTHEST for value in grid.origin)
    if isinstance(grid, mapdeal.BitMap):
        return
    if isinstance(grid, mapdeal.Costmap):
        if grid.scale == "occupancy":
            _check_occupancy(grid.cost, grid.shape)
        assert grid.cost.dtype == (np.uint8 if grid.scale == "costmap2d" else np.int8)
        return
    _check_occupancy(grid.occupancy, grid.shape)
    if isinstance(grid, mapdeal.DistanceField):
        assert not np.isnan(grid.distance).any()
        assert grid.distance.shape == grid.shape
    elif isinstance(grid, mapdeal.PotentialField):
        assert np.isfinite(grid.repulsive).all()
        assert grid.repulsive.shape == grid.shape
        assert grid.repulsive.min() >= 0
    else:
        assert isinstance(grid, mapdeal.OccupancyGrid)


def read_grid(path, data):
    grid = mapdeal.read_map(path)
    _check_grid(grid)
    with open_map(path) as file:
        assert file.frame() == grid.frame
    assert grid.shape[0] * grid.shape[1] <= len(data) * _LARGEST_RATIO
    grid.figures()
    return grid


def read_state(path, data):
    with open_map(path, max_cells=1_000_000) as file:
        grid = file.read().grid
        _check_grid(grid)
        assert file.frame() == grid.frame
        file.described()
        for trajectory in file.trajectories().values():
            assert len(list(trajectory.tum_lines())) == len(trajectory.poses)


def read_npz_by_rows(path, data):
    """Read a grid at once and by rows: both give the same values, or neither any."""
    with _refused_alike(read_npz, path), open_npz(path, block_height=4) as grid:
        rows = [slice(k, k + 4) for k in range(0, grid.shape[0], 4)]
        by_rows = {name: [getattr(grid, name)[some] for some in rows] for name in grid.layer_names}
    in_memory = read_npz(path)
    assert type(grid) is type(in_memory)
    assert grid.frame == in_memory.frame
    for name, parts in by_rows.items():
        assert np.array_equal(np.concatenate(parts), getattr(in_memory, name))


def read_reached(path, data):
    map_ = mapdeal.read_map(path)
    _check_grid(map_)
    reached = read_reach(path)
    with open_map(path) as file:
        assert file.frame() == map_.frame == reached.frame
    assert np.array_equal(reached.grid.occupancy, map_.occupancy)
    assert len(reached.start) in (2, 3)
    assert all(map(math.isfinite, reached.start))
    reached.figures()


def read_evidence_layers(path, data):
    with open_map(path) as file:
        grid, found = file.read().grid, file.evidence()
    _check_grid(grid)
    try:
        layers = chosen_layers(found, grid.shape)
    except mapdeal.ParameterError as error:
        raise error.in_file(path) from None
    frame = grid.frame
    total = evidence_of(frame, [np.zeros(grid.shape, np.uint8)], [frame], [layers])
    assert total.shape == grid.shape


def read_bag(path, data):
    """Read everything that commands read of a bag: topics, maps, a map of scans, clouds."""
    if path.suffix == ".yaml":
        path = path.parent
    report = describe_bag(path)
    assert json.dumps(report)
    grids = []
    for topic in report["topics"]:
        if "convert" in topic["commands"]:
            grids.append(mapdeal.read_map_from_bag(path, topic["topic"], index=0))
            _check_grid(grids[-1])
    kinds = (messages.LASER_SCAN, messages.POINT_CLOUD)
    with open_bag(path) as bag:
        has_scans, has_clouds = (bool(bag.of_types(kind)) for kind in kinds)
    if has_scans:
        area = {"size": (8, 8), "origin": (-4, -4), "resolution": 0.5}
        assert mapdeal.build_map_from_log(path, **area, deskew=True).grid.shape == (16, 16)
    for has_poses in (False, True) if has_clouds else ():
        with from_bag(path, BagClouds, ["/points"], FrameOptions(), has_poses=has_poses) as clouds:
            clouds.prepare()
            if not has_poses:
                clouds.poses(range(len(clouds)))
            for k in range(len(clouds)):
                for points in clouds.cloud(k).chunks():
                    assert points.shape[1] in (2, 3)


def decode_bits(path, data):
    with opened(path) as file:
        image = images.PnmImage(file)
        packed, width = image.bits(), image.width
        image = read_image(path)
    assert packed.dtype == np.uint8
    assert packed.shape[1] == (width + 7) // 8
    assert 0 < packed.size <= len(data)
    assert (image.samples == 0).sum() == np.unpackbits(packed, axis=1, count=width).sum()


def read_bits(path, data):
    bits = mapdeal.read_bit_map(path.with_suffix(".pbm"))
    _check_grid(bits)
    assert bits.shape[0] * bits.shape[1] <= 8 * path.with_suffix(".pbm").stat().st_size


def lint(path, data):
    findings = lint_file(path)
    assert all(finding.message.isprintable() for finding in findings), findings
    (report,) = mapdeal.lint(path, config=False).maps
    assert {finding.check for finding in report.findings} <= {found.check for found in findings}
    listed = [finding for finding in findings if not CHECKS[finding.check].on_request]
    assert report.suppressed + len(report.findings) >= len(listed)
    repaired = mapdeal.lint(path, config=False, fix=True, in_place=True)
    assert all(
        isinstance(problem, (mapdeal.MalformedInputError, mapdeal.FileAccessError))
        for problem in repaired.problems
    )
    assert len(repaired.findings) <= len(report.findings) or repaired.maps[0].repairs


def read_ros1_robot(path, data):
    return _resolve(ros1_robot, path, data)


def read_nav2_robot(path, data):
    return mapdeal.read_robot_parameters(path, costmap=_resolve(nav2_robot, path, data))


def last_line_of(data):
    return data.count(b"\n") + data.count(b"\r") + 3


def lint_parameter_files(path, data):
    (report,) = mapdeal.lint(params_file=path, config=False).maps
    assert report.file == str(path)
    for finding in report.findings:
        assert finding.check != "lint.not-checked"
        assert 1 <= (finding.line or 1) <= last_line_of(data)
        assert "\n" not in finding.message


def _resolve(resolve, path, data):
    refusals, resolved = [], []
    for costmap in ("global", "local"):
        robot, problems = resolve([path], costmap=costmap)
        for problem in problems:
            assert problem.text.isprintable() or "\n" not in problem.text
            assert 1 <= (problem.line or 1) <= last_line_of(data)
        refused = [problem for problem in problems if problem.level == "refused"]
        assert robot is not None or refused
        if refused:
            refusals.append(refused[0].text)
            continue
        assert len(robot.footprint.vertices) >= 3
        assert robot.inscribed_radius <= robot.circumscribed_radius * (1 + 1e-9)
        resolved.append(costmap)
    if not resolved:  # a file of Nav2 may have one costmap alone
        raise mapdeal.MalformedInputError(refusals[0], source=path)
    return resolved[0]


def read_ros2_parameters(path, data):
    """Read a file of ROS 2; each value has a place in it, and the type that it is said to have."""
    kinds = {"bool": bool, "integer": int, "double": float, "string": str, "byte_array": bytes}
    for node in read_ros2([path]).nodes:
        assert node.name.startswith("/")
        for _, entry in node.entries:
            assert 1 <= entry.line <= last_line_of(data)
            if entry.kind in kinds:
                assert type(entry.value) is kinds[entry.kind]
            elif entry.kind != "not set":
                kind = kinds[entry.kind.removesuffix("_array")]
                assert {type(item) for item in entry.value} == {kind}


def read_config(path, data):
    named = path.with_name("pyproject.toml" if b"tool" in data else "mapdeal.toml")
    named.write_bytes(data)
    config = read_lint_config(named)
    return None if config is None else selection_of(config=config)


def read_cloud_points(path, data):
    points = mapdeal.read_cloud(path)
    assert points.dtype == np.float64
    assert points.ndim == 2
    assert points.shape[1] in (2, 3)
    assert points.size <= _LARGEST_RATIO * len(data)
    assert sum(len(some) for some in cloud_chunks(path)) == len(points)
    return points


def read_octree_points(path, data):
    """Read an octree, of which a few bytes can name a large cube: memory bounds it."""
    assert np.isfinite(mapdeal.read_cloud(path, max_memory=1 << 26)).all()


def read_text_points(path, data):
    """Read a cloud of text: each line is a point, but for names, comments and empty ones."""
    points = read_cloud_points(path, data)
    lines = [line.strip() for line in data.removeprefix(b"\xef\xbb\xbf").split(b"\n")]
    count = sum(bool(line) and not line.startswith(b"#") for line in lines)
    assert len(points) in (count, count - 1)


def read_log(path, data):
    _check_scans(open_log(path, max_bad=3))


def read_scan_texts(path, data):
    files = [path.with_name(f"{name}.txt") for name in ("poses", "angles", "ranges")]
    _check_scans(ScanTexts(*files, flip_y=len(data) % 2 == 1))


def _check_scans(log):
    total = 0
    for scans in log.scans():
        assert scans.poses.shape == (len(scans.ranges), 3)
        assert scans.angles.ndim == 1
        assert scans.ranges.shape == (len(scans.poses), len(scans.angles))
        assert np.isfinite(scans.poses).all()
        assert np.isfinite(scans.angles).all()
        total += len(scans.ranges)
    log.warn()
    assert total <= log.count


def read_all_poses(path, data):
    poses = mapdeal.read_poses(path)
    assert poses.shape == (len(poses), 3)
    assert 0 < len(poses) <= len(data)
    assert (np.abs(poses[:, :2]) <= FARTHEST).all()
    assert (np.abs(poses[:, 2]) <= 2 * math.pi).all()
    try:
        trajectory = read_trajectory(path)
    except mapdeal.MalformedInputError:
        return
    assert has_times(path)
    np.testing.assert_array_equal(trajectory.translations[:, :2], poses[:, :2])


def lines_of(kind):
    """Return what reads lines in one piece, one by one, and cut anywhere: all agree."""
    read = LINES[kind]

    def read_lines(path, data):
        expected, third = list(read([data])), len(data) // 3
        thirds = [data[:third], data[third : 2 * third], data[2 * third :]]
        for parts in (data.splitlines(keepends=True), thirds):
            assert repr(list(read(parts))) == repr(expected)
        assert [line for line, *_ in expected] == sorted({line for line, *_ in expected})
        for _, row, error in expected:
            numbers = [value for value in row or [math.nan] if isinstance(value, (int, float))]
            assert np.isfinite(numbers).all() == (error is None)

    return read_lines


def read_one_transform(path, data):
    found = read_transform(path)
    assert all(abs(value) <= FARTHEST for value in found.transform.pose)
    assert all(len(value) == 64 for value in [*found.first.values(), *found.second.values()])


def read_one_answer(path, data):
    results = read_results(path)
    items = [*results.items, *(item for part in results.parts for item in part.items)]
    tables = [*results.tables, *(table for part in results.parts for table in part.tables)]
    if results.kind != "shapes":
        places = [item.place for item in items if item.place is not None]
        places += [place for item in items for line in item.lines for place in line.tolist()]
        assert all(abs(value) <= FARTHEST for place in places for value in place)
    texts = [item.text + item.label for item in items]
    texts += [text for table in tables for row in table.rows for text in row]
    assert all(not text or text.isprintable() for text in texts)


def read_all_zones(path, data):
    zones = read_zones(path, "keepout")
    assert 0 < len(zones) <= len(data)
    for zone in zones:
        assert zone.kind == "keepout"
        assert zone.speed is None
        assert zone.shapes


def read_one_graph(path, data):
    graph = mapdeal.read_route_graph(path)
    assert len(graph.nodes) + len(graph.edges) <= len(data)
    assert np.isfinite(graph.points_xy).all()


def read_all_shapes(path, data):
    shapes = mapdeal.read_shapes(path)
    assert 0 < len(shapes) <= len(data)
    for shape in shapes:
        assert shape.value is None or isinstance(shape.value, int)
        try:
            outside = shape.outside_part(_FRAME)
            cells = sum(int(np.sum(some.stops - some.starts)) for some in shape.spans(_FRAME))
        except mapdeal.ParameterError:  # too far from this map to be drawn
            continue
        assert outside is None or outside.isprintable()
        assert cells >= 0


_FRAME = mapdeal.Frame(5, 7, 0.5, (-1.0, 0.5, 0.3))


def load_one_recipe(path, data):
    recipe = mapdeal.load_recipe(str(path), sim=len(data) % 2 == 0)
    assert len(recipe.steps) > 0
    assert all(step.title.isprintable() for step in recipe.steps)
    assert len(recipe.described()) == len(recipe.steps)


def load_settings(path, data):
    return mapdeal.load_recipe("default", changes=[text_of(data)]).described()


def load_layers(path, data):
    settings = ["cost.model=layers", f"cost.layers={text_of(data)}"]
    recipe = mapdeal.load_recipe("default", changes=settings)
    assert recipe.steps[-1].title.isprintable()
    recipe.described()


def compare_with_golden(path, data):
    lines = differences_from_golden(path.parent, path.parent / "golden", "run")
    assert all(isinstance(line, str) for line in lines)
    lint_file(path.parent)


def show_runs(path, data):
    """Make a page of a run or a batch: its documents give text, and files of its folder alone."""
    with Grids(DEFAULT_SETTINGS) as grids:
        report = gathered([path], grids)
        page = b"".join(page_of(report, size=1 << 20))
        assert all(path.parent in file.parents for file in grids.files)
    page.decode()
    assert b"\0" not in page
    for entry in report.entries:
        assert len({layer.name for layer in entry.layers}) == len(entry.layers)


def list_all_maps(path, data):
    before = Path.cwd()
    os.chdir(path.parent)
    try:
        listing = list_maps(["@" + path.name], Path("out"), list)
        with_runs = list_maps(["@" + path.name], None, list, exempt=RUN_FOLDERS)
        assert {entry.path for entry in listing.maps} <= {entry.path for entry in with_runs.maps}
    finally:
        os.chdir(before)
    assert len(listing.maps) > 0
    assert all(not Path(entry.name).is_absolute() for entry in listing.maps)


def within_folder(data):
    """Return a list of maps whose names do not lead out of their folder."""
    lines = data.replace(b"..", b"._").replace(b"~", b"-").replace(b"\\", b"_").split(b"\n")
    return b"\n".join(line if line.strip()[:1].isalnum() else b"m" + line for line in lines)


def parse_footprint(path, data):
    shape = mapdeal.Footprint.parse(text_of(data))
    assert 3 <= len(shape.vertices) <= len(data)
    assert 0 <= shape.inscribed_radius <= shape.circumscribed_radius < math.inf


def parse_size(path, data):
    assert 0 < size_of(text_of(data), "--max-memory") < 1 << 80


def parse_numbers(path, data):
    assert len(numbers_of(text_of(data), "X,Y")) == 2


def accept_parameters(path, data):
    """Offer a text to every parameter of every stage; refusals must be mapdeal's own."""
    text, accepted = text_of(data), 0
    for stage in STAGES:
        for parameter in stage.own_parameters.values():
            try:
                value = parameter.accept(text)
            except mapdeal.ParameterError as error:
                last = error
                continue
            accepted += 1
            assert not isinstance(value, float) or math.isfinite(value)
    if not accepted:
        raise last


def text_of(data):
    return data.decode("utf-8", errors="surrogateescape").replace("\0", "")
