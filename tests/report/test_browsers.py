"""The page in real browsers, against what the library says of the same grids."""

import numpy as np
import pytest

import mapdeal
from mapdeal.report.document import Claim, Entry, Item, Report, Table, page_layers
from mapdeal.report.page import page_of
from report import browsers
from report.made import entry_of, layers_of
from report.test_page import ATTACKS, nasty_report

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
PHONE = {"width": 360, "height": 780, "phone": True}


def scattered(shape, seed, origin=(-3.1, 2.2, 0.6), resolution=0.07):
    """Return a map with a few obstacles and unknown cells, turned and off the origin."""
    values = np.random.default_rng(seed).choice(
        [FREE, OCCUPIED, UNKNOWN], shape, p=[0.985, 0.01, 0.005]
    )
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
    """Return a function that writes a page and returns its path; the same page is written once."""
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
            known[name] = browsers.started(name, tmp_path_factory.mktemp(name))
        return known[name]

    yield of
    for started in known.values():
        started.close()


@pytest.fixture(params=["chromium", pytest.param("firefox", marks=pytest.mark.thorough)])
def browser(request, running):
    return running(request.param)


@pytest.fixture
def chromium(running):
    return running("chromium")


def one():
    curve = mapdeal.cost_curve(0.07, inscribed_radius=0.2, inflation_radius=0.8)
    tables = (Table("Figures", (("cells", "371000"),)),)
    entry = Entry("scattered", LAYERS, ITEMS, tables, ("one warning",), curve=curve)
    return Report("scattered", (entry,), "1.0")


