"""Reports of grids that the library makes."""

from dataclasses import replace

import mapdeal
from mapdeal.report.document import Entry, page_layers


def layers_of(grid, *, inscribed_radius=0.2, inflation_radius=0.8):
    """Return the map, its distance field and its costs, as the page takes them."""
    field = mapdeal.esdf(grid)
    costs = mapdeal.exponential_cost(
        grid, inscribed_radius=inscribed_radius, inflation_radius=inflation_radius
    )
    states = page_layers(grid, "occupancy", "Map")[-1]
    metres = replace(page_layers(field, "esdf", "Signed distance")[-1], states="occupancy")
    return (states, metres, page_layers(costs, "cost", "Cost")[-1]), field, costs


def entry_of(grid, name="office", **more):
    layers, _, _ = layers_of(grid)
    return Entry(name, layers, **more)
