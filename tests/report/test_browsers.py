"""The page in real browsers, against what the library says of the same grids."""

import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import mapdeal
from mapdeal.maps.shapes import read_zones
from mapdeal.report.document import Claim, Entry, Item, Report, Table, page_layers
from mapdeal.report.page import page_of
from report.browsers import in_time, started
from report.test_page import ATTACKS, entry_of, layers_of, nasty_report

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
PHONE = {"width": 360, "height": 780, "phone": True}


def scattered(shape, seed, origin=(-3.1, 2.2, 0.6), resolution=0.07):
    """Return a map with a few obstacles and unknown cells, turned and off the origin."""
    states, shares = [FREE, OCCUPIED, UNKNOWN], [0.985, 0.01, 0.005]
    values = np.random.default_rng(seed).choice(states, shape, p=shares)
    return mapdeal.OccupancyGrid(values.astype(np.int8), resolution, origin)


GRID = scattered((530, 700), 1)
CENTRE = tuple(GRID.frame.xy_from_rowcol([[265, 350]])[0].tolist())
CORNER = tuple(GRID.frame.xy_from_rowcol([[30, 40]])[0].tolist())
ITEMS = (
    Item("finding", "3 lone cells", "warning", CORNER),
    Item("passage", "too narrow", "error", CENTRE, (np.array([CENTRE, CORNER]),), "0.71 m"),
    Item("goal", "dock", "good", CENTRE, (), "dock"),
    Item("finding", "says nothing of a place", "note"),
)
LAYERS, FIELD, COSTS = layers_of(GRID)


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder, known = tmp_path_factory.mktemp("pages"), {}

    def path_of(report):
        if report.title not in known:
            path = folder / f"{len(known)}.html"
            path.write_bytes(b"".join(page_of(report, size=25_000_000)))
            known[report.title] = path
        return known[report.title]

    return path_of


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Return a function that starts a browser, each of them once."""
    known = {}

    def of(name):
        if name not in known:
            known[name] = started(name, tmp_path_factory.mktemp(name))
        return known[name]

    yield of
    for one_of_them in known.values():
        one_of_them.close()


@pytest.fixture(params=["chromium", pytest.param("firefox", marks=pytest.mark.thorough)])
def browser(request, running):
    return running(request.param)


@pytest.fixture
def chromium(running):
    return running("chromium")


def small():
    curve = mapdeal.cost_curve(0.07, inscribed_radius=0.2, inflation_radius=0.8)
    tables = (Table("Figures", (("cells", "371000"),)),)
    entry = Entry("scattered", LAYERS, ITEMS, tables, ("one warning",), curve=curve)
    return Report("scattered", (entry,), "1.0")


def several():
    entries = [
        entry_of(scattered((40, 50), k), name, figures={"free": size}, status="done")
        for k, (name, size) in enumerate({"b10": 10.0, "b9": 9.0, "a": 200.0}.items())
    ]
    return Report("several", (*entries, Entry("bad", status="failed")), "1.0")


def assert_quiet(browser, path):
    assert browser.complaints == []
    assert browser.requests == [path.as_uri()]


def points_of(frame, count, seed):
    """Return points inside and around a frame: anywhere, on borders and corners of cells."""
    draw = np.random.default_rng(seed)
    places = draw.uniform([-4, -4], [frame.height + 4, frame.width + 4], (count, 2))
    kind = draw.integers(0, 4, count)
    places[kind == 1, 0] = np.rint(places[kind == 1, 0])
    places[kind == 2] = np.rint(places[kind == 2])
    places[kind == 3] = np.floor(places[kind == 3]) + 0.5
    return frame.xy_from_continuous_rowcol(places)


READ_ALL = "(points) => Promise.all(points.map(([x, y]) => mapdeal.readout(x, y)))"


def test_values_are_those_of_the_library(browser, pages):
    path = pages(small())
    browser.show(path)
    points = points_of(GRID.frame, 400, 5)
    answers = browser.evaluate(READ_ALL, points.tolist())
    distance, gradient, inside = FIELD.query(points)
    cells, _ = GRID.frame.bounded_rowcol_from_xy(points)
    assert 0 < np.count_nonzero(~inside) < 100
    for k, (states, metres, cost) in enumerate(answers):
        if not inside[k]:
            assert [states["cell"], metres["cell"], cost["cell"]] == [None] * 3
            continue
        row, col = cells[k].tolist()
        assert states["cell"] == metres["cell"] == cost["cell"] == [row, col]
        assert states["value"] == int(GRID.occupancy[row, col]) % 256
        assert cost["value"] == COSTS.cost[row, col]
        assert metres["value"] == pytest.approx(distance[k], abs=1e-6)
        assert metres["gradient"] == pytest.approx(gradient[k].tolist(), abs=1e-4)
    labels = {states["label"] for states, _, _ in answers if states["cell"]}
    assert labels == {"free", "occupied", "unknown"}
    assert_quiet(browser, path)


@pytest.mark.thorough
def test_distances_without_obstacles_are_infinite_and_have_no_gradient(browser, pages):
    grid = mapdeal.OccupancyGrid(np.zeros((3, 4), np.int8), 0.25, (1.0, 2.0, 0.3))
    browser.show(pages(Report("empty", (entry_of(grid),), "1.0")))
    ((_, found, _),) = browser.evaluate(READ_ALL, [grid.frame.xy_from_rowcol([[1, 2]])[0].tolist()])
    assert found["value"] == "Infinity"
    assert "gradient" not in found
    assert found["text"] == "\u221e m"


@pytest.mark.thorough
def test_a_page_from_which_the_finest_level_is_left_out_says_so(browser, tmp_path):
    path = tmp_path / "small.html"
    path.write_bytes(b"".join(page_of(small(), size=20_000)))
    browser.show(path)
    ((states, metres, _),) = browser.evaluate(READ_ALL, [CENTRE])
    reduce = metres["reduce"]
    assert reduce > 1
    row, col = (int(index) // reduce * reduce for index in (265, 350))
    block = np.s_[row : row + reduce, col : col + reduce]
    assert metres["value"] == pytest.approx(float(FIELD.distance[block].min()), abs=1e-3)
    assert "gradient" not in metres
    assert f"smallest of {reduce} \u00d7 {reduce} cells" in metres["text"]
    assert f"largest of {reduce} \u00d7 {reduce} cells" in states["text"]


def colour_of(layer, point):
    row, col = layer.frame.bounded_rowcol_from_xy([point])[0][0].tolist()
    return layer.style.colours[layer.style.by_value[layer.values[row, col]]].tolist()


def test_pixels_have_the_colour_of_the_cell_of_the_uppermost_layer(browser, pages):
    lower = scattered((20, 30), 4, (1.0, -2.0, 0.3), 0.5)
    upper = scattered((9, 13), 5, (5.0, 2.0, -0.5), 0.2)
    below, above = layers_of(lower)[0][0], layers_of(upper)[0][2]
    browser.show(pages(Report("frames", (Entry("frames", (below, above)),), "1.0")))
    inner = points_of(upper.frame, 12, 6)[:8]
    inner = upper.frame.xy_from_rowcol(upper.frame.clamped_rowcol_from_xy(inner))
    outer = lower.frame.xy_from_rowcol([[1, 1], [18, 28], [2, 27]])
    inside = upper.frame.contains([*inner, *outer]).tolist()
    assert inside == [True] * 8 + [False] * 3
    for point, is_inside in zip([*inner, *outer], inside, strict=True):
        assert browser.pixel(point.tolist()) == colour_of(above if is_inside else below, point)


@pytest.mark.thorough
def test_the_rim_of_a_wall_is_red_where_a_tile_ends(chromium, pages):
    cells = np.zeros((9, 700), np.int8)
    cells[:, 505:512] = 100  # its free neighbours are in the next tile, and its field is 0 there
    grid = mapdeal.OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.3))
    field = mapdeal.esdf(grid)
    assert field.distance[4, 511] == 0
    chromium.show(pages(Report("rim", (Entry("rim", tuple(page_layers(field, "f", "F"))),), "1")))
    place = grid.frame.xy_from_rowcol([[4, 511]])[0].tolist()
    chromium.go(place, 40)
    is_red = lambda colour: colour[0] > colour[2] + 20  # noqa: E731
    assert is_red(chromium.pixel(place, is_red))


@pytest.mark.thorough
def test_an_opacity_of_a_half_mixes_two_layers(chromium, pages):
    chromium.show(pages(small()))
    chromium.fill(".layer [type=range]", 50)
    chromium.go(CORNER)
    row, col = GRID.frame.bounded_rowcol_from_xy([CORNER])[0][0].tolist()
    aside = GRID.frame.xy_from_rowcol([[row, col + 2]])[0].tolist()  # beside a finding's mark
    lower, upper = (np.array(colour_of(LAYERS[k], aside)) for k in (0, 2))
    assert abs(lower - upper).max() > 20
    expected = pytest.approx(((lower + upper) / 2).tolist(), abs=2)
    assert chromium.pixel(aside, expected.__eq__) == expected


BOXES = """() => [...document.querySelectorAll(".layer [type=checkbox]")]
  .map((box) => box.checked)"""


def test_keys_pan_zoom_fit_pin_measure_and_choose_layers(browser, pages):
    browser.show(pages(small()))
    start = browser.view()
    browser.press("+ + ArrowRight ArrowUp")
    now = browser.view()
    assert now["scale"] == pytest.approx(start["scale"] * 2.25)
    step = 60 / now["scale"]
    assert (now["x"], now["y"]) == pytest.approx((start["x"] + step, start["y"] + step))
    browser.press("p")
    assert browser.state()["pinned"] == pytest.approx([now["x"], now["y"]])
    browser.press("m ArrowLeft Enter")
    assert browser.texts("#status") == [f"Measured {step:.3f} m: dx \u2212{step:.3f}, dy 0.000."]
    browser.press("f")
    assert browser.view()["scale"] == pytest.approx(start["scale"])
    browser.press("Escape")
    assert browser.state().get("pinned") is None
    browser.press("1")
    assert browser.evaluate(BOXES) == [False, False, True]
    assert browser.complaints == []


def test_a_click_in_the_list_goes_there(browser, pages):
    browser.show(pages(small()))
    middle = (np.array(CENTRE) + CORNER) / 2
    for number, tone, place in ((0, "warning", CORNER), (1, "error", middle)):
        browser.click(f"[data-item='{number}']")
        assert (browser.view()["x"], browser.view()["y"]) == pytest.approx(tuple(place), abs=1e-3)
        assert browser.state()["selected"]["tone"] == tone
        (current,) = browser.texts("[aria-current=true]")
        assert current.startswith(f"{tone} {ITEMS[number].text}")


@pytest.mark.thorough
def test_two_layers_are_compared_by_a_slider_and_by_blinking(browser, pages):
    report = Report("compare", (Entry("both", LAYERS, compared=("occupancy", "cost")),), "1.0")
    browser.show(pages(report), hash_="#entry-0/1.5,9.25,40")
    assert [browser.view()[name] for name in ("x", "y", "scale")] == [1.5, 9.25, 40]
    assert browser.evaluate("() => document.getElementById('divider').checkVisibility()")
    free = next(
        (row, col) for row in range(100, 400) for col in range(300, 400)
        if GRID.occupancy[row, col] == FREE and 253 > COSTS.cost[row, col] > 100
    )  # fmt: skip
    place = GRID.frame.xy_from_rowcol([free])[0].tolist()
    browser.press("+")
    browser.go(place)
    for value, layer in (("100", 0), ("0", 2), ("100", 0)):
        browser.fill("#divider", value)
        expected = colour_of(LAYERS[layer], place)
        assert browser.pixel(place, expected.__eq__) == expected
    browser.click("[value=blink]")
    blinks = "() => document.querySelector('[value=blink]').checked"
    assert browser.evaluate(blinks)
    browser.press("Escape")
    assert not browser.evaluate(blinks)
    assert browser.complaints == []


NAMES = """() => [...document.querySelectorAll("#maps tbody tr")]
  .filter((row) => !row.hidden).map((row) => row.querySelector("a").textContent)"""
HEAD = """(name) => [...document.querySelectorAll("#maps th button")]
  .find((one) => one.textContent === name).click()"""
SHOWN = """() => [...document.querySelectorAll("main > section")]
  .filter((one) => !one.hidden).map((one) => one.id)"""


def test_the_table_sorts_filters_and_opens(browser, pages):
    path = pages(several())
    browser.open(path)
    assert browser.evaluate(NAMES) == ["bad", "b10", "b9", "a"]  # what failed is first
    assert not browser.evaluate("() => document.getElementById('map').checkVisibility()")
    sorts = "() => [...document.querySelectorAll('#maps thead th')].map((one) => one.ariaSort)"
    for head, names, sort in (
        ("Free", ["b9", "b10", "a", "bad"], "ascending"),
        ("Free", ["a", "b10", "b9", "bad"], "descending"),
        ("Map", ["a", "b9", "b10", "bad"], "ascending"),
    ):
        browser.evaluate(HEAD, head)
        assert (browser.evaluate(NAMES), browser.evaluate(sorts).count(sort)) == (names, 1)
    browser.fill("#filter", "b1 CHECKED")
    assert browser.evaluate(NAMES) == ["b10"]
    assert browser.texts("#count") == ["1 of 4 maps"]
    browser.click("#maps tbody a[href='#entry-0']")
    browser.settle()
    assert browser.evaluate(SHOWN) == ["entry-0"]
    browser.evaluate("() => { location.hash = '#maps'; }")
    assert in_time(lambda: browser.evaluate(SHOWN), ["maps"].__eq__) == ["maps"]
    assert_quiet(browser, path)


def test_names_with_markup_are_shown_and_never_run(browser, pages):
    path = pages(nasty_report())
    browser.open(path)
    assert browser.evaluate(NAMES)[:2] == list(ATTACKS[:2])
    for number in range(3):
        browser.click(f"#maps tbody a[href='#entry-{number}']")
        browser.settle()
    assert browser.evaluate("() => document.images.length") == 0
    assert browser.evaluate("() => document.title") == ATTACKS[1]
    assert_quiet(browser, path)


def test_the_policy_refuses_scripts_styles_and_requests(chromium, pages):
    chromium.show(pages(small()))
    found = chromium.evaluate("""async () => {
      const broken = [];
      const hear = (event) => broken.push(event.effectiveDirective);
      document.addEventListener("securitypolicyviolation", hear);
      const script = document.createElement("script"), style = document.createElement("style");
      const image = new Image();
      script.textContent = "window.ran = true";
      style.textContent = "* { color: red }";
      document.body.append(script, style);
      image.src = "https://example.invalid/a.gif";
      await fetch("https://example.invalid/").catch(() => 0);
      await new Promise((done) => setTimeout(done, 100));
      return [broken.sort(), window.ran ?? null];
    }""")
    assert found == [["connect-src", "img-src", "script-src-elem", "style-src-elem"], None]


def test_a_mouse_drags_zooms_at_the_pointer_pins_and_measures(chromium, pages):
    chromium.show(pages(small()))
    mouse, before = chromium.page.mouse, chromium.view()
    box = chromium.page.locator("#map").bounding_box()
    sx, sy = box["x"] + 301, box["y"] + 201

    def under(view, px, py):
        return (
            view["x"] + (px - box["x"] - 1 - view["width"] / 2) / view["scale"],
            view["y"] - (py - box["y"] - 1 - view["height"] / 2) / view["scale"],
        )

    mouse.move(sx, sy)
    mouse.wheel(0, -200)
    chromium.page.wait_for_timeout(50)
    after = chromium.view()
    assert after["scale"] > before["scale"] * 1.3
    assert under(after, sx, sy) == pytest.approx(under(before, sx, sy), abs=1e-6)
    mouse.down()
    mouse.move(sx + 40, sy + 30, steps=4)
    mouse.up()
    after = chromium.view()
    assert under(after, sx + 40, sy + 30) == pytest.approx(under(before, sx, sy), abs=0.05)
    assert chromium.state().get("pinned") is None
    mouse.click(sx, sy)
    assert chromium.state()["pinned"] == pytest.approx(under(after, sx, sy))
    chromium.click("[name=measure]")
    mouse.click(sx, sy)
    mouse.click(sx + 60, sy)
    (status,) = chromium.texts("#status")
    assert status.startswith(f"Measured {60 / after['scale']:.3f} m")


@pytest.mark.thorough
def test_two_fingers_zoom_between_them(chromium, pages):
    chromium.show(pages(small()), width=390, height=844, phone=True)
    before, box = chromium.view(), chromium.page.locator("#map").bounding_box()
    touch = chromium.page.context.new_cdp_session(chromium.page)
    x, y = (box[a] + 1 + before[size] / 2 for a, size in (("x", "width"), ("y", "height")))
    for kind, apart in [("touchStart", 30), ("touchMove", 60), ("touchMove", 90), ("touchEnd", 0)]:
        fingers = [{"x": x + sign * apart, "y": y, "id": sign} for sign in (-1, 1) if apart]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})
    chromium.page.wait_for_timeout(100)
    after = chromium.view()
    assert after["scale"] == pytest.approx(3 * before["scale"], rel=0.01)
    assert (after["x"], after["y"]) == pytest.approx((before["x"], before["y"]), abs=0.2)
    assert chromium.state().get("pinned") is None
    # and a screen of two pixels a point is sharp
    shape = "() => ['width', 'clientWidth'].map((name) => document.getElementById('map')[name])"
    pixels, points = chromium.evaluate(shape)
    assert pixels == 2 * points


def test_the_list_can_hide_kinds(chromium, pages):
    chromium.show(pages(small()))
    chromium.click("[data-item='2']")
    goal = chromium.pixel(CENTRE)
    chromium.click(".kinds [value=goal]")
    assert chromium.pixel(CENTRE, goal.__ne__) != goal


@pytest.mark.parametrize(("make", "look"), [
    (small, {}),
    (several, {"dark": True, **PHONE}),
    *[pytest.param(make, look, marks=pytest.mark.thorough)
      for make in (small, several) for look in ({"dark": True}, PHONE)],
    pytest.param(several, {}, marks=pytest.mark.thorough),
])  # fmt: skip
def test_axe_finds_nothing_serious(chromium, pages, make, look):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    chromium.open(pages(make()), **look)
    if make is small:
        chromium.settle()
    found = axe.run(chromium.page).response["violations"]
    bad = {violation["id"]: [node["html"] for node in violation["nodes"]][:3] for violation in found
           if violation["impact"] in ("serious", "critical")}  # fmt: skip
    assert bad == {}
    assert chromium.page.evaluate("document.documentElement.scrollWidth") <= look.get("width", 1400)


HALL = [(-4.3, 16.2), (6.4, 17.1), (5.2, 26.3), (-3.1, 25.4)]
TRIANGLE = [(0, 8), (3, 8), (1, 12)]
SCREEN = """([x, y]) => {
  const { view } = mapdeal.state(), box = document.getElementById("map").getBoundingClientRect();
  return [box.left + 1 + view.width / 2 + (x - view.x) * view.scale,
          box.top + 1 + view.height / 2 - (y - view.y) * view.scale];
}"""
ZONES = "() => mapdeal.state().zones.map((zone) => [zone.kind, zone.speed, zone.name, zone.rings])"


def drawn_zone(browser, points, *, tap=False):
    """Draw a polygon by clicks or taps; the last one is on the first corner."""
    for x, y in [*points, points[0]]:
        place = browser.evaluate(SCREEN, [x, y])
        (browser.page.touchscreen.tap if tap else browser.page.mouse.click)(*place)


@pytest.mark.parametrize("phone", [False, True])
def test_zones_are_drawn_saved_and_drawn_into_a_map(chromium, pages, tmp_path, phone):
    chromium.show(pages(small()), **(PHONE if phone else {}))
    chromium.evaluate("() => document.getElementById('viewer').scrollIntoView()")
    chromium.click("[name=draw]")
    drawn_zone(chromium, HALL, tap=phone)
    chromium.fill("#zones [name=name]", "<b>hall</b>")
    (zone,) = chromium.evaluate(ZONES)
    assert zone[:3] == ["keepout", None, "<b>hall</b>"]
    near = 1.0 if phone else 0.1  # pixels are larger there
    assert np.allclose(zone[3][0], HALL, atol=near)
    with chromium.page.expect_download() as download:
        chromium.page.get_by_text("Save 1 keepout zone").click()
    assert download.value.suggested_filename == "scattered_keepout.geojson"
    saved = tmp_path / "zones.geojson"
    download.value.save_as(saved)
    (shape,) = mapdeal.read_shapes(saved)
    assert shape.value == 100
    assert np.allclose(shape.points_xy, zone[3][0], atol=1e-4)  # counterclockwise as it was drawn
    mask = mapdeal.draw(mapdeal.blank(GRID, -1), [shape])
    area = np.count_nonzero(mask.occupancy == 100) * GRID.resolution**2
    shown = float(chromium.texts("#zones li")[0].split(", ")[1][:-3])
    assert area == pytest.approx(shown, rel=0.02)
    assert chromium.complaints == []
    # and they come back on a page, where they can be changed
    mapdeal.write_map(tmp_path / "map.yaml", GRID)
    report = mapdeal.write_report(tmp_path / "again.html", [tmp_path / "map.yaml", saved])
    chromium.show(report.path)
    (again,) = chromium.evaluate(ZONES)
    assert again[:3] == zone[:3]
    assert np.allclose(again[3][0], zone[3][0], atol=1e-4)
    assert "<b>hall</b>: keepout zone" in chromium.texts("[data-item]")[0]


def test_zones_by_keys_undo_delete_and_what_crosses_itself(browser, pages):
    browser.show(pages(small()))
    browser.press("z Enter ArrowRight Enter ArrowUp Enter ArrowLeft Enter")
    assert len(browser.state()["ring"]) == 4
    browser.press("u")
    assert len(browser.state()["ring"]) == 3
    browser.press("c")
    ((kind, _, _, [points]),) = browser.evaluate(ZONES)
    step = 60 / browser.view()["scale"]
    assert kind == "keepout"
    assert np.allclose(np.diff(points, axis=0), [[step, 0], [0, step]])
    browser.fill("#zones [name=kind]", "speed")
    browser.fill("#zones [name=speed]", "0.3")
    assert browser.evaluate(ZONES)[0][:2] == ["speed", 0.3]
    assert '"speed":0.3' in browser.evaluate("() => mapdeal.geojson()")
    browser.press("Delete")
    assert browser.evaluate(ZONES) == []
    browser.press("u")
    assert len(browser.evaluate(ZONES)) == 1
    # an hourglass
    browser.press("Enter ArrowRight Enter ArrowUp ArrowLeft Enter ArrowRight Enter c")
    assert browser.texts("#status") == ["The outline crosses itself: undo a corner."]
    browser.press("Escape")
    assert browser.state().get("ring") is None
    assert browser.complaints == []


def test_a_corner_of_a_zone_can_be_dragged(chromium, pages):
    chromium.show(pages(small()))
    chromium.click("[name=draw]")
    drawn_zone(chromium, TRIANGLE)
    before, mouse = chromium.view(), chromium.page.mouse
    mouse.move(*chromium.evaluate(SCREEN, TRIANGLE[1]))
    mouse.down()
    mouse.move(*chromium.evaluate(SCREEN, [5.0, 9.0]), steps=4)
    mouse.up()
    (zone,) = chromium.evaluate(ZONES)
    assert np.allclose(zone[3][0], [TRIANGLE[0], (5.0, 9.0), TRIANGLE[2]], atol=0.1)
    assert chromium.view() == before  # and the map has not moved
    chromium.click("[data-action=undo]")
    (zone,) = chromium.evaluate(ZONES)
    assert np.allclose(zone[3][0], TRIANGLE, atol=0.1)


RING = [[0, 8], [3, 8], [1, 12], [0, 8]]


def features(*rings, kind="keepout", geometry="Polygon", **properties):
    shape = {"type": geometry, "coordinates": list(rings)}
    feature = {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": shape}
    return json.dumps({"type": "FeatureCollection", "features": [feature]})


def bare(**feature):
    return json.dumps({"features": [feature]})


POLYGON = {"type": "Polygon", "coordinates": [RING]}


GOOD_ZONES = [
    (features(RING, kind="binary", name=5), ["binary", None, "5"]),
    (features(RING, kind="speed", speed=40, name="slow"), ["speed", 40, "slow"]),
    (features(RING, kind="keepout", speed=40, name=["odd"]), ["keepout", None, ""]),
    (features(RING, kind=None), ["keepout", None, ""]),
    (bare(geometry=POLYGON), ["keepout", None, ""]),
    (bare(geometry=POLYGON, properties=None), ["keepout", None, ""]),
    (bare(geometry=POLYGON, properties={"speed": 20}), ["speed", 20, ""]),
]  # fmt: skip


def test_files_of_zones_are_opened(chromium, pages, tmp_path):
    chromium.show(pages(small()))
    for k, (text, _) in enumerate(GOOD_ZONES):
        zones = [zone for _, zone in GOOD_ZONES[: k + 1]]
        assert opened_zones(chromium, text, tmp_path) == ("f.geojson: 1 zone.", zones)


OF_TWO = "must have points of two numbers in metres, got "
OF_FOUR = "must have rings of at least 4 points, of which the last repeats the first"
OF_KIND = "must be of the kind keepout, speed, binary, got "
OF_SPEED = "must have a speed above 0 and at most 100 percent, got "


NO_ZONES = [
    ("", "it is empty"),
    ("{", "it is not JSON"),
    ("image: m.pgm", "it is not JSON"),
    ("[]", "it is not a GeoJSON FeatureCollection"),
    ("null", "it is not a GeoJSON FeatureCollection"),
    (json.dumps(POLYGON), "it is not a GeoJSON FeatureCollection"),
    ('{"features": 3}', "it is not a GeoJSON FeatureCollection"),
    ('{"features": []}', "it has no features"),
    ('{"features": [null]}', "feature 1 has no geometry"),
    (bare(geometry=None), "feature 1 has no geometry"),
    (bare(geometry={"type": "GeometryCollection", "geometries": [POLYGON]}),
     'feature 1 must be a Polygon, got "GeometryCollection"'),
    (features(RING, geometry="MultiPolygon"), 'feature 1 must be a Polygon, got "MultiPolygon"'),
    (bare(geometry={"type": "Polygon"}), "feature 1 has no coordinates"),
    (bare(geometry={"type": "Polygon", "coordinates": "x"}), "feature 1 has no coordinates"),
    (features(), "feature 1 has no coordinates"),
    (features("wrong"), f"feature 1 {OF_FOUR}"),
    (features(RING[:3]), f"feature 1 {OF_FOUR}"),
    (features([[0, 1], ["a", 2], [1, 1], [0, 1]]), f'feature 1 {OF_TWO}["a",2]'),
    (features([[0, 1], None, [1, 1], [0, 1]]), f"feature 1 {OF_TWO}null"),
    (features([[0, 1], [1e300, 2], [1, 1], [0, 1]]), f"feature 1 {OF_TWO}[1e+300,2]"),
    (features(RING, kind="<i>odd"), f'feature 1 {OF_KIND}"<i>odd"'),
    (features(RING, kind={"a": 1}), f'feature 1 {OF_KIND}{{"a":1}}'),
    (features(RING, kind="speed", speed="x"), f'feature 1 {OF_SPEED}"x"'),
    (features(RING, kind="speed", speed="40"), f'feature 1 {OF_SPEED}"40"'),
    (features(RING, kind="speed", speed=0), f"feature 1 {OF_SPEED}0"),
    (features(RING, kind="speed", speed=101), f"feature 1 {OF_SPEED}101"),
    (features([[k, k % 7] for k in range(5002)]), "it has more than 5000 corners"),
    (" " * 20_000_001, "it is larger than 20 MB"),
]  # fmt: skip


def test_files_that_hold_other_things_than_zones_are_refused(chromium, pages, tmp_path):
    chromium.show(pages(small()))
    for text, reason in NO_ZONES:
        line = f"f.geojson was not opened: {reason}."
        assert opened_zones(chromium, text, tmp_path) == (line, [])


def opened_zones(chromium, text, folder):
    chromium.evaluate("() => { document.getElementById('status').textContent = ''; }")
    (folder / "f.geojson").write_text(text)
    chromium.page.locator("#zones [type=file]").set_input_files(folder / "f.geojson")
    chromium.page.wait_for_function("() => document.getElementById('status').textContent")
    assert chromium.complaints == []
    return chromium.texts("#status")[0], [zone[:3] for zone in chromium.evaluate(ZONES)]


def test_a_speed_zone_is_saved_with_its_limit_alone(chromium, pages, tmp_path):
    chromium.show(pages(small()))
    chromium.press("z Enter ArrowRight Enter ArrowUp Enter c")
    chromium.fill("#zones [name=kind]", "speed")
    for value in ("", "0", "101"):
        chromium.fill("#zones [name=speed]", value)
        chromium.page.get_by_text("Save 1 speed zone").click()
        (line,) = chromium.texts("#status")
        assert line == "Not saved: a speed zone needs a speed above 0 and at most 100 percent."
    chromium.fill("#zones [name=speed]", "40")
    assert "speed 40 %" in chromium.texts("#zones li")[0]
    with chromium.page.expect_download() as download:
        chromium.page.get_by_text("Save 1 speed zone").click()
    download.value.save_as(tmp_path / "zones.geojson")
    (zone,) = read_zones(tmp_path / "zones.geojson")
    assert (zone.kind, zone.speed) == ("speed", 40)


def noted(checks):
    """Return a page with 20 places of a note of each check, the first at the centre of the map."""
    steps = np.linspace(0, 1, 20)[:, np.newaxis]
    places = np.array(CENTRE) + steps * (np.array(CORNER) - np.array(CENTRE))
    items = [
        Item("finding", f"{check}: place {k + 1} of 20", "note", (x, y), group=f"note {check}")
        for check in checks for k, (x, y) in enumerate(places.tolist())
    ]  # fmt: skip
    blank = mapdeal.OccupancyGrid(np.zeros_like(GRID.occupancy), GRID.resolution, GRID.origin)
    claims = (Claim("map", "good", "The map is sound"),)
    entry = Entry("noted", page_layers(blank, "map", "Map"), tuple(items), claims=claims)
    return Report(f"noted {checks}", (entry,), "1.0")


def test_notes_are_on_the_map_while_their_line_of_the_list_is_open(browser, pages):
    browser.show(pages(noted("a")))
    assert browser.pixel(CENTRE, lambda colour: colour == [255] * 3) == [255] * 3
    browser.click(".items summary")
    blue = [0x0B, 0x57, 0xC0]
    assert browser.pixel(CENTRE, lambda colour: colour == blue) == blue
    browser.click(".items summary")
    assert browser.pixel(CENTRE, lambda colour: colour == [255] * 3) == [255] * 3
    assert browser.complaints == []


def test_notes_of_many_checks_are_one_line(chromium, pages):
    chromium.show(pages(noted("abcd")))
    visible = "() => [...document.querySelectorAll('.items summary')].filter((e) => e.checkVisibility()).map((e) => e.textContent)"  # noqa: E501
    assert chromium.evaluate(visible) == ["4 notes"]
    chromium.click(".items summary")
    assert len(chromium.evaluate(visible)) == 5
    # each line has its own places
    assert chromium.pixel(CENTRE, lambda colour: colour == [255] * 3) == [255] * 3


def test_a_page_counts_as_loaded_when_its_map_is_drawn(browser, pages):
    browser.open(pages(small()))  # which waits for the event load
    assert browser.evaluate("() => performance.getEntriesByName('mapdeal').length") > 0
    assert browser.evaluate("() => document.querySelectorAll('iframe').length") == 0


def test_the_first_sheet_of_paper_has_verdict_and_map(chromium, pages, tmp_path):
    entry = replace(noted("abcd").entries[0], warnings=tuple(f"warning {k}" for k in range(100)))
    chromium.show(pages(Report("printed", (entry,), "1.0")), width=718, height=1047)  # of A4
    chromium.page.emulate_media(media="print")
    chromium.page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    boxes = """() => [".verdict", "#map"].map((css) => {
      const box = document.querySelector(css).getBoundingClientRect();
      return [box.top + scrollY, box.bottom + scrollY, box.width / box.height];
    })"""
    verdict, canvas = chromium.evaluate(boxes)
    assert 0 < verdict[0] < verdict[1] <= canvas[0] < canvas[1] < 1047
    fits = chromium.evaluate("() => getComputedStyle(document.getElementById('map')).objectFit")
    assert fits == "contain"  # not stretched to the width of the paper
    assert chromium.evaluate("() => document.querySelectorAll('.notes[open]').length") == 0
    chromium.page.emulate_media(media="screen")


@pytest.mark.skipif(shutil.which("pdfimages") is None, reason="needs poppler-utils")
def test_the_first_page_of_a_pdf_has_verdict_and_map(chromium, pages, tmp_path):
    path = tmp_path / "page.pdf"
    chromium.open(pages(noted("abcd")))
    chromium.page.pdf(path=path)
    text, images = (
        subprocess.run(command, check=True, capture_output=True).stdout
        for command in (["pdftotext", "-l", "1", path, "-"], ["pdfimages", "-list", path])
    )
    assert b"The map is sound" in text
    assert b"1" in [line.split()[0] for line in images.splitlines()[2:]]  # the page of each


def test_a_page_is_left_without_a_question_unless_zones_are_not_saved(chromium, pages):
    chromium.show(pages(small()))
    questions = []
    chromium.page.on("dialog", lambda dialog: (questions.append(dialog.type), dialog.accept()))
    for is_saved in (True, False):
        for key in ("z", "Enter", "ArrowRight", "Enter", "ArrowUp", "Enter", "c"):
            chromium.page.locator("#map").press(key)
        if is_saved:
            with chromium.page.expect_download():
                chromium.page.get_by_text("Save 1 keepout zone").click()
        chromium.page.reload()
        assert questions == ([] if is_saved else ["beforeunload"])
        chromium.settle()
    chromium.complaints.clear()  # the browser reports the question as a complaint


def test_side_by_side_shows_the_same_place_twice(chromium, pages):
    entry = Entry("both", LAYERS, compared=("occupancy", "cost"), opens_swiped=False)
    chromium.show(pages(Report("beside", (entry,), "1.0")))
    assert not chromium.evaluate("() => document.getElementById('divider').checkVisibility()")
    width = chromium.view()["width"]
    chromium.click("[value=beside]")
    assert chromium.view()["width"] == pytest.approx(width / 2)
    chromium.go(CENTRE)
    box = chromium.page.locator("#map").bounding_box()
    look = """(k) => {
      const canvas = document.getElementById("map"), { width, height } = mapdeal.state().view;
      const [x, y] = [(k + 0.5) * width, height / 2 - 4];
      const ratio = canvas.width / canvas.clientWidth;
      return [...canvas.getContext("2d").getImageData(x * ratio, y * ratio, 1, 1).data].slice(0, 3);
    }"""
    for k, layer in enumerate((LAYERS[0], LAYERS[2])):
        colour = colour_of(layer, CENTRE)
        assert in_time(lambda k=k: chromium.evaluate(look, k), colour.__eq__, 2) == colour
        # a click in either half pins the same place
        chromium.page.mouse.click(box["x"] + 1 + (k + 0.5) * width / 2, box["y"] + 1 + 100)
        assert chromium.state()["pinned"][0] == pytest.approx(chromium.view()["x"], abs=0.02)


def test_evidence_is_a_click_away_and_values_stand_with_the_map(chromium, pages):
    table = Table("Robot", (("radius", "0.3"),))
    claims = (Claim("costmap", "good", "own", "Robot"), Claim("map", "error", "bad", "finding"))
    entry = Entry("claimed", LAYERS, ITEMS, (Table("Run", ()), table), claims=claims)
    chromium.show(pages(Report("claims", (entry,), "1.0")), **PHONE)
    details = "() => [...document.querySelectorAll('details')].map((element) => element.open)"
    assert chromium.evaluate(details) == [False, False]
    chromium.page.get_by_role("link", name="Robot").click()
    opened = [False, True]
    assert in_time(lambda: chromium.evaluate(details), opened.__eq__) == opened
    assert chromium.page.get_by_role("cell", name="0.3").is_visible()
    chromium.page.get_by_role("link", name="Findings").click()
    map_, values = (
        chromium.page.locator(selector).bounding_box() for selector in ("#map", ".readout")
    )
    assert 0 < values["y"] - map_["y"] - map_["height"] < 60
    assert chromium.texts(".readout tbody th")[2:] == [layer.title for layer in LAYERS]
