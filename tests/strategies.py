import numpy as np
from hypothesis import settings, strategies as st

from mapdeal.layers.denoise import DenoiseLayer
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.obstacle import ObstacleLayer
from mapdeal.layers.static import StaticLayer

RESOLUTIONS = st.sampled_from([0.05, 0.1, 0.025, 0.3, 2.0, 0.0504])


def examples(count, **more):
    """Settings of a property that tries as many examples in CI, and a third of them by default."""
    share = settings.default.max_examples / settings.get_profile("ci").max_examples
    return settings(max_examples=max(2, round(count * share)), **more)


@st.composite
def masks(draw, longest=12):
    """Boolean grids of any density, 1 x 1 up to longest x longest."""
    height, width = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    density = draw(st.sampled_from([0.0, 0.03, 0.2, 0.5, 0.9, 1.0]))
    return np.random.default_rng(draw(st.integers(0, 2**32 - 1))).random((height, width)) < density


@st.composite
def occupancies(draw, longest=12):
    """Occupancy arrays that mix free, occupied, unknown and values in between."""
    height, width = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    shares = [(6, 2, 2, 1), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (9, 1, 0, 0)]
    weights = draw(st.sampled_from(shares))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    share = np.array(weights) / sum(weights)
    return rng.choice([0, 100, -1, 50], size=(height, width), p=share).astype(np.int8)


STATIC_LAYERS = st.builds(
    StaticLayer, name=st.just("static_layer"), track_unknown_space=st.booleans(),
    lethal_cost_threshold=st.sampled_from([0, 1, 50, 65, 100]), trinary_costmap=st.booleans(),
    unknown_cost_value=st.sampled_from([255, 0, 50, 100]),
    inscribed_obstacle_cost_value=st.sampled_from([None, 99, 50, 255]), use_maximum=st.booleans(),
    unknown_is_highest=st.booleans(),
)  # fmt: skip
INFLATION_LAYERS = st.builds(
    InflationLayer, name=st.just("inflation_layer"),
    inscribed_radius=st.sampled_from([0.0, 0.22549849949589046, 0.5]),
    inflation_radius=st.sampled_from([0.0, 0.4, 0.7, 1.4]),
    cost_scaling_factor=st.sampled_from([0.0, 3.0, 10.0]), inflate_unknown=st.booleans(),
    inflate_around_unknown=st.booleans(), lookup=st.sampled_from(["exact", "nav2"]),
)  # fmt: skip
DENOISE_LAYERS = st.builds(
    DenoiseLayer, minimal_group_size=st.sampled_from([1, 2, 3, 5, 100]),
    group_connectivity_type=st.sampled_from([4, 8]),
)  # fmt: skip
OBSTACLE_LAYERS = st.builds(
    ObstacleLayer, track_unknown_space=st.booleans(), combination_method=st.sampled_from([0, 1, 2])
)
LAYERS = STATIC_LAYERS | INFLATION_LAYERS | DENOISE_LAYERS | OBSTACLE_LAYERS
