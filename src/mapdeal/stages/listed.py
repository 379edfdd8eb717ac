"""The functions of all stages: a new stage is a line here, which makes it public, too.

The order is that of lists; of the models of one stage the first is the default.
"""

# isort: off
from mapdeal.stages.window import active_region as active_region
from mapdeal.stages.clean import clean as clean
from mapdeal.stages.window import window as window
from mapdeal.stages.window import shift_origin as shift_origin
from mapdeal.stages.resample import turned as _turned  # noqa: F401 - for Python there are `rotate` and `straighten`
from mapdeal.stages.resample import rescale as rescale
from mapdeal.stages.inflate import inflate as inflate
from mapdeal.stages.esdf import esdf as esdf
from mapdeal.stages.potential import potential as potential
from mapdeal.stages.costmap_2d import exponential_cost as exponential_cost
from mapdeal.stages.robot_costmap import threshold_cost as threshold_cost
from mapdeal.stages.robot_costmap import ring_cost as ring_cost
from mapdeal.stages.costmap_2d import layered_cost as layered_cost
from mapdeal.stages.reach import reach as reach
