"""Naive versions of every algorithm, by loops over all pairs of cells. Slow, and plain to see."""

import functools
import heapq
import itertools
import math
from decimal import Context, Decimal, localcontext
from fractions import Fraction

import numpy as np


def squared_distance(marked):
    """Return squared distances in cells to the nearest marked cell, or None."""
    sites = np.argwhere(marked)
    result = np.empty(marked.shape, dtype=object)
    for row, col in np.ndindex(marked.shape):
        squares = [(row - r) ** 2 + (col - c) ** 2 for r, c in sites.tolist()]
        result[row, col] = min(squares, default=None)
    return result


def squared_distance_by_columns(marked):
    """The same as integers, column by column of offsets: slow, but not too slow for real sizes.

    Rows find their distance to their own marked cells; then every row is compared with every other.
    """
    height, width = marked.shape
    far = 2 * (height + width)
    along = np.full(marked.shape, far, dtype=np.int64)
    for col in range(width):
        along[:, col] = np.where(marked[:, col], 0, along[:, col - 1] + 1 if col else far)
    for col in range(width - 2, -1, -1):
        along[:, col] = np.minimum(along[:, col], along[:, col + 1] + 1)
    best = np.full(marked.shape, np.iinfo(np.int64).max)
    for offset in range(height):
        lower, upper = best[offset:], best[: height - offset]
        np.minimum(lower, along[: height - offset] ** 2 + offset**2, out=lower)
        np.minimum(upper, along[offset:] ** 2 + offset**2, out=upper)
    return best


EDGES = [(0, 1), (1, 0), (0, -1), (-1, 0)]
AROUND = [*EDGES, (1, 1), (1, -1), (-1, 1), (-1, -1)]


def groups(marked, steps=AROUND):
    """Sets of cells that such steps connect, by flooding."""
    remaining = set(map(tuple, np.argwhere(marked).tolist()))
    while remaining:
        group, edge = set(), {remaining.pop()}
        while edge:
            group |= edge
            edge = {(r + i, c + j) for r, c in edge for i, j in steps} & remaining
            remaining -= edge
        yield group


def thickness(marked):
    """For each marked cell the shorter of its runs along row and column, by walking from it."""
    found = {}
    for row, col in map(tuple, np.argwhere(marked).tolist()):
        runs = []
        for down, right in ((0, 1), (1, 0)):
            length = 1
            for sign in (1, -1):
                r, c = row + sign * down, col + sign * right
                while 0 <= r < marked.shape[0] and 0 <= c < marked.shape[1] and marked[r, c]:
                    length, r, c = length + 1, r + sign * down, c + sign * right
            runs.append(length)
        found[row, col] = min(runs)
    return found


def disc_inflation(occupied, radius, resolution):
    """Mask of cells whose centre is within the radius of an occupied cell's centre."""
    if not occupied.any():
        return occupied
    return squared_distance(occupied).astype(float) ** 0.5 * resolution <= radius + 1e-9


def square_inflation(occupied, reach):
    """Mask of cells within `reach` cells of an occupied one along both axes."""
    grown = np.zeros(occupied.shape, dtype=bool)
    rows, cols = np.indices(occupied.shape)
    for row, col in np.argwhere(occupied).tolist():
        grown |= np.maximum(abs(rows - row), abs(cols - col)) <= reach
    return grown


def signed_distance(occupied, resolution, convention):
    """Signed distance in metres by the rule of each convention."""
    squared = np.where(occupied, squared_distance(~occupied), squared_distance(occupied))
    metres = np.where(squared == None, np.inf, squared).astype(float) ** 0.5 * resolution  # noqa: E711
    inner, outer = {"fast-planner": (1, 0), "center": (0, 0), "border": (0.5, 0.5)}[convention]
    return np.where(occupied, inner * resolution - metres, metres - outer * resolution)


