# The public names: what `import mapdeal` gives, each loaded on first use.
# `mapdeal.__init__` reads this file, so that no name stands in two places.

from mapdeal.editing.draw import draw as draw
from mapdeal.editing.window import blank as blank
from mapdeal.editing.window import reset_region as reset_region
from mapdeal.editing.window import shift_origin as shift_origin
from mapdeal.editing.window import window as window
from mapdeal.errors import FileAccessError as FileAccessError
from mapdeal.errors import FindingError as FindingError
from mapdeal.errors import MalformedInputError as MalformedInputError
from mapdeal.errors import MapdealError as MapdealError
from mapdeal.errors import MapdealWarning as MapdealWarning
from mapdeal.errors import ParameterError as ParameterError
from mapdeal.formats.bit_maps import read_bit_map as read_bit_map
from mapdeal.formats.bit_maps import write_bit_map as write_bit_map
from mapdeal.formats.clouds.reader import read_cloud as read_cloud
from mapdeal.formats.maps import read_map as read_map
from mapdeal.formats.maps import write_map as write_map
from mapdeal.formats.poses import read_poses as read_poses
from mapdeal.formats.shapes import read_shapes as read_shapes
from mapdeal.grid.bit_map import BitMap as BitMap
from mapdeal.grid.costmap import Costmap as Costmap
from mapdeal.grid.field import DistanceField as DistanceField
from mapdeal.grid.field import FieldSamples as FieldSamples
from mapdeal.grid.field_view import FieldView as FieldView
from mapdeal.grid.field_view import ViewScale as ViewScale
from mapdeal.grid.footprint import Footprint as Footprint
from mapdeal.grid.frame import Frame as Frame
from mapdeal.grid.frame import xy_ahead as xy_ahead
from mapdeal.grid.occupancy import OccupancyGrid as OccupancyGrid
from mapdeal.grid.potential import PotentialField as PotentialField
from mapdeal.grid.route import Route as Route
from mapdeal.grid.shapes import Circle as Circle
from mapdeal.grid.shapes import Line as Line
from mapdeal.grid.shapes import Polygon as Polygon
from mapdeal.mapping.beams import BeamLimits as BeamLimits
from mapdeal.mapping.beams import Scans as Scans
from mapdeal.mapping.build import BuiltMap as BuiltMap
from mapdeal.mapping.build import MapBuilder as MapBuilder
from mapdeal.mapping.build import build_map as build_map
from mapdeal.mapping.local_map import LocalMap as LocalMap
from mapdeal.mapping.local_map import LocalMapper as LocalMapper
from mapdeal.mapping.local_map import local_map as local_map
from mapdeal.mapping.local_options import LocalOptions as LocalOptions
from mapdeal.mapping.rolling_map import RollingMapper as RollingMapper
from mapdeal.planning.astar import shortest_route as shortest_route
from mapdeal.planning.descent import descend as descend
from mapdeal.stages.esdf import field_view as field_view
from mapdeal.stages.keepout import apply_keepout_mask as apply_keepout_mask
from mapdeal.stages.listed import *  # noqa: F403 - every stage is public
from mapdeal.version import __version__ as __version__

__all__: list[str]