def several():
    sizes = {"b10": 10.0, "b9": 9.0, "a": 200.0}
    entries = [
        entry_of(scattered((40, 50), k), name, figures={"free": size}, status="done")
        for k, (name, size) in enumerate(sizes.items())
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
    path = pages(one())
    browsers.show(browser, path)
    points = points_of(GRID.frame, 400, 5)
    told = browser.evaluate(READ_ALL, points.tolist())
    distance, gradient, inside = FIELD.query(points)
    cells, _ = GRID.frame.bounded_rowcol_from_xy(points)
    assert 0 < np.count_nonzero(~inside) < 100
    for k, (states, metres, cost) in enumerate(told):
        if not inside[k]:
            assert [states["cell"], metres["cell"], cost["cell"]] == [None] * 3
            continue
        row, col = cells[k].tolist()
        assert states["cell"] == metres["cell"] == cost["cell"] == [row, col]
        assert states["value"] == int(GRID.occupancy[row, col]) % 256
        assert cost["value"] == COSTS.cost[row, col]
        assert metres["value"] == pytest.approx(distance[k], abs=1e-6)
        assert metres["gradient"] == pytest.approx(gradient[k].tolist(), abs=1e-4)
    assert {states["label"] for states, _, _ in told if states["cell"]} == {
        "free", "occupied", "unknown",
    }  # fmt: skip
    assert_quiet(browser, path)


@pytest.mark.thorough
def test_distances_without_obstacles_are_infinite_and_have_no_gradient(browser, pages):
    grid = mapdeal.OccupancyGrid(np.zeros((3, 4), np.int8), 0.25, (1.0, 2.0, 0.3))
    browsers.show(browser, pages(Report("empty", (entry_of(grid),), "1.0")))
    point = grid.frame.xy_from_rowcol([[1, 2]])[0].tolist()
    ((_, found, _),) = browser.evaluate(READ_ALL, [point])
    assert found["value"] == "Infinity"
    assert "gradient" not in found
    assert found["text"] == "\u221e m"


@pytest.mark.thorough
def test_a_page_from_which_the_finest_level_is_left_out_says_so(browser, tmp_path):
    path = tmp_path / "small.html"
    path.write_bytes(b"".join(page_of(one(), size=20_000)))
    browsers.show(browser, path)
    ((states, metres, _),) = browser.evaluate(READ_ALL, [CENTRE])
    reduce = metres["reduce"]
    assert reduce > 1
    row, col = (int(one) // reduce * reduce for one in (265, 350))
    block = np.s_[row : row + reduce, col : col + reduce]
    assert metres["value"] == pytest.approx(float(FIELD.distance[block].min()), abs=1e-3)
    assert "gradient" not in metres
    assert f"smallest of {reduce} \u00d7 {reduce} cells" in metres["text"]
    assert f"largest of {reduce} \u00d7 {reduce} cells" in states["text"]


PIXEL = """([x, y]) => {
  const canvas = document.getElementById("map"), { view } = mapdeal.state();
  const sx = view.width / 2 + (x - view.x) * view.scale;
  const sy = view.height / 2 - (y - view.y) * view.scale;
  const [px, py] = [sx, sy].map((one) => Math.floor((one * canvas.width) / view.width));
  return [...canvas.getContext("2d").getImageData(px, py, 1, 1).data];
}"""


def test_pixels_have_the_colour_of_their_cell(browser, pages):
    small = mapdeal.OccupancyGrid(scattered((9, 13), 3).occupancy, 0.3, (2.0, -1.0, 2.5))
    browsers.show(browser, pages(Report("pixels", (entry_of(small),), "1.0")))
    layers, _, costs = layers_of(small)
    style = layers[-1].style
    for row, col in [(0, 0), (0, 12), (8, 0), (8, 12), (4, 6), (2, 9)]:
        centre = small.frame.xy_from_rowcol([[row, col]])[0].tolist()
        expected = style.colours[style.by_value[costs.cost[row, col]]].tolist()
        if (row, col) != (0, 0):  # where the scale bar may lie
            assert browser.evaluate(PIXEL, centre) == [*expected, 255], (row, col)


@pytest.mark.thorough
def test_layers_of_different_frames_lie_where_they_belong(chromium, pages):
    lower = scattered((20, 30), 4, (1.0, -2.0, 0.3), 0.5)
    upper = scattered((9, 13), 5, (5.0, 2.0, -0.5), 0.2)
    below, above = layers_of(lower)[0][0], layers_of(upper)[0][2]
    browsers.show(chromium, pages(Report("frames", (Entry("frames", (below, above)),), "1.0")))
    inner = points_of(upper.frame, 12, 6)[:8]
    inner = upper.frame.xy_from_rowcol(upper.frame.clamped_rowcol_from_xy(inner))
    outer = [lower.frame.xy_from_rowcol([cell])[0] for cell in ([1, 1], [18, 28], [2, 27])]
    seen = set()
    for point in [*inner, *outer]:
        layer = above if upper.frame.contains([point])[0] else below
        seen.add(layer.name)
        row, col = layer.frame.bounded_rowcol_from_xy([point])[0][0].tolist()
        colour = layer.style.colours[layer.style.by_value[layer.values[row, col]]].tolist()
        assert chromium.evaluate(PIXEL, point.tolist()) == [*colour, 255]
    assert seen == {"occupancy", "cost"}


@pytest.mark.thorough
def test_the_rim_of_a_wall_is_red_where_a_tile_ends(chromium, pages):
    cells = np.zeros((9, 700), np.int8)
    cells[:, 505:512] = 100  # its free neighbours are in the next tile, and its field is 0 there
    grid = mapdeal.OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.3))
    field = mapdeal.esdf(grid)
    assert field.distance[4, 511] == 0
    browsers.show(
        chromium, pages(Report("rim", (Entry("rim", tuple(page_layers(field, "f", "F"))),), "1"))
    )
    place = grid.frame.xy_from_rowcol([[4, 511]])[0].tolist()
    chromium.evaluate("([x, y]) => { location.hash = `#entry-0/${x},${y},40`; }", place)
    is_red = lambda pixel: pixel[0] > pixel[2] + 20  # noqa: E731
    assert is_red(browsers.pixel_in_time(chromium, PIXEL, place, is_red))