def cost_of_distance(cells, resolution, inscribed_radius, factor):
    """The cost of a distance in cells, as costmap_2d's computeCost."""
    if cells == 0:
        return 254
    if cells * resolution <= inscribed_radius:
        return 253
    return int(252 * math.exp(-factor * (cells * resolution - inscribed_radius)))


def static_layer_cost(value, threshold, *, trinary, track_unknown, inscribed, unknown=255):
    """The cost of a map's value, as interpretValue of costmap_2d's static layer."""
    byte = value % 256
    if byte == unknown:
        return 255 if track_unknown else 0
    if byte == inscribed:
        return 253
    if byte >= threshold:
        return 254
    return 0 if trinary else int(byte / threshold * 254)


def exponential_cost(
    old, resolution, inscribed_radius, inflation_radius, factor, inflate_unknown, around_unknown,
    *, lookup="exact", float32=False,
):  # fmt: skip
    """costmap_2d's inflation of old costs, with exact distances, or those that Nav2 looks up."""
    tolerance = 1e-9
    if float32:
        resolution, tolerance = float(np.float32(resolution)), 0.0
    reach = math.ceil(inflation_radius / resolution - tolerance)
    if reach == 0:
        return old.copy()
    squared = squared_distance((old == 254) | (around_unknown & (old == 255)))
    result = old.copy()
    for index in np.ndindex(old.shape):
        s = squared[index]
        if s is None or math.sqrt(s) > reach:
            continue
        cells = math.sqrt(s)
        if lookup == "nav2":
            cells = int(np.sqrt(np.float32(s)) * np.float32(100) + np.float32(0.5)) / 100.0
        cost = cost_of_distance(cells, resolution, inscribed_radius, factor)
        if old[index] == 255:
            if cost > 0 if inflate_unknown else cost >= 253:
                result[index] = cost
        else:
            result[index] = max(old[index], cost)
    return result


def master_grid(occupancy, resolution, layers, default_cost):
    """costmap_2d's master grid in plain Python: the layers' updateCosts one after the other."""
    master = np.full(occupancy.shape, default_cost, np.uint8)
    for layer in layers:
        if hasattr(layer, "inflation_radius"):
            master = exponential_cost(
                master, resolution, layer.inscribed_radius, layer.inflation_radius,
                layer.cost_scaling_factor, layer.inflate_unknown, layer.inflate_around_unknown,
                lookup=layer.lookup, float32=True,
            )  # fmt: skip
            continue
        if hasattr(layer, "minimal_group_size"):
            marked = np.isin(master, [253, 254, *([255] if default_cost != 255 else [])])
            for group in groups(marked, AROUND[: layer.group_connectivity_type]):
                if len(group) < layer.minimal_group_size:
                    for index in group:
                        master[index] = 0
            continue
        for index in np.ndindex(occupancy.shape):
            old = int(master[index])
            if hasattr(layer, "combination_method"):
                master[index] = combined(old, layer)
                continue
            cost = static_layer_cost(
                int(occupancy[index]), layer.lethal_cost_threshold, trinary=layer.trinary_costmap,
                track_unknown=layer.track_unknown_space, unknown=layer.unknown_cost_value,
                inscribed=layer.inscribed_obstacle_cost_value,
            )  # fmt: skip
            if layer.use_maximum and layer.unknown_is_highest:
                master[index] = max(old, cost)
            elif not layer.use_maximum or (cost != 255 and (old == 255 or old < cost)):
                master[index] = cost
    return master


def combined(old, layer):
    """The cost that an obstacle layer without observations makes of the one below it."""
    own = 255 if layer.track_unknown_space else 0
    if own == 255 or layer.combination_method == 2:  # 0 is never more than a known cost
        return old
    if layer.combination_method == 0:
        return own
    return own if old == 255 or old < own else old


def on_paper(number):
    """A float as the shortest decimal that stands for it: 0.05 is five hundredths."""
    return Decimal(repr(float(number)))


@functools.cache
def root(square):
    """The square root of a whole number, to 50 digits."""
    return Context(prec=50).sqrt(Decimal(square))


