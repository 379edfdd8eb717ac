"""Recipes on grids in memory."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike

from mapdeal.errors import ParameterError, emit_warning
from mapdeal.formats.npz import Grid
from mapdeal.grid.footprint import Footprint
from mapdeal.pipeline import recipe as recipes
from mapdeal.pipeline.applied import products_of
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import Canvas, Settings
from mapdeal.robot.parameters import RobotParameters

RecipeLike = str | PathLike[str] | Recipe | RobotParameters
"""A built-in recipe, a file, a recipe that was loaded, or a robot, whose costmap it is."""


def load_recipe(
    recipe: RecipeLike = "default",
    changes: Mapping[str, object] | None = None,
    *,
    footprint: Footprint | None = None,
    sim: bool = False,
) -> Recipe:
    """Load a recipe, adapt it, and check all its parameters.

    Parameters
    ----------
    recipe : str, path, Recipe or RobotParameters
        ``default``, ``nav2``, another one of `mapdeal run --help`, or a YAML file. A recipe that
        was loaded is returned as it is. A robot's own parameters, from `read_robot_parameters`,
        become the costmap that they describe.
    changes : mapping of str to object, optional
        Parameters by ``stage.parameter``, such as ``{"inflate.radius": 0.3}``, as ``--set``;
        stronger than all else.
    footprint : Footprint, optional
        The robot's shape: the radius of `inflate`, or those of costs if nothing is inflated.
    sim : bool
        Whether the map is of a simulated world: its active region is cut out first, and unknown
        cells are obstacles to the field.

    Returns
    -------
    Recipe
        For `apply_recipe` and `run`; `Recipe.described` has all its parameters.

    Raises
    ------
    ParameterError
        If there is no such recipe, it is malformed, a parameter is not known or not allowed, or
        a recipe that was loaded is to be adapted.
    FileAccessError
        If its file cannot be read.

    Warns
    -----
    MapdealWarning
        If the robot's radius would count twice.

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
    """Apply a recipe to a grid in memory; what `run` writes, without files.

    Parameters
    ----------
    grid : OccupancyGrid, Costmap, DistanceField or PotentialField
        The map; of costs the map that ROS would publish, of fields the map they were made from.
    recipe, changes, footprint, sim
        As of `load_recipe`.
    canvas : {'crop', 'full'}
        Whether products cover what stages have computed, or are put onto the whole map.

    Returns
    -------
    dict of str to grid
        What each stage has made, by the name of the stage, in order: `DistanceField` of
        ``esdf``, `Costmap` of ``cost``, `OccupancyGrid` of ``inflate`` and ``active``.

    Raises
    ------
    ParameterError
        As `load_recipe`, and if a stage cannot be applied to the grid.
    FileAccessError
        If the recipe's file cannot be read.

    Warns
    -----
    MapdealWarning
        Of products that say nothing, such as one cost for all cells.

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