@pytest.mark.thorough
def test_an_opacity_of_a_half_mixes_two_layers(chromium, pages):
    browsers.show(chromium, pages(one()))
    chromium.evaluate("""() => {
      const slider = document.querySelector(".layer [type=range]");
      slider.value = 50;
      slider.dispatchEvent(new Event("input", { bubbles: true }));
    }""")
    chromium.evaluate("([x, y]) => { location.hash = `#entry-0/${x},${y},300`; }", CORNER)
    row, col = GRID.frame.bounded_rowcol_from_xy([CORNER])[0][0].tolist()
    aside = GRID.frame.xy_from_rowcol([[row, col + 2]])[0]  # beside the mark of a finding
    colours = [
        layer.style.colours[layer.style.by_value[layer.values[row, col + 2]]].astype(int)
        for layer in (LAYERS[0], LAYERS[2])
    ]
    assert abs(colours[0] - colours[1]).max() > 20
    expected = pytest.approx(((colours[0] + colours[1]) / 2).tolist(), abs=2)
    found = browsers.pixel_in_time(chromium, PIXEL, aside.tolist(), lambda one: one == expected)
    assert found == expected


KEY = """(key) => {
  const canvas = document.getElementById("map");
  canvas.focus();
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
}"""
VIEW = "() => mapdeal.state()"
TEXTS = "(selector) => [...document.querySelectorAll(selector)].map((one) => one.textContent)"
BOXES = """() => [...document.querySelectorAll(".layer [type=checkbox]")]
  .map((box) => box.checked)"""
CLICK = "(selector) => document.querySelector(selector).click()"


def test_keys_pan_zoom_fit_pin_measure_and_choose_layers(browser, pages):
    browsers.show(browser, pages(one()))
    start = browser.evaluate(VIEW)["view"]
    for key in ("+", "+", "ArrowRight", "ArrowUp"):
        browser.evaluate(KEY, key)
    now = browser.evaluate(VIEW)["view"]
    assert now["scale"] == pytest.approx(start["scale"] * 2.25)
    assert now["x"] == pytest.approx(start["x"] + 60 / now["scale"])
    assert now["y"] == pytest.approx(start["y"] + 60 / now["scale"])
    browser.evaluate(KEY, "p")
    assert browser.evaluate(VIEW)["pinned"] == pytest.approx([now["x"], now["y"]])
    browser.evaluate(KEY, "m")
    browser.evaluate(KEY, "ArrowLeft")
    browser.evaluate(KEY, "Enter")
    (status,) = browser.evaluate(TEXTS, "#status")
    length = 60 / now["scale"]
    assert status == f"Measured {length:.3f} m: dx \u2212{length:.3f}, dy 0.000."
    browser.evaluate(KEY, "f")
    assert browser.evaluate(VIEW)["view"]["scale"] == pytest.approx(start["scale"])
    browser.evaluate(KEY, "Escape")
    assert browser.evaluate(VIEW).get("pinned") is None
    browser.evaluate(KEY, "1")
    assert browser.evaluate(BOXES) == [False, False, True]
    assert browser.complaints == []


def test_a_click_in_the_list_goes_there(browser, pages):
    browsers.show(browser, pages(one()))
    browser.evaluate(CLICK, "[data-item='0']")
    state = browser.evaluate(VIEW)
    assert (state["view"]["x"], state["view"]["y"]) == pytest.approx(CORNER)
    assert browser.evaluate(TEXTS, "[aria-current=true]") == ["warning 3 lone cells"]
    assert state["selected"]["tone"] == "warning"
    browser.evaluate(CLICK, "[data-item='1']")
    state = browser.evaluate(VIEW)
    middle = (np.array(CENTRE) + CORNER) / 2
    assert (state["view"]["x"], state["view"]["y"]) == pytest.approx(middle.tolist(), abs=1e-3)