def whole_part(product):
    """Round a product to 1e-9 and drop its remaining fraction."""
    return int(product.quantize(Decimal("1e-9")))


def metric_view(occupancy, occupied, resolution, view_range, strength=1.0):
    """The 0..100 view of the strengthened distances that falls linearly to 0 at view_range."""
    squared = squared_distance(occupied)
    cell, end = on_paper(strength) * on_paper(resolution), on_paper(view_range)
    result = np.zeros(occupancy.shape, dtype=np.int8)
    for index in np.ndindex(occupancy.shape):
        if occupied[index]:
            result[index] = 100
        elif occupancy[index] == -1:
            result[index] = -1
        elif squared[index] is not None:
            with localcontext(Context(prec=50)):
                share = min(cell * root(squared[index]), end) / end
                result[index] = whole_part(100 * (1 - share))
    return result


def per_map_view(occupancy, occupied, resolution, strength=1.0):
    """The 0..100 view of the strengthened distances scaled between the map's own extremes."""
    outside, inside = squared_distance(occupied), squared_distance(~occupied)
    result = np.zeros(occupancy.shape, dtype=np.int8)
    if occupied.any() and not occupied.all():
        factor = on_paper(strength)
        with localcontext(Context(prec=50)):
            farthest = factor * root(max(outside.ravel()))
            span = farthest - 1 + root(max(inside.ravel()))
            for index in np.ndindex(occupancy.shape):
                distance = factor * root(outside[index])
                result[index] = whole_part(100 * (farthest - distance) / span)
    result[occupancy == -1] = -1
    result[occupied] = 100
    return result


def threshold_cost(view, squared, resolution, strength, *, down, up, factors):
    """Costs of a view by thresholds, each a view value or, as text, metres on paper."""
    cost = view.copy()
    for index in np.ndindex(view.shape):
        if view[index] in (100, -1):
            continue
        v, s = int(view[index]), squared[index]

        def is_nearer(threshold, v=v, s=s):
            if not isinstance(threshold, str):
                return v > threshold
            cells = Fraction(threshold) / Fraction(on_paper(resolution) * on_paper(strength))
            return s is not None and s < cells**2

        factor = 0
        if is_nearer(down):
            factor = factors[1] if is_nearer(up) else factors[0]
        cost[index] = min(99, math.trunc(Fraction(on_paper(factor)) * v))
    return cost


def line(start, stop):
    """costmap_2d's cells from start to stop, by its running error."""
    (x, y), (x1, y1) = start, stop
    dx, dy = abs(x1 - x), abs(y1 - y)
    step_x, step_y = (1 if x1 > x else -1), (1 if y1 > y else -1)
    n = max(dx, dy)
    error_x = error_y = n // 2
    cells = [(x, y)]
    for _ in range(n):
        error_x, error_y = error_x + dx, error_y + dy
        if error_x >= n:
            x, error_x = x + step_x, error_x - n
        if error_y >= n:
            y, error_y = y + step_y, error_y - n
        cells.append((x, y))
    return cells


def outline(corners):
    """The cells of a closed polygon's edges, each drawn from its first to its second corner."""
    return {c for a, b in zip(corners, corners[1:] + corners[:1], strict=True) for c in line(a, b)}


def convex_fill(corners):
    """The outline, and in each column all between its lowest and its highest cell."""
    cells = outline(corners)
    filled = set()
    for x in {x for x, _ in cells}:
        ys = [y for cx, y in cells if cx == x]
        filled |= {(x, y) for y in range(min(ys), max(ys) + 1)}
    return filled


def ring_fill(rings, width, height):
    """Return the outlines, and the cells with an odd number of edges to their left."""
    cells = {c for ring in rings for c in outline(ring)}
    edges = [e for ring in rings for e in zip(ring, ring[1:] + ring[:1], strict=True)]
    for x, y in itertools.product(range(width), range(height)):
        if sum((y0 > y) != (y1 > y) and x0 + Fraction((y - y0) * (x1 - x0), y1 - y0) < x
               for (x0, y0), (x1, y1) in edges) % 2:  # fmt: skip
            cells.add((x, y))
    return {(x, y) for x, y in cells if 0 <= x < width and 0 <= y < height}


