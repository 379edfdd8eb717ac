// What users do, and what follows from it.

const actions = {
	in: () => zoom(1.5),
	out: () => zoom(1 / 1.5),
	fit: () => goTo(entry.extent, 0.96),
	clear,
};

function changed() {
	clearInterval(beat);
	if (!entry) return;
	if (box("blink").checked) beat = setInterval(() => redraw(blinks++), 800);
	tell(2, pinned);
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
	else if (name === "measure") checked ? measure() : clear();
	else changed();
};

// Pointers: one pans, two pinch, one that has not moved has clicked.
const held = new Map();
let moved;

function point({ offsetX, offsetY }) {
	byKeys = false;
	pointer = toMap(view, offsetX, offsetY);
	tell(1, pointer);
	if (ends) redraw();
}

canvas.onpointerdown = ({ pointerId, offsetX, offsetY }) => {
	canvas.setPointerCapture(pointerId);
	held.set(pointerId, [offsetX, offsetY]);
	moved = held.size > 1;
};
canvas.onpointermove = (event) => {
	const { pointerId, offsetX: sx, offsetY: sy } = event, before = held.get(pointerId);
	if (before) {
		moved ||= hypot(sx - before[0], sy - before[1]) > 4;
		if (!moved) return;
		held.set(pointerId, [sx, sy]);
		const by = view.scale * held.size;
		moveTo(view.x - (sx - before[0]) / by, view.y + (sy - before[1]) / by);
		for (const [id, [x, y]] of held)
			if (id !== pointerId) zoom(hypot(sx - x, sy - y) / hypot(before[0] - x, before[1] - y) || 1, (sx + x) / 2, (sy + y) / 2);
	}
	point(event);
};
canvas.onpointerup = (event) => {
	if (!held.delete(event.pointerId) || moved) return;
	point(event);
	if (box("measure").checked) return measure(pointer);
	const at = [event.offsetX, event.offsetY].map((one) => (one * canvas.width) / view.width);
	context.lineWidth = 14;
	const item = shownItems().find(({ path }) => context.isPointInStroke(path, ...at) || context.isPointInPath(path, ...at));
	if (item) select(item);
	pin(pointer);
};
canvas.onpointercancel = ({ pointerId }) => held.delete(pointerId);
canvas.onpointerleave = () => tell(1, (pointer = null));
canvas.onwheel = (event) => {
	event.preventDefault();
	zoom(Math.exp(-limited(event.deltaY * (event.deltaMode ? 30 : 1), -240, 240) / 400), event.offsetX, event.offsetY);
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
	m: () => measure(cursor()), p: () => pin(cursor()), Enter: () => (ends?.length === 1 ? measure : pin)(cursor()), Escape: clear,
};

canvas.onkeydown = (event) => {
	const { key } = event, act = keys[key] ?? (entry.layers[key - 1] && (() => showOnly(key - 1)));
	if (event.ctrlKey || event.metaKey || !act) return;
	event.preventDefault();
	act(event);
	if (byKeys) tell(1, cursor());
};

// Show the entry that the address names; of several the table if it names none.
const table = find("#maps");

function open() {
	const [id, place = ""] = location.hash.slice(1).split("/"), sections = every(".entry", document);
	const next = sections.find((one) => one.id === id) ?? (table || sections[0]), [x, y, scale] = place.split(",").map(Number);
	if (next !== section) {
		if (entry) clear();
		for (const one of sections) one.hidden = one !== next;
		if (table) table.hidden = next !== table;
		section = next;
		view = null;
		entry = report.entries[sections.indexOf(next)];
		if (!entry?.layers.length) entry = null;
		else find(".slot").append(find("#viewer", document));
		if (table) find("h2").focus();
	}
	changed();
	resize();
	if (entry && scale > 0) moveTo(x, y, scale);
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

window.mapdeal = { readout: (x, y) => readout(entry, x, y), state: () => ({ view, pinned, ends, selected }) };

if (!window.DecompressionStream) find("#unsupported").hidden = false;
else {
	document.documentElement.className = "scripted";
	new ResizeObserver(resize).observe(canvas);
	for (const one of every("[data-entry]")) watch.observe(one);
	const fold = (open) => () => every("details").forEach((one) => (one.open = open));
	Object.assign(window, { onbeforeprint: fold(true), onafterprint: fold(false), onhashchange: open });
	open();
}