@pytest.mark.thorough
def test_two_layers_are_compared_by_a_slider_and_by_blinking(browser, pages):
    entry = Entry("both", LAYERS, compared=("occupancy", "cost"))
    report = Report("compare", (entry,), "1.0")
    browsers.show(browser, pages(report), hash_="#entry-0/1.5,9.25,40")
    view = browser.evaluate(VIEW)["view"]
    assert (view["x"], view["y"], view["scale"]) == (1.5, 9.25, 40)
    assert browser.evaluate("() => document.getElementById('divider').checkVisibility()")
    free = next(
        (row, col) for row in range(100, 400) for col in range(300, 400)
        if GRID.occupancy[row, col] == FREE and 253 > COSTS.cost[row, col] > 100
    )  # fmt: skip
    place = GRID.frame.xy_from_rowcol([free])[0].tolist()
    cost_colour = LAYERS[2].style.colours[LAYERS[2].style.by_value[COSTS.cost[free]]].tolist()
    slide = """async (value) => {
      const divider = document.getElementById("divider");
      divider.value = value;
      divider.dispatchEvent(new Event("input", { bubbles: true }));
      await new Promise((done) => page.setTimeout(() => done(), 50));
    }"""
    browser.evaluate(KEY, "+")
    go = "([x, y]) => { location.hash = `#entry-0/${x},${y},300`; }"
    browser.evaluate(go, place)
    seen = []
    for value in ("100", "0", "100"):
        browser.evaluate(slide, value)
        known = [255, 255, 255], cost_colour
        seen.append(browsers.pixel_in_time(browser, PIXEL, place, known.__contains__))
    assert seen == [[255, 255, 255], cost_colour, [255, 255, 255]]
    browser.evaluate(CLICK, "[value=blink]")
    blinks = "() => document.querySelector('[value=blink]').checked"
    assert browser.evaluate(blinks)
    browser.evaluate(KEY, "Escape")
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
    browser.evaluate(HEAD, "Free")
    assert browser.evaluate(NAMES) == ["b9", "b10", "a", "bad"]
    assert browser.evaluate(sorts).count("ascending") == 1
    browser.evaluate(HEAD, "Free")
    assert browser.evaluate(NAMES) == ["a", "b10", "b9", "bad"]
    assert browser.evaluate(sorts).count("descending") == 1
    browser.evaluate(HEAD, "Map")
    assert browser.evaluate(NAMES) == ["a", "b9", "b10", "bad"]
    write = """(text) => {
      const box = document.getElementById("filter");
      box.value = text;
      box.dispatchEvent(new Event("input", { bubbles: true }));
    }"""
    browser.evaluate(write, "b1 CHECKED")
    assert browser.evaluate(NAMES) == ["b10"]
    assert browser.evaluate(TEXTS, "#count") == ["1 of 4 maps"]
    browser.evaluate(CLICK, "#maps tbody a[href='#entry-0']")
    browsers.settle(browser)
    assert browser.evaluate(SHOWN) == ["entry-0"]
    browser.evaluate("() => { location.hash = '#maps'; }")
    browsers.pixel_in_time(browser, SHOWN, None, ["maps"].__eq__)
    assert browser.evaluate(SHOWN) == ["maps"]
    assert_quiet(browser, path)


def test_names_with_markup_are_shown_and_never_run(browser, pages):
    path = pages(nasty_report())
    browser.open(path)
    names = browser.evaluate(NAMES)
    assert names[:2] == list(ATTACKS[:2])
    for number in range(3):
        browser.evaluate(CLICK, f"#maps tbody a[href='#entry-{number}']")
        browsers.settle(browser)
    assert browser.evaluate("() => document.images.length") == 0
    assert browser.evaluate("() => document.title") == ATTACKS[1]
    assert_quiet(browser, path)


def test_the_policy_refuses_scripts_styles_and_requests(chromium, pages):
    browsers.show(chromium, pages(one()))
    found = chromium.evaluate("""async () => {
      const broken = [];
      const hear = (event) => broken.push(event.effectiveDirective);
      document.addEventListener("securitypolicyviolation", hear);
      const script = document.createElement("script"), style = document.createElement("style");
      const image = new Image();
      script.textContent = "window.ran = true";
      style.textContent = "* { color: red }";
      document.body.append(script, style);
      image.src = "data:image/gif;base64,R0lGODlhAQABAAAAACw=";
      await fetch("https://example.invalid/").catch(() => 0);
      await new Promise((done) => setTimeout(done, 100));
      return [broken.sort(), window.ran ?? null];
    }""")
    assert found == [["connect-src", "img-src", "script-src-elem", "style-src-elem"], None]


