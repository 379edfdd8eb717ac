"""Recipes on grids in memory."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.grid.footprint import Footprint
from mapdeal.maps.npz import Grid
from mapdeal.pipeline import recipe as recipes
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.run import products_of
from mapdeal.pipeline.settings import Canvas, Settings
from mapdeal.ros.robot import RobotParameters

RecipeLike = str | PathLike[str] | Recipe | RobotParameters
"""A built-in recipe, a file, a recipe that was loaded, or a robot, whose costmap it is."""


def load_recipe(
    recipe: RecipeLike = "default",
    changes: Mapping[str, object] | None = None,
    *,
    footprint: Footprint | None = None,
    sim: bool = False,
) -> Recipe:
    """Load a recipe, apply changes to it, and check all its parameters.

    Parameters
    ----------
    recipe : str, path, Recipe or RobotParameters
        Name of a built-in recipe, such as ``default`` or ``nav2`` (see ``mapdeal run --help``),
        or a YAML file. A loaded recipe is returned unchanged. Robot parameters, from
        `read_robot_parameters`, become a recipe for the costmap that they describe.
    changes : mapping of str to object, optional
        Parameters by ``stage.parameter``, such as ``{"inflate.radius": 0.3}``, like ``--set``.
        They override everything else.
    footprint : Footprint, optional
        Robot shape. It sets the radius of `inflate`, or the radii of the costs if the recipe
        does not inflate.
    sim : bool
        Whether the map shows a simulated world: its active region is cropped first, and the field
        treats unknown cells as obstacles.

    Returns
    -------
    Recipe
        Recipe for `apply_recipe` and `run`; `Recipe.described` lists all its parameters.

    Raises
    ------
    ParameterError
        If the recipe does not exist or is malformed, a parameter is unknown or invalid, or changes
        are given for a loaded recipe.
    FileAccessError
        If the recipe file cannot be read.

    Warns
    -----
    MapdealWarning
        If the robot's radius would be applied twice.

    Examples
    --------
    >>> load_recipe("nav2", {"cost.inflation_radius": 0.8})
    Recipe(esdf -> cost exponential)
    """
    if footprint is not None and not isinstance(footprint, Footprint):
        hint = "Footprint.circle(radius) or Footprint.polygon([(x, y), ...]) makes one"
        raise ParameterError("must be a Footprint", place="footprint", got=footprint, hint=hint)
    if isinstance(recipe, Recipe):
        if changes or footprint is not None or sim:
            rule = "a recipe that was loaded cannot be changed"
            raise ParameterError(rule, place="recipe", hint="give the changes to load_recipe")
        return recipe
    robot = recipe if isinstance(recipe, RobotParameters) else None
    if robot is None and not isinstance(recipe, str | PathLike):
        rule = "must be the name of a recipe, a file, a robot, or what load_recipe returns"
        raise ParameterError(rule, place="recipe", got=recipe)
    if changes is not None and not isinstance(changes, Mapping):
        raise ParameterError("must be values by name", place="changes", got=changes)
    return recipes.load_recipe(
        str(recipe) if robot is None else None,
        sim=sim,
        footprint=footprint,
        robot=robot,
        changes=changes,
        prefix="",
    )


def apply_recipe(
    grid: Grid,
    recipe: RecipeLike = "default",
    changes: Mapping[str, object] | None = None,
    *,
    footprint: Footprint | None = None,
    sim: bool = False,
    canvas: Canvas = "crop",
) -> dict[str, Grid]:
    """Apply a recipe to a grid in memory; the counterpart of `run` without files.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap, DistanceField or PotentialField
        Map to process. A costmap is processed as the map that ROS would publish, a field as the
        map that it was computed from.
    recipe, changes, footprint, sim
        As for `load_recipe`.
    canvas : {'crop', 'full'}
        Extent of the products: the cells that the stages computed, or the full map extent.

    Returns
    -------
    dict of str to grid
        Product of each stage by stage name, in order: a `DistanceField` for ``esdf``, a `Costmap`
        for ``cost``, an `OccupancyGrid` for ``inflate`` and ``active``.

    Raises
    ------
    ParameterError
        As for `load_recipe`, and if a stage cannot be applied to the grid.
    FileAccessError
        If the recipe file cannot be read.

    Warns
    -----
    MapdealWarning
        If a product carries no information, such as the same cost in all cells.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> made = apply_recipe(OccupancyGrid([[100, 0, 0]], 0.5), "nav2", {"cost.inflation_radius": 1})
    >>> list(made), made["cost"].cost.tolist()
    (['esdf', 'cost'], [[254, 110, 24]])
    """
    if not isinstance(grid, Grid):
        hint = "mapdeal.run takes the path of a map, read_map reads it"
        raise ParameterError("takes a grid", place="apply_recipe", got=grid, hint=hint)
    canvas = Settings(canvas=canvas).canvas
    loaded = load_recipe(recipe, changes, footprint=footprint, sim=sim)
    made = {}
    whole = grid.frame if canvas == "full" else None
    for product in products_of(loaded, grid, None, canvas=whole):
        made[product.step.name] = product.grid
        remark = product.step.remark_on(product.grid.figures())
        if remark is not None:
            emit_warning(remark, stacklevel=2)
    return made