def corner_cells(lattice, shape, corners, pose):
    """The cells (x, y) of a robot's corners, and None if the grid lacks one."""
    resolution, origin_x, origin_y, grid_yaw = lattice
    x, y, yaw = pose
    cells = []
    for corner_x, corner_y in corners:
        at_x = x + (corner_x * math.cos(yaw) - corner_y * math.sin(yaw))
        at_y = y + (corner_x * math.sin(yaw) + corner_y * math.cos(yaw))
        if grid_yaw == 0.0:
            east, north = at_x - origin_x, at_y - origin_y
        else:
            east, north = np.linalg.solve(
                [[math.cos(grid_yaw), -math.sin(grid_yaw)],
                 [math.sin(grid_yaw), math.cos(grid_yaw)]],
                [at_x - origin_x, at_y - origin_y],
            ).tolist()  # fmt: skip
        col, row = math.floor(east / resolution), math.floor(north / resolution)
        if not (0 <= row < shape[0] and 0 <= col < shape[1]):
            return None
        cells.append((col, row))
    return cells


def footprint_cost(costs, cells):
    """What Nav2's checker says of corners in these cells (x, y): line by line, cell by cell."""

    def line_cost(start, stop):
        highest = 0
        for x, y in line(start, stop):
            if costs[y][x] == 254:
                return 254
            highest = max(highest, int(costs[y][x]))
        return highest

    cost = 0
    for start, stop in itertools.pairwise(cells):
        cost = max(line_cost(start, stop), cost)
        if cost == 254:
            return cost
    return max(line_cost(cells[0], cells[-1]), cost)


def full_footprint_cost(costs, cells):
    """The same of all cells that a polygon has, and of Nav2's last line: 254 if any has it."""
    covered = ring_fill([cells], len(costs[0]), len(costs)) | set(line(cells[0], cells[-1]))
    found = {int(costs[y][x]) for x, y in covered}
    return 254 if 254 in found else max(found)


def value_at(grid, point, margin):
    """The value at a point, -1 outside; None within a margin of an edge, in cells."""
    yaw = grid.origin[2]
    x, y = np.subtract(point, grid.origin[:2]) / grid.resolution
    row, col = y * math.cos(yaw) - x * math.sin(yaw), x * math.cos(yaw) + y * math.sin(yaw)
    if min(abs(place - round(place)) for place in (row, col)) < margin:
        return None
    row, col = math.floor(row), math.floor(col)
    inside = 0 <= row < grid.shape[0] and 0 <= col < grid.shape[1]
    return int(grid.occupancy[row, col]) if inside else -1


def shared_area(first, second):
    """The area that two polygons share."""
    from shapely import Polygon

    return Polygon(first).intersection(Polygon(second)).area


def distance_to_segment(point, a, b):
    """Distance from a point to the segment between two others."""
    along = np.subtract(b, a)
    share = np.clip(np.subtract(point, a) @ along / max(along @ along, 1e-300), 0, 1)
    return math.dist(point, np.add(a, share * along))


def clearances(points, obstacles):
    """The least and the mean distance of a way to the nearest of some points; inf without any."""
    nearest = [min((math.dist(a, b) for b in obstacles), default=math.inf) for a in points]
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    if not obstacles or not sum(lengths):
        return nearest[0], nearest[0]
    means = [(a + b) / 2 for a, b in itertools.pairwise(nearest)]
    return min(nearest), float(np.average(means, weights=lengths))


def bilinear(values, row, col):
    """Value and slopes of the bilinear interpolant; centres lie at +0.5, the border goes on."""
    height, width = values.shape

    def at(r, c):
        return float(values[min(max(r, 0), height - 1), min(max(c, 0), width - 1)])

    south, west = math.floor(row - 0.5), math.floor(col - 0.5)
    v, u = row - 0.5 - south, col - 0.5 - west
    a, b = at(south, west), at(south, west + 1)
    c, d = at(south + 1, west), at(south + 1, west + 1)
    value = a * (1 - u) * (1 - v) + b * u * (1 - v) + c * (1 - u) * v + d * u * v
    return value, (c - a) * (1 - u) + (d - b) * u, (b - a) * (1 - v) + (d - c) * v