def test_a_mouse_drags_zooms_at_the_pointer_pins_and_measures(chromium, pages):
    browsers.show(chromium, pages(one()))
    mouse, box = chromium.page.mouse, chromium.page.locator("#map").bounding_box()
    sx, sy = box["x"] + 301, box["y"] + 201
    state = lambda: chromium.evaluate(VIEW)["view"]  # noqa: E731

    def under(view, px, py):
        return (
            view["x"] + (px - box["x"] - 1 - view["width"] / 2) / view["scale"],
            view["y"] - (py - box["y"] - 1 - view["height"] / 2) / view["scale"],
        )

    before = state()
    mouse.move(sx, sy)
    mouse.wheel(0, -200)
    chromium.page.wait_for_timeout(50)
    after = state()
    assert after["scale"] > before["scale"] * 1.3
    assert under(after, sx, sy) == pytest.approx(under(before, sx, sy), abs=1e-6)
    mouse.down()
    mouse.move(sx + 40, sy + 30, steps=4)
    mouse.up()
    assert under(state(), sx + 40, sy + 30) == pytest.approx(under(before, sx, sy), abs=0.05)
    assert chromium.evaluate(VIEW).get("pinned") is None
    mouse.click(sx, sy)
    assert chromium.evaluate(VIEW)["pinned"] == pytest.approx(under(state(), sx, sy))
    chromium.evaluate(CLICK, "[name=measure]")
    mouse.click(sx, sy)
    mouse.click(sx + 60, sy)
    (status,) = chromium.evaluate(TEXTS, "#status")
    assert status.startswith(f"Measured {60 / state()['scale']:.3f} m")


@pytest.mark.thorough
def test_two_fingers_zoom_between_them(chromium, pages):
    browsers.show(chromium, pages(one()), width=390, height=844, phone=True)
    before, box = chromium.evaluate(VIEW)["view"], chromium.page.locator("#map").bounding_box()
    touch = chromium.page.context.new_cdp_session(chromium.page)
    middle = (box["x"] + 1 + before["width"] / 2, box["y"] + 1 + before["height"] / 2)
    for kind, apart in [("touchStart", 30), ("touchMove", 60), ("touchMove", 90), ("touchEnd", 0)]:
        fingers = [
            {"x": middle[0] + sign * apart, "y": middle[1], "id": k}
            for k, sign in enumerate((-1, 1))
        ]
        touch.send(
            "Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers if apart else []}
        )
    chromium.page.wait_for_timeout(100)
    after = chromium.evaluate(VIEW)["view"]
    assert after["scale"] == pytest.approx(3 * before["scale"], rel=0.01)
    assert (after["x"], after["y"]) == pytest.approx((before["x"], before["y"]), abs=0.2)
    assert chromium.evaluate(VIEW).get("pinned") is None
    # and a screen of two pixels a point is sharp
    shape = "() => ['width', 'clientWidth'].map((name) => document.getElementById('map')[name])"
    pixels, points = chromium.evaluate(shape)
    assert pixels == 2 * points


def test_the_list_can_hide_kinds(chromium, pages):
    browsers.show(chromium, pages(one()))
    chromium.evaluate(CLICK, "[data-item='2']")
    goal = chromium.evaluate(PIXEL, CENTRE)
    chromium.evaluate(CLICK, ".kinds [value=goal]")
    chromium.page.wait_for_timeout(100)
    assert chromium.evaluate(PIXEL, CENTRE) != goal


@pytest.mark.parametrize(("make", "look"), [
    (one, {}),
    (several, {"dark": True, **PHONE}),
    *[pytest.param(make, look, marks=pytest.mark.thorough)
      for make in (one, several) for look in ({"dark": True}, PHONE)],
    pytest.param(several, {}, marks=pytest.mark.thorough),
])  # fmt: skip
def test_axe_finds_nothing_serious(chromium, pages, make, look):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    chromium.open(pages(make()), **look)
    if make is one:
        browsers.settle(chromium)
    found = axe.run(chromium.page).response["violations"]
    bad = {one["id"]: [node["html"] for node in one["nodes"]][:3] for one in found
           if one["impact"] in ("serious", "critical")}  # fmt: skip
    assert bad == {}
    across = chromium.page.evaluate("document.documentElement.scrollWidth")
    assert across <= look.get("width", 1400)


