// The viewer: one canvas, which shows the entry that is open.

const find = (selector, within = section) => within.querySelector(selector);
const every = (selector, within = section) => [...within.querySelectorAll(selector)];
let section = document, entry, view, pointer, pinned, ends, selected, byKeys, asked, beat, later, latest = [];
let blinks = 0, busy = 0, wanted = [];
const canvas = find("#map"), context = canvas.getContext("2d");

const box = (name) => find(`[name=${name}]`) ?? {};
const say = (text) => (find("#status", document).textContent = text);
const fail = ({ message }) => say(`Not shown: ${message}`);
const divider = () => (view.width * find("#divider").value) / 100;
const redraw = () => (asked ??= requestAnimationFrame(draw));

// Layers with their opacities, the lowest first.
const stackOf = () => every(".layer").reverse().map((row, k) =>
	[entry.layers[k], find(":checked", row) ? find("[type=range]", row).value / 100 : 0]);

const comparedPair = () => every("select").map(({ value }) => entry.layers[value]);

function shownItems() {
	const kinds = every(".kinds :checked").map(({ value }) => value);
	return entry.items.filter(({ kind }) => kinds.includes(kind));
}

function draw() {
	asked = null;
	if (!entry) return;
	frameNumber++;
	const ratio = canvas.width / view.width, pair = comparedPair(), shown = pair[blinks % 2];
	context.setTransform(ratio, 0, 0, ratio, 0, 0);
	context.clearRect(0, 0, view.width, view.height);
	context.font = "600 13px system-ui, sans-serif";
	if (box("blink").checked) wanted = drawStack(context, [[shown, 1]], view, ratio);
	else if (!box("compare").checked) wanted = drawStack(context, stackOf(), view, ratio);
	else wanted = pair.flatMap((layer, k) => {
		context.save();
		context.beginPath();
		context.rect(k ? divider() : 0, 0, k ? view.width : divider(), view.height);
		context.clip();
		const missing = drawLayer(context, layer, view, ratio);
		context.restore();
		return missing;
	});
	pump();
	drawItems(shownItems());
	if (ends?.[0]) drawMeasure(ends[1] || !pointer ? ends : [...ends, pointer]);
	if (pinned) drawCross(toScreen(...pinned), TONES.error);
	if (byKeys) drawCross([view.width / 2, view.height / 2], DARK);
	drawScaleBar(view);
	if (box("blink").checked) drawText(shown.name, 14, 24);
	else if (box("compare").checked) strokePath(new Path2D(`M${divider()} 0v${view.height}`), DARK, 2);
	if (!wanted.length && !busy) performance.mark("mapdeal");
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
	const { clientWidth: width, clientHeight: height } = canvas, ratio = min(devicePixelRatio, 2);
	if (!entry || !width) return;
	Object.assign(canvas, { width: round(width * ratio), height: round(height * ratio) });
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
		if (one.ariaCurrent) one.scrollIntoView({ block: "nearest" });
	}
	redraw();
}

function clear() {
	ends = null;
	box("measure").checked = box("blink").checked = false;
	changed();
	select(null);
	pin(null);
}