def sum_of_inverse_distances(marked, scale, least):
    """The sum of 1 / distance over all marked cells, pair by pair."""
    result = np.zeros(marked.shape)
    for row, col in np.ndindex(marked.shape):
        distances = [math.hypot(row - r, col - c) * scale for r, c in np.argwhere(marked).tolist()]
        result[row, col] = sum(1 / distance for distance in distances if distance > least)
    return result


def slopes_along_map_axes(values, resolution, yaw):
    """d/dx and d/dy in the map frame, per metre: differences of the cells beside each.

    One-sided at the border, 0 along an axis of a single cell.
    """
    up, right = np.zeros((2, *np.shape(values)))
    for row, col in np.ndindex(up.shape):
        south, north = max(row - 1, 0), min(row + 1, len(values) - 1)
        west, east = max(col - 1, 0), min(col + 1, len(values[0]) - 1)
        up[row, col] = (values[north][col] - values[south][col]) / max(north - south, 1)
        right[row, col] = (values[row][east] - values[row][west]) / max(east - west, 1)
    sin, cos = math.sin(yaw) / resolution, math.cos(yaw) / resolution
    return right * cos - up * sin, right * sin + up * cos


def best_first(weights, surcharges, start, goal, on_near_tie=lambda: None):
    """Cells, cost and number of expanded cells of a search that takes the least g + h first.

    h is the octile distance times the least weight, plus the cell's surcharge. Of equal ones the
    latest comes first, and neighbours are looked at row by row. A cell is expanded once. Weights,
    their diagonals and surcharges are whole numbers of 2^-24. Where float32 decides, rounding of
    the weights would: `on_near_tie` is called.
    """
    unit = 1 << 24
    scaled = [[max(1, round(w * unit)) if w > 0 else 0 for w in row] for row in weights]
    extra = [[round(s * unit) for s in row] for row in surcharges]
    least = min(w for row in scaled for w in row if w)

    def estimate(row, col):
        rows, cols = abs(row - goal[0]), abs(col - goal[1])
        straight, diagonal = abs(rows - cols), min(rows, cols)
        return least * straight + round(least * math.sqrt(2)) * diagonal + extra[row][col]

    cost, before, expanded = {start: 0}, {start: None}, set()
    waiting = [(estimate(*start), 0, start)]
    while waiting:
        first = min(entry[0] for entry in waiting)
        latest = max(index for index, entry in enumerate(waiting) if entry[0] == first)
        if any(first < entry[0] < first + (unit >> 12) for entry in waiting):
            on_near_tie()
        _, so_far, cell = waiting.pop(latest)
        if cell == goal:
            path = []
            while cell is not None:
                path.append(list(cell))
                cell = before[cell]
            return path[::-1], cost[goal] / unit, len(expanded)
        if cell in expanded or so_far > cost[cell]:
            continue
        expanded.add(cell)
        row, col = cell
        for r in range(max(row - 1, 0), min(row + 2, len(scaled))):
            for c in range(max(col - 1, 0), min(col + 2, len(scaled[0]))):
                if (r, c) in expanded or scaled[r][c] == 0:
                    continue
                step = scaled[r][c]
                if r != row and c != col:
                    if scaled[r][col] == 0 and scaled[row][c] == 0:
                        continue
                    step = round(step * math.sqrt(2))
                if so_far + step < cost.get((r, c), math.inf):
                    cost[r, c], before[r, c] = so_far + step, cell
                    waiting.append((so_far + step + estimate(r, c), so_far + step, (r, c)))
    return [], math.inf, len(expanded)