POINTS = {
    "hall": [(-4.0, 16.0), (6.0, 17.0), (5.0, 26.0), (-3.0, 25.0)],
    "b": [(0, 8), (3, 8), (1, 12)],
}
SCREEN = """([x, y]) => {
  const { view } = mapdeal.state(), box = document.getElementById("map").getBoundingClientRect();
  return [box.left + 1 + view.width / 2 + (x - view.x) * view.scale,
          box.top + 1 + view.height / 2 - (y - view.y) * view.scale];
}"""
TYPE = """([name, text]) => {
  const field = document.querySelector(`#zones [name=${name}]`);
  field.value = text;
  field.dispatchEvent(new Event("input", { bubbles: true }));
}"""
ZONES = (
    "() => mapdeal.state().zones.map(({ kind, speed, name, rings }) => [kind, speed, name, rings])"
)


def drawn_zone(browser, points, *, tap=False):
    """Draw a polygon by clicks or taps; the last one is on the first corner."""
    for x, y in [*points, points[0]]:
        place = browser.evaluate(SCREEN, [x, y])
        (browser.page.touchscreen.tap if tap else browser.page.mouse.click)(*place)


@pytest.mark.parametrize("phone", [False, True])
def test_zones_are_drawn_saved_and_drawn_into_a_map(chromium, pages, tmp_path, phone):
    browsers.show(chromium, pages(one()), **(PHONE if phone else {}))
    chromium.evaluate("() => document.getElementById('viewer').scrollIntoView()")
    chromium.evaluate(CLICK, "[name=draw]")
    drawn_zone(chromium, POINTS["hall"], tap=phone)
    chromium.evaluate(TYPE, ["name", "<b>hall</b>"])
    (zone,) = chromium.evaluate(ZONES)
    assert zone[:3] == ["keepout", None, "<b>hall</b>"]
    near = 1.0 if phone else 0.1  # pixels are larger there
    assert np.allclose(zone[3][0], POINTS["hall"], atol=near)
    with chromium.page.expect_download() as download:
        chromium.page.get_by_text("Save 1 keepout zone").click()
    assert download.value.suggested_filename == "scattered_keepout.geojson"
    saved = tmp_path / "zones.geojson"
    download.value.save_as(saved)
    (shape,) = mapdeal.read_shapes(saved)
    assert shape.value == 100
    assert np.allclose(shape.points_xy, zone[3][0], atol=1e-4)  # counterclockwise as it was drawn
    mask = mapdeal.draw(mapdeal.blank(GRID, -1), [shape])
    cells = np.argwhere(mask.occupancy == 100)
    area = len(cells) * GRID.resolution**2
    assert area == pytest.approx(
        float(chromium.evaluate(TEXTS, "#zones li")[0].split(", ")[1][:-3]), rel=0.02
    )
    assert chromium.complaints == []
    # and they come back on a page, where they can be changed
    path = tmp_path / "map.yaml"
    mapdeal.write_map(path, GRID)
    made = mapdeal.write_report(tmp_path / "again.html", [path, saved])
    browsers.show(chromium, made.path)
    (again,) = chromium.evaluate(ZONES)
    assert again[:3] == zone[:3]
    assert np.allclose(again[3][0], zone[3][0], atol=1e-4)
    assert "<b>hall</b>: keepout zone" in chromium.evaluate(TEXTS, "[data-item]")[0]


