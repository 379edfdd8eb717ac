from pathlib import Path


def write_robot(path, radius):
    """Write the Nav2 parameters of a round robot with a static and an inflation layer."""
    layers = "static_layer: {plugin: 'nav2_costmap_2d::StaticLayer'}, "
    layers += "inflation_layer: {plugin: 'nav2_costmap_2d::InflationLayer'}"
    names = "plugins: [static_layer, inflation_layer]"
    values = f"robot_radius: {radius}, track_unknown_space: true, {names}, {layers}"
    Path(path).write_text(
        f"global_costmap: {{global_costmap: {{ros__parameters: {{{values}}}}}}}\n"
    )
