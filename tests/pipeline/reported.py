"""What reports gather of paths, and the map that most of them are of."""

import json

import mapdeal
from drawn import grid_from_text
from mapdeal.commands.report import gathered
from mapdeal.commands.report_entries import Grids
from mapdeal.pipeline.settings import DEFAULT_SETTINGS

ROOMS = """
    ??##################
    ??#.......#........#
    ..#.......#........#
    ..#.......#........#
    ..#................#
    ..#................#
    ..#.......#........#
    ..##################
"""


def rooms_grid(walls=0):
    """Return the rooms, with some of the first free cells occupied."""
    return grid_from_text(ROOMS.replace(".", "#", walls))


def write_cells(path, cells, resolution=0.25, origin=(1.5, -2.0, 0.4)):
    mapdeal.write_map(path, mapdeal.OccupancyGrid(cells, resolution, origin), force=True)
    return path


def report_of(*paths):
    with Grids(DEFAULT_SETTINGS) as grids:
        report = gathered(paths, grids)
        for entry in report.entries:
            for layer in entry.layers:  # as long as the files are open
                layer.values[:]
    return report


def entries_of(*paths):
    return report_of(*paths).entries


def layer_names(entry):
    return [layer.name for layer in entry.layers]


def document(path):
    return json.loads(path.read_text())


def changed(path, change):
    parsed = document(path)
    change(parsed)
    path.write_text(json.dumps(parsed))