def test_zones_by_keys_undo_delete_and_what_crosses_itself(browser, pages):
    browsers.show(browser, pages(one()))
    for key in ("z", "Enter", "ArrowRight", "Enter", "ArrowUp", "Enter", "ArrowLeft", "Enter"):
        browser.evaluate(KEY, key)
    assert len(browser.evaluate(VIEW)["ring"]) == 4
    browser.evaluate(KEY, "u")
    assert len(browser.evaluate(VIEW)["ring"]) == 3
    browser.evaluate(KEY, "c")
    ((kind, _, _, [points]),) = browser.evaluate(ZONES)
    step = 60 / browser.evaluate(VIEW)["view"]["scale"]
    offsets = np.diff(points, axis=0)
    assert kind == "keepout"
    assert np.allclose(offsets, [[step, 0], [0, step]])
    browser.evaluate(TYPE, ["kind", "speed"])
    browser.evaluate(TYPE, ["speed", "0.3"])
    assert browser.evaluate(ZONES)[0][:2] == ["speed", 0.3]
    assert '"speed":0.3' in browser.evaluate("() => mapdeal.geojson()")
    browser.evaluate(KEY, "Delete")
    assert browser.evaluate(ZONES) == []
    browser.evaluate(KEY, "u")
    assert len(browser.evaluate(ZONES)) == 1
    # an hourglass
    for key in ("Enter", "ArrowRight", "Enter", "ArrowUp", "ArrowLeft", "Enter", "ArrowRight"):
        browser.evaluate(KEY, key)
    browser.evaluate(KEY, "Enter")
    browser.evaluate(KEY, "c")
    assert browser.evaluate(TEXTS, "#status") == ["The outline crosses itself: undo a corner."]
    browser.evaluate(KEY, "Escape")
    assert browser.evaluate(VIEW).get("ring") is None
    assert browser.complaints == []


def test_a_corner_of_a_zone_can_be_dragged(chromium, pages):
    browsers.show(chromium, pages(one()))
    chromium.evaluate(CLICK, "[name=draw]")
    drawn_zone(chromium, POINTS["b"])
    before = chromium.evaluate(VIEW)["view"]
    mouse = chromium.page.mouse
    mouse.move(*chromium.evaluate(SCREEN, POINTS["b"][1]))
    mouse.down()
    mouse.move(*chromium.evaluate(SCREEN, [5.0, 9.0]), steps=4)
    mouse.up()
    (zone,) = chromium.evaluate(ZONES)
    assert np.allclose(zone[3][0], [POINTS["b"][0], (5.0, 9.0), POINTS["b"][2]], atol=0.1)
    assert chromium.evaluate(VIEW)["view"] == before  # and the map has not moved
    chromium.evaluate(CLICK, "[data-action=undo]")
    (zone,) = chromium.evaluate(ZONES)
    assert np.allclose(zone[3][0], POINTS["b"], atol=0.1)


@pytest.mark.parametrize(("text", "told"), [
    (('{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"kind": '
     '"<i>odd", "speed": "x", "name": 5}, "geometry": {"type": "Polygon", "coordinates": '
     '[[[0, 8], [3, 8], [1, 12], [0, 8]]]}}]}'), "f.geojson: 1 zones."),
    ('{"features": [{"geometry": {"type": "Point", "coordinates": [[[0, 1]]]}}]}', "not opened"),
    (('{"features": [{"geometry": {"type": "Polygon", "coordinates": [[[0, 1], ["a", 2], [1, 1], '
     '[0, 1]]]}}]}'), "not opened"),
    ("[]", "not opened"),
    ("{", "not opened"),
])  # fmt: skip
def test_files_of_zones_are_opened_or_refused(chromium, pages, text, told):
    browsers.show(chromium, pages(one()))
    file = {"name": "f.geojson", "mimeType": "application/json", "buffer": text.encode()}
    chromium.page.locator("#zones [type=file]").set_input_files(file)
    chromium.page.wait_for_function("() => document.getElementById('status').textContent")
    assert told in chromium.evaluate(TEXTS, "#status")[0]
    zones = chromium.evaluate(ZONES)
    assert [zone[:3] for zone in zones] == ([] if "not" in told else [["<i>odd", None, "5"]])
    assert chromium.complaints == []


