// The viewer: one canvas, which shows the entry that is open.

const find = (selector, within = section) => within.querySelector(selector);
const every = (selector, within = section) => [...within.querySelectorAll(selector)];
let section = document, entry, view, pointer, pinned, ends, selected, byKeys, asked, beat, later, latest = [];
let blinks = 0, busy = 0, wanted = [], loading = null;
const canvas = find("#map"), context = canvas.getContext("2d");

const box = (name) => find(`[name=${name}]`) ?? {};
const say = (text) => (find("#status", document).textContent = text);
const fail = ({ message }) => say(`Not shown: ${message}`);

// How layers are shown: all of them, or two of them in one of three ways.
const mode = () => find(".modes :checked")?.value ?? "layers";
const panes = () => (mode() === "beside" ? 2 : 1);
const setMode = (name) => (find(`.modes [value=${name}]`) ?? {}).checked = true;
const divider = () => (view.width * find("#divider").value) / 100;
const redraw = () => (asked ??= requestAnimationFrame(draw));

// Layers with their opacities, the lowest first.
const stackOf = () => every(".layer").reverse().map((row, k) =>
	[entry.layers[k], find(":checked", row) ? find("[type=range]", row).value / 100 : 0]);

const comparedPair = () => every(".compare select").map(({ value }) => entry.layers[value]);

// A note in a closed part of the list is not on the map: many would hide it.
function isFolded(item, k) {
	if (item.kind !== "finding" || item.tone !== "note" || item === selected) return false;
	item.row ??= find(`[data-item="${k}"]`);
	return item.row?.closest("details:not([open])");
}

function shownItems() {
	const kinds = every(".kinds :checked").map(({ value }) => value);
	return entry.items.filter((item, k) => kinds.includes(item.kind) && !item.zone && !isFolded(item, k));
}

function draw() {
	asked = null;
	if (!entry) return;
	frameNumber++;
	const how = mode(), ratio = canvas.width / view.width / panes(), pair = comparedPair(), shown = pair[blinks % 2];
	context.setTransform(ratio, 0, 0, ratio, 0, 0);
	context.clearRect(0, 0, view.width * panes(), view.height);
	context.font = "600 13px system-ui, sans-serif";
	if (how === "blink") wanted = drawStack(context, [[shown, 1]], view, ratio);
	else if (how === "layers") wanted = drawStack(context, stackOf(), view, ratio);
	else wanted = pair.flatMap((layer, k) => {
		const [left, width] = how === "beside" ? [0, view.width] : k ? [divider(), view.width] : [0, divider()];
		return inPane(how === "beside" ? k : 0, ratio, left, width, () => drawLayer(context, layer, view, ratio));
	});
	pump();
	for (let k = 0; k < panes(); k++) inPane(k, ratio, 0, view.width, () => drawOver(how, how === "beside" ? [pair[k]] : pair, shown));
	context.setTransform(ratio, 0, 0, ratio, 0, 0);
	if (how === "swipe" || how === "beside") strokePath(new Path2D(`M${how === "swipe" ? divider() : view.width} 0v${view.height}`), DARK, 2);
	if (wanted.length || busy) return;
	performance.mark("mapdeal");
	loading?.remove();
}

// Draw within a part of one of the panes beside each other.
function inPane(k, ratio, left, width, draw) {
	context.save();
	context.setTransform(ratio, 0, 0, ratio, k * view.width * ratio, 0);
	context.beginPath();
	context.rect(left, 0, width - left, view.height);
	context.clip();
	const found = draw();
	context.restore();
	return found;
}

function drawOver(how, pair, shown) {
	drawItems(shownItems());
	drawZones();
	if (ends?.[0]) drawMeasure(ends[1] || !pointer ? ends : [...ends, pointer]);
	if (pinned) drawCross(toScreen(...pinned), TONES.error);
	if (byKeys || (isDrawing() && !pointer)) drawCross([view.width / 2, view.height / 2], DARK);
	drawScaleBar(view);
	if (how === "layers") return;
	const names = how === "blink" ? [shown] : pair;
	names.forEach(({ title }, k) => drawText(title, k ? max(14, view.width - 14 - context.measureText(title).width) : 14, view.height - 52));
}

// Make images that the last drawing missed, a few at a time.
function pump() {
	while (busy < 3 && wanted.length) {
		const next = wanted.shift();
		if (imageOf(...next, true)) continue;
		busy++;
		imageOf(...next).catch(fail).then(() => {
			busy--;
			redraw();
		});
	}
}

function resize() {
	const { clientWidth, clientHeight: height } = canvas, ratio = min(devicePixelRatio, 2), width = clientWidth / panes();
	if (!entry || !clientWidth) return;
	Object.assign(canvas, { width: round(clientWidth * ratio), height: round(height * ratio) });
	view = view ? { ...view, width, height } : fitted(entry.extent, { width, height });
	cancelAnimationFrame(asked);
	draw();
}

function moveTo(x, y, scale = view.scale) {
	const [left, low, right, high] = entry.whole, least = fitted(entry.whole, view, 0.2).scale;
	const most = 300 / entry.layers[0].frame.resolution;
	view = { ...view, x: limited(x, left, right), y: limited(y, low, high), scale: limited(scale, least, most) };
	redraw();
	clearTimeout(later);
	later = setTimeout(() => {
		const place = [view.x, view.y, view.scale].map((one) => +one.toPrecision(7));
		history.replaceState(null, "", `#${section.id}/${place}`);
	}, 300);
}

function zoom(factor, sx = view.width / 2, sy = view.height / 2) {
	const [x, y] = toMap(view, sx, sy);
	moveTo(x + (view.x - x) / factor, y + (view.y - y) / factor, view.scale * factor);
}

function goTo(extent, share, most = Infinity) {
	const { x, y, scale } = fitted(extent, view, share);
	moveTo(x, y, min(scale, most));
}

// Fill a column of the readout: 1 for the pointer, 2 for the pin.
async function tell(column, point) {
	const mine = (latest[column] = {}), rows = every(".readout tbody tr"), texts = [];
	if (point) {
		const found = (await readout(entry, ...point).catch(fail)) || [], top = stackOf().findLastIndex(([, alpha]) => alpha);
		texts.push(pairText(point), found[top]?.cell?.join(", "), ...found.map(({ text }) => text));
	}
	if (latest[column] === mine) rows.forEach((row, k) => (row.cells[column].textContent = texts[k] ?? ""));
}

function pin(point) {
	pinned = point;
	tell(2, point);
	say(point ? `Pinned ${pairText(point)}.` : "");
	redraw();
}

const cursor = () => (byKeys || !pointer ? [view.x, view.y] : pointer);

// Begin to measure, or end it, at a point; without one the next click tells it.
function measure(point) {
	if (isDrawing()) drawMode(false);
	ends = ends?.length === 1 && point ? [...ends, point] : point ? [point] : [];
	const [a, b] = ends;
	box("measure").checked = !b;
	say(b ? `Measured ${lengthOf(ends)}: dx ${metres(b[0] - a[0])}, dy ${metres(b[1] - a[1])}.` : "Choose two points.");
	redraw();
}

function select(item) {
	selected = item;
	for (const one of every("[data-item]")) {
		one.ariaCurrent = entry.items[one.dataset.item] === item || null;
		if (!one.ariaCurrent) continue;
		one.closest("details")?.setAttribute("open", "");
		one.scrollIntoView({ block: "nearest" });
	}
	redraw();
}

function clear() {
	ends = null;
	box("measure").checked = false;
	if (mode() === "blink") setMode("layers");
	drawMode(false);
	listZones(null);
	changed();
	select(null);
	pin(null);
}
