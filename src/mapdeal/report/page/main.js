// What users do, and what follows from it.

const actions = {
	in: () => zoom(1.5),
	out: () => zoom(1 / 1.5),
	fit: () => goTo(entry.extent, 0.96),
	clear,
	undo, closeZone, deleteZone,
};

function changed() {
	clearInterval(beat);
	if (!entry) return;
	if (mode() === "blink") beat = setInterval(() => redraw(blinks++), 800);
	tell(2, pinned);
	if (view && abs(view.width * panes() - canvas.clientWidth) > 1) resize();
	redraw();
}

function showOnly(k) {
	every(".layer [type=checkbox]").reverse().forEach((one, j) => (one.checked = j === k));
	changed();
}

document.onclick = ({ target }) => {
	const button = target.closest("button"), { action, item, only } = button?.dataset ?? {};
	actions[action]?.();
	if (only) showOnly(+only);
	if (button?.closest("thead")) sort(button.closest("th"));
	if (!item) return;
	select(entry.items[item]);
	goTo(selected.box, 0.4, max(view.scale, 12 / entry.layers[0].frame.resolution));
	canvas.scrollIntoView({ block: "nearest" });
};
document.oninput = ({ target: { id, name, value, checked } }) => {
	if (id === "filter") filter(value);
	else if (["kind", "speed", "name"].includes(name)) zoneTyped();
	else if (name === "draw") drawMode(checked);
	else if (name === "time") showOnly(+value);
	else if (name === "measure") checked ? measure() : clear();
	else changed();
};

// Pointers: one pans, two pinch, one that has not moved has clicked.
const held = new Map();
let moved;

// Where a pointer is within its pane.
const placeIn = ({ offsetX, offsetY }) => [offsetX % view.width, offsetY];

function point(event) {
	byKeys = false;
	pointer = toMap(view, ...placeIn(event));
	tell(1, pointer);
	if (ends || ring) redraw();
}

canvas.onpointerdown = ({ pointerId, offsetX, offsetY }) => {
	canvas.setPointerCapture(pointerId);
	held.set(pointerId, [offsetX, offsetY]);
	moved = held.size > 1;
	dragged = isDrawing() && !moved ? cornerAt(...placeIn({ offsetX, offsetY })) : null;
};
canvas.onpointermove = (event) => {
	const { pointerId, offsetX: sx, offsetY: sy } = event, before = held.get(pointerId);
	if (before) {
		moved ||= hypot(sx - before[0], sy - before[1]) > 4;
		if (!moved) return;
		held.set(pointerId, [sx, sy]);
		if (dragged) {
			const [points, number] = dragged;
			if (dragged.length < 3) dragged.push(remember());
			points[number] = toMap(view, ...placeIn(event));
			return redraw();
		}
		const by = view.scale * held.size;
		moveTo(view.x - (sx - before[0]) / by, view.y + (sy - before[1]) / by);
		for (const [id, [x, y]] of held)
			if (id !== pointerId) zoom(hypot(sx - x, sy - y) / hypot(before[0] - x, before[1] - y) || 1, ((sx + x) / 2) % view.width, (sy + y) / 2);
	}
	point(event);
};
canvas.onpointerup = (event) => {
	if (!held.delete(event.pointerId)) return;
	if (moved) return dragged && listZones(zoneWith(dragged[0]));
	point(event);
	if (box("measure").checked) return measure(pointer);
	if (isDrawing()) return dragged && dragged[0] !== ring ? listZones(zoneWith(dragged[0])) : addCorner(pointer);
	const ratio = canvas.width / view.width / panes(), at = placeIn(event).map((one) => one * ratio);
	context.setTransform(ratio, 0, 0, ratio, 0, 0);
	context.lineWidth = 14;
	const zone = entry.zones.findLast(({ path }) => path && context.isPointInPath(path(), ...at, "evenodd"));
	if (zone || chosen) listZones(zone ?? null);
	const item = shownItems().find(({ path }) => context.isPointInStroke(path, ...at) || context.isPointInPath(path, ...at));
	if (item) select(item);
	pin(pointer);
};
canvas.onpointercancel = ({ pointerId }) => held.delete(pointerId);
canvas.onpointerleave = () => tell(1, (pointer = null));
canvas.onwheel = (event) => {
	event.preventDefault();
	zoom(Math.exp(-limited(event.deltaY * (event.deltaMode ? 30 : 1), -240, 240) / 400), ...placeIn(event));
	point(event);
};