def test_a_page_is_left_without_a_question_unless_zones_are_not_saved(chromium, pages):
    browsers.show(chromium, pages(one()))
    questions = []
    chromium.page.on("dialog", lambda dialog: (questions.append(dialog.type), dialog.accept()))
    for key in ("z", "Enter", "ArrowRight", "Enter", "ArrowUp", "Enter", "c"):
        chromium.page.locator("#map").press(key)
    with chromium.page.expect_download():
        chromium.page.get_by_text("Save 1 keepout zone").click()
    chromium.page.reload()
    assert questions == []
    browsers.settle(chromium)
    for key in ("z", "Enter", "ArrowRight", "Enter", "ArrowUp", "Enter", "c"):
        chromium.page.locator("#map").press(key)
    chromium.page.reload()
    assert questions == ["beforeunload"]
    chromium.complaints.clear()  # the question is heard there, too


def test_side_by_side_shows_the_same_place_twice(chromium, pages):
    entry = Entry("both", LAYERS, compared=("occupancy", "cost"), opens_swiped=False)
    browsers.show(chromium, pages(Report("beside", (entry,), "1.0")))
    assert not chromium.evaluate("() => document.getElementById('divider').checkVisibility()")
    width = chromium.evaluate(VIEW)["view"]["width"]
    chromium.evaluate(CLICK, "[value=beside]")
    assert chromium.evaluate(VIEW)["view"]["width"] == pytest.approx(width / 2)
    chromium.evaluate("([x, y]) => { location.hash = `#entry-0/${x},${y},300`; }", CENTRE)
    box = chromium.page.locator("#map").bounding_box()
    colours = []
    row, col = GRID.frame.bounded_rowcol_from_xy([CENTRE])[0][0].tolist()
    for layer, values in ((LAYERS[0], GRID.occupancy.view(np.uint8)), (LAYERS[2], COSTS.cost)):
        colours.append(layer.style.colours[layer.style.by_value[values[row, col]]].tolist())
    look = """(k) => {
      const canvas = document.getElementById("map"), { width, height } = mapdeal.state().view;
      const [x, y] = [(k + 0.5) * width, height / 2 - 4];
      const ratio = canvas.width / canvas.clientWidth;
      return [...canvas.getContext("2d").getImageData(x * ratio, y * ratio, 1, 1).data];
    }"""
    for k, colour in enumerate(colours):
        assert browsers.pixel_in_time(chromium, look, k, colour.__eq__) == colour
    for k in range(2):  # a click in either half pins the same place
        chromium.page.mouse.click(box["x"] + 1 + (k + 0.5) * width / 2, box["y"] + 1 + 100)
        pinned = chromium.evaluate(VIEW)["pinned"]
        assert pinned[0] == pytest.approx(chromium.evaluate(VIEW)["view"]["x"], abs=0.02)


def test_evidence_is_a_click_away_and_values_stand_with_the_map(chromium, pages):
    table = Table("Robot", (("radius", "0.3"),))
    claims = (Claim("costmap", "good", "own", "Robot"), Claim("map", "error", "bad", "finding"))
    entry = Entry("claimed", LAYERS, ITEMS, (Table("Run", ()), table), claims=claims)
    browsers.show(chromium, pages(Report("claims", (entry,), "1.0")), **PHONE)
    details = "() => [...document.querySelectorAll('details')].map((one) => one.open)"
    assert chromium.evaluate(details) == [False, False]
    chromium.page.get_by_role("link", name="Robot").click()
    chromium.page.wait_for_timeout(100)
    assert chromium.evaluate(details) == [False, True]
    assert chromium.page.get_by_role("cell", name="0.3").is_visible()
    chromium.page.get_by_role("link", name="Findings").click()
    place = (
        chromium.page.locator("#map").bounding_box(),
        chromium.page.locator(".readout").bounding_box(),
    )
    assert 0 < place[1]["y"] - place[0]["y"] - place[0]["height"] < 60
    titles = chromium.evaluate(TEXTS, ".readout tbody th")[2:]
    assert titles == [layer.title for layer in LAYERS]