def lowest_cost(weights, start, goal):
    """Cost of the cheapest path over eight neighbours; cells of weight 0 are closed."""
    return lengths_from(np.maximum(weights, 0), [start]).get(goal)


def flooded(is_open, start):
    """Set of the open cells with a way over edges from an open cell."""
    return next(group for group in groups(is_open, EDGES) if start in group)


def widest_by_flooding(squared, is_open, start):
    """For each cell the largest square such that it is reached over cells of at least that."""
    widest = np.zeros(squared.shape, dtype=np.int64)
    for square in np.unique(squared[is_open]).tolist():
        above = is_open & (squared >= square)
        if not above[start]:
            break
        for cell in flooded(above, start):
            widest[cell] = square
    return widest


def merged_basins(squared, is_open):
    """Basins, by their peaks, and merges (square, cell, its basin, another), as cells are added.

    Cells come by falling square, of equal ones the last in reading order first. A cell is of the
    basin of its first neighbour to come, and may merge it with those of others.
    """
    cells = map(tuple, np.argwhere(is_open).tolist())
    order = sorted(cells, key=lambda c: (-squared[c], -c[0], -c[1]))
    place = {cell: k for k, cell in enumerate(order)}
    basin, merges, group = {}, [], {}
    for cell in order:
        row, col = cell
        beside = [(row + 1, col), (row, col + 1), (row, col - 1), (row - 1, col)]
        near = [neighbour for neighbour in beside if neighbour in basin]
        first = min(near, key=place.get, default=None)
        basin[cell] = cell if first is None else basin[first]
        group.setdefault(basin[cell], {basin[cell]})
        for neighbour in near:
            if basin[neighbour] not in group[basin[cell]]:
                merges.append((int(squared[cell]), cell, basin[cell], basin[neighbour]))
                both = group[basin[cell]] | group[basin[neighbour]]
                group.update(dict.fromkeys(both, both))
    return basin, merges


def open_poses(blocked, footprints):
    """Whether each footprint, a set of cells (row, column), touches nothing, (K, H, W)."""
    height, width = blocked.shape
    return np.array([[[
        all(0 <= row + r < height and 0 <= col + c < width and not blocked[row + r, col + c]
            for r, c in cells)
        for col in range(width)] for row in range(height)] for cells in footprints
    ])  # fmt: skip


def reached_poses(opened, seeds):
    """The open poses that steps to a neighbour cell or heading lead to, (K, H, W)."""
    count, height, width = opened.shape
    reached = np.zeros_like(opened)
    waiting = [seed for seed in seeds if opened[seed]]
    while waiting:
        pose = waiting.pop()
        if reached[pose]:
            continue
        reached[pose] = True
        k, row, col = pose
        steps = [((k + 1) % count, row, col), ((k - 1) % count, row, col)]
        steps += [(k, row + r, col + c) for r, c in EDGES]
        waiting += [s for s in steps if 0 <= s[1] < height and 0 <= s[2] < width and opened[s]]
    return reached


def costs_to_go(weights, sources):
    """Costs over the eight triangles of each cell, updated until none falls, as a list of rows."""
    height, width = len(weights), len(weights[0])
    costs = {(r, c): math.inf for r in range(-1, height + 1) for c in range(-1, width + 1)}
    open_cells = np.argwhere(np.array(weights) > 0).tolist()
    costs.update(sources)
    is_lower = True
    while is_lower:
        is_lower = False
        for row, col in open_cells:
            weight, found = weights[row][col], [costs[row, col]]
            for r, c in EDGES:
                beside = costs[row + r, col + c]
                if math.isinf(beside):
                    continue
                found.append(beside + weight)
                for turn in (-1, 1):
                    diagonal = costs[row + r + turn * c, col + c + turn * r]
                    drop = beside - diagonal
                    if drop > 0 and 2 * drop * drop < weight * weight:
                        found.append(beside + math.sqrt(weight * weight - drop * drop))
                    found.append(diagonal + weight * math.sqrt(2))
            if min(found) < costs[row, col]:
                costs[row, col], is_lower = min(found), True
    return [[costs[row, col] for col in range(width)] for row in range(height)]