const pan = (x, y) => ({ shiftKey }) => {
	const step = (shiftKey ? 8 : 60) / view.scale;
	byKeys = true;
	moveTo(view.x + x * step, view.y + y * step);
};
const keys = {
	ArrowLeft: pan(-1, 0), ArrowRight: pan(1, 0), ArrowUp: pan(0, 1), ArrowDown: pan(0, -1),
	"+": actions.in, "=": actions.in, "-": actions.out, f: actions.fit, 0: actions.fit,
	m: () => measure(cursor()), p: () => pin(cursor()), Escape: () => (ring ? deleteZone : clear)(),
	Enter: () => (isDrawing() ? addCorner : ends?.length === 1 ? measure : pin)(cursor()),
	z: () => drawMode(!isDrawing()), c: closeZone, u: undo, Backspace: undo, Delete: deleteZone,
};

canvas.onkeydown = (event) => {
	const { key, ctrlKey, metaKey } = event;
	if ((ctrlKey || metaKey) && key === "z") return event.preventDefault(undo());
	const act = keys[key] ?? (entry.layers[key - 1] && (() => showOnly(key - 1)));
	if (ctrlKey || metaKey || !act) return;
	event.preventDefault();
	act(event);
	if (byKeys) tell(1, cursor());
};

// Show the entry that the address names; of several the table if it names none.
const table = find("#maps");

function open() {
	const [id, place = ""] = location.hash.slice(1).split("/"), sections = every(".entry", document);
	const target = id && document.getElementById(id), next = (target || document).closest?.(".entry") ?? (table || sections[0]), [x, y, scale] = place.split(",").map(Number);
	if (next !== section) {
		if (entry) clear();
		for (const one of sections) one.hidden = one !== next;
		if (table) table.hidden = next !== table;
		section = next;
		view = null;
		entry = report.entries[sections.indexOf(next)];
		if (!entry?.layers.length) entry = null;
		else {
			find(".slot").append(find("#viewer", document));
			find(".panels").append(zonesPanel);
			entry.zones ??= entry.items.filter(({ zone }) => zone).map(({ zone, lines }) => ({ ...zone, rings: lines.map((points) => points.slice(0, -1)) }));
			steps = [];
			listZones(null);
		}
		if (table) find("h2").focus();
	}
	changed();
	resize();
	if (entry && scale > 0) moveTo(x, y, scale);
	if (target && target !== next && target !== table) {
		if (target.tagName === "DETAILS") target.open = true;
		target.scrollIntoView({ block: "nearest" });
	}
}

// The table of several: thumbnails, sorting and filtering.
const rows = every("#maps tbody tr");

async function drawThumb(thumb) {
	const { layers, extent } = report.entries[thumb.dataset.entry], [layer] = layers.slice(-1);
	if (!layer) return;
	const draw = () => drawLayer(thumb.getContext("2d"), { ...layer, levels: layer.levels.slice(0, 1) }, fitted(extent, thumb));
	await Promise.all(draw().map((missing) => imageOf(...missing)));
	draw();
}

const watch = new IntersectionObserver((seen) => seen.forEach(({ isIntersecting, target }) => {
	if (!isIntersecting) return;
	watch.unobserve(target);
	drawThumb(target).catch(fail);
}));

function sort(head) {
	const sign = head.ariaSort === "ascending" ? -1 : 1;
	const textOf = ({ cells: { [head.cellIndex]: cell } }) => cell.dataset.value ?? cell.textContent;
	const order = (a, b) => (a && b ? sign * (a - b || a.localeCompare(b, "en", { numeric: true })) : !a - !b);
	for (const one of every("th", table)) one.ariaSort = null;
	head.ariaSort = sign > 0 ? "ascending" : "descending";
	find("tbody", table).append(...rows.sort((a, b) => order(textOf(a), textOf(b))));
}

function filter(text) {
	const words = text.toLowerCase().split(" ");
	for (const row of rows) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
	find("#count").textContent = `${rows.filter(({ hidden }) => !hidden).length} of ${rows.length} maps`;
}

window.mapdeal = { readout: (x, y) => readout(entry, x, y), state: () => ({ view, pinned, ends, selected, ring, zones: entry?.zones }), geojson: () => geojsonOf(entry.zones) };

if (!window.DecompressionStream) find("#unsupported").hidden = false;
else {
	document.documentElement.className = "scripted";
	new ResizeObserver(resize).observe(canvas);
	for (const one of every("[data-entry]")) watch.observe(one);
	const fold = (open) => () => every("details:not(.notes)").forEach((one) => (one.open = open));
	Object.assign(window, { onbeforeprint: fold(true), onafterprint: fold(false), onhashchange: open });
	document.addEventListener("toggle", redraw, true);
	open();
	if (entry && !performance.getEntriesByName("mapdeal").length) {
		// The page counts as loaded once the map is drawn, so that it is there when the page is printed at once.
		loading = document.body.appendChild(Object.assign(document.createElement("iframe"), { hidden: true }));
		loading.contentDocument.open();
	}
}
