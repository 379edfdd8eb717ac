import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.mapping.evidence import crossings_of, thin_blocks, thin_surface


@st.composite
def fields(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    field = rng.uniform(-1, 1, shape).round(1)
    if draw(st.booleans()):  # smooth, as fields of scans are
        rows, cols = np.indices(shape)
        field = (rows * rng.uniform(-1, 1) + cols * rng.uniform(-1, 1) + rng.uniform(-4, 4)) / 4
    field[rng.random(shape) < draw(st.sampled_from([0.0, 0.3]))] = np.nan
    return field


def pairs(field):
    """Neighbours of different sign, as pairs of cells."""
    for (row, col), value in np.ndenumerate(field):
        for other in ((row + 1, col), (row, col + 1)):
            if other[0] < field.shape[0] and other[1] < field.shape[1] and value * field[other] < 0:
                yield (row, col), other


@given(field=fields())
def test_places_are_where_a_line_between_two_cells_is_zero(field):
    expected = [(row + 0.5, col + 0.5) for (row, col), v in np.ndenumerate(field) if v == 0]
    for a, b in pairs(field):
        share = field[a] / (field[a] - field[b])
        expected.append(tuple(p + 0.5 + share * (q - p) for p, q in zip(a, b, strict=True)))
    found = crossings_of(field).places()
    assert len(found) == len(expected)
    if expected:  # in whatever order: sums that round otherwise would sort otherwise
        apart = np.abs(found[:, np.newaxis] - np.array(expected)).max(axis=2) > 1e-12
        assert not apart.all(axis=0).any()
        assert not apart.all(axis=1).any()


def components(mask):
    """Number the cells of each group, connected over eight neighbours."""
    labels, count = np.zeros(mask.shape, int), 0
    for cell in np.argwhere(mask).tolist():
        stack = [tuple(cell)]
        if labels[stack[0]]:
            continue
        count += 1
        while stack:
            row, col = stack.pop()
            if not (0 <= row < mask.shape[0] and 0 <= col < mask.shape[1]):
                continue
            if mask[row, col] and not labels[row, col]:
                labels[row, col] = count
                stack += [(row + i, col + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return labels


@given(field=fields())
def test_a_surface_is_made_of_the_nearer_cells_and_has_no_gap(field):
    """All cells that are nearer to zero than a neighbour of the other sign, but for spare ones."""
    nearer = field == 0
    for a, b in pairs(field):
        nearer[min((a, b), key=lambda cell: (abs(field[cell]), field[cell]))] = True
    found = thin_surface(field, crossings_of(field))
    assert not (found & ~nearer).any()
    blocks = nearer[1:, 1:] & nearer[1:, :-1] & nearer[:-1, 1:] & nearer[:-1, :-1]
    in_block = np.zeros(field.shape, bool)
    for row, col in np.argwhere(blocks).tolist():
        in_block[row : row + 2, col : col + 2] = True
    for a, b in pairs(field):  # no gap, but where blocks were thinned
        assert found[a] or found[b] or in_block[a] or in_block[b]
    assert found.any() == nearer.any()
    assert found[field == 0].sum() >= (field == 0).sum() - in_block.sum()


def test_a_cell_whose_partners_are_all_chosen_is_left_out():
    """0.1 is nearer than -0.2, which is nearer than 0.3: -0.2 alone parts both sides."""
    field = np.array([[0.1, -0.2, 0.3]])
    assert thin_surface(field, crossings_of(field)).tolist() == [[False, True, False]]


@given(seed=st.integers(0, 2**32 - 1), density=st.sampled_from([0.3, 0.5, 0.7, 0.9]))
def test_thinned_blocks_are_as_connected_as_before(seed, density):
    rng = np.random.default_rng(seed)
    before = rng.random((8, 9)) < density
    after = before.copy()
    thin_blocks(after, rng.random(before.shape))
    assert not (after & ~before).any()
    assert components(after).max() == components(before).max()
    # and what is open stays parted: no two rooms become one
    rooms = [_rooms(mask) for mask in (before, after)]
    assert rooms[0] == rooms[1]


def _rooms(walls):
    """Count the groups of open cells over four neighbours, the outside being one."""
    padded = np.pad(~walls, 1, constant_values=True)
    count, left = 0, {tuple(cell) for cell in np.argwhere(padded).tolist()}
    while left:
        count += 1
        stack = [left.pop()]
        while stack:
            row, col = stack.pop()
            for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                other = row + step[0], col + step[1]
                if other in left:
                    left.remove(other)
                    stack.append(other)
    return count


def test_a_block_of_four_loses_the_cells_farthest_from_zero():
    block = np.ones((2, 2), bool)
    thin_blocks(block, np.array([[0.1, 0.4], [0.2, 0.3]]))
    assert block.tolist() == [[True, False], [True, True]]


def test_a_straight_wall_is_one_cell_thick_at_any_angle():
    for angle in np.radians([0, 7, 30, 45, 63, 90, 121]):
        rows, cols = np.indices((40, 40)) - 19.37
        field = np.clip((rows * np.cos(angle) + cols * np.sin(angle)) / 2, -1, 1)
        wall = thin_surface(field, crossings_of(field))
        assert not (wall[1:, 1:] & wall[1:, :-1] & wall[:-1, 1:] & wall[:-1, :-1]).any()
        assert components(wall).max() == 1
        assert 39 <= wall.sum() <= 58
        off = np.abs(rows * np.cos(angle) + cols * np.sin(angle))[wall]
        assert off.max() <= 0.75
        # it parts both sides: no step over four neighbours from positive to negative
        side = np.where(wall, 0, np.sign(field))
        assert not (side[1:] * side[:-1] < 0).any()
        assert not (side[:, 1:] * side[:, :-1] < 0).any()


def test_a_spare_cell_is_left_out_on_any_side_of_its_partners():
    row = np.array([[0.1, -0.2, 0.3]])
    for field in (row, row[:, ::-1], row.T, row.T[::-1]):
        found = thin_surface(field, crossings_of(field))
        assert np.array_equal(found, field == -0.2)