def shortest_way(is_open, start, goal):
    """Length in cells of the shortest way in any direction, over corners that see one another.

    Closed cells are grown by a little, so that none is passed at a corner that two have in common,
    and corners lie a little farther outside.
    """
    grown = 1e-9
    closed = np.argwhere(~np.pad(is_open, 1)) - 1
    squares = set(map(tuple, closed.tolist()))
    nodes = [start, goal]
    for row, col in np.ndindex(is_open.shape[0] + 1, is_open.shape[1] + 1):
        around = [(row + r, col + c) for r in (-1, 0) for c in (-1, 0)]
        beside = [cell for cell in around if cell in squares]
        if len(beside) == 1:
            away = [2 * grown * (1 if k != at else -1)
                    for k, at in zip(beside[0], (row, col), strict=True)]  # fmt: skip
            nodes.append((row + away[0], col + away[1]))

    def sees(first_point, second_point):
        """By clipping the line with all squares at once (Liang and Barsky)."""
        along = np.subtract(second_point, first_point)
        along[along == 0] = 1e-300
        first = (closed - grown - first_point) / along
        last = (closed + 1 + grown - first_point) / along
        enters = np.minimum(first, last).max(axis=1).clip(0, 1)
        return not (enters < np.maximum(first, last).min(axis=1).clip(0, 1)).any()

    lengths, waiting = dict.fromkeys(range(len(nodes)), math.inf), set(range(len(nodes)))
    lengths[0] = 0.0
    while waiting:
        here = min(waiting, key=lengths.get)
        waiting.remove(here)
        if here == 1 or math.isinf(lengths[here]):
            break
        for there in waiting:
            length = lengths[here] + math.dist(nodes[here], nodes[there])
            if length < lengths[there] and sees(nodes[here], nodes[there]):
                lengths[there] = length
    return lengths[1]


def lengths_from(weights, sources, limit=math.inf):
    """The weighted length in cells of the shortest way to each cell, by Dijkstra on a dict.

    No diagonal step leads between two cells of weight 0.
    """
    best, heap = dict.fromkeys(sources, 0.0), [(0.0, cell) for cell in sources]
    heapq.heapify(heap)
    while heap:
        length, (row, col) = heapq.heappop(heap)
        if length > best[row, col]:
            continue
        for up in (-1, 0, 1):
            for on in (-1, 0, 1):
                cell = row + up, col + on
                inside = 0 <= cell[0] < len(weights) and 0 <= cell[1] < len(weights[0])
                if not inside or not weights[cell] or (up, on) == (0, 0):
                    continue
                if up and on and not (weights[row + up, col] or weights[row, col + on]):
                    continue
                total = length + math.hypot(up, on) * weights[cell]
                if total < best.get(cell, math.inf) and total <= limit:
                    best[cell] = total
                    heapq.heappush(heap, (total, cell))
    return best


def beam_lengths(values, starts, angles, limit):
    """Return the distances of beams to obstacles, in cells, by clipping each beam with all cells.

    Beams end at cells of -1 without a hit; those that touch only a corner of a cell pass it.
    """
    closed = np.argwhere(values != 0)
    lengths = np.full(angles.shape, math.inf)
    for scan, beam in np.ndindex(angles.shape):
        along = np.array([math.sin(angles[scan, beam]), math.cos(angles[scan, beam])])
        along[along == 0] = 1e-300
        first, last = (closed - starts[scan]) / along, (closed + 1 - starts[scan]) / along
        enters, leaves = np.minimum(first, last).max(axis=1), np.maximum(first, last).min(axis=1)
        entered = np.flatnonzero((enters < leaves) & (leaves > 0))
        if len(entered):
            nearest = entered[np.argmin(enters[entered])]
            if values[tuple(closed[nearest])] > 0 and enters[nearest] < limit:
                lengths[scan, beam] = max(0.0, enters[nearest])
    return lengths
