// Zones: polygons that are drawn over the map, and saved as GeoJSON in metres of the map frame.

const zonesPanel = find("#zones", document), DOT = matchMedia("(pointer: coarse)").matches ? 20 : 12; // pixels
const ZONE_COLOURS = { keepout: "#c4122f", speed: "#0b57c0", binary: "#6b21a8" }, KINDS = Object.keys(ZONE_COLOURS);
let ring = null, chosen = null, dragged = null, steps = [], isChanged = false, savedKinds = [];

const isDrawing = () => box("draw").checked;
const zoneColour = ({ kind }) => ZONE_COLOURS[kind];
const areaOf = (points) => points.reduce((sum, [x, y], k) => {
	const [u, v] = points[(k + 1) % points.length];
	return sum + (x * v - u * y) / 2;
}, 0);
const zoneArea = ({ rings }) => abs(areaOf(rings[0])) - rings.slice(1).reduce((sum, hole) => sum + abs(areaOf(hole)), 0);
const pairsOf = (points) => points.map((point, k) => [point, points[(k + 1) % points.length]]);

// Whether an outline crosses or touches itself: mapdeal edit draws none that does.
function crosses(points) {
	const side = ([a, b], [x, y]) => Math.sign((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]));
	const edges = pairsOf(points), last = edges.length - 1;
	return edges.some((one, k) => edges.some((other, j) => j > k + 1 && !(k === 0 && j === last)
		&& side(one, other[0]) * side(one, other[1]) <= 0 && side(other, one[0]) * side(other, one[1]) <= 0));
}

// Remember how the zones are, before a change.
function remember() {
	steps.typed = null; // a word that is typed is one step
	steps.push(JSON.stringify([entry.zones, ring, entry.zones.indexOf(chosen)]));
	isChanged = true;
	savedKinds = [];
}

function undo() {
	if (!steps.length) return say("There is nothing to undo.");
	const [zones, open, index] = JSON.parse(steps.pop());
	entry.zones = zones;
	ring = open;
	listZones(zones[index] ?? null);
}

function drawMode(isOn = true) {
	box("draw").checked = isOn;
	if (isOn) box("measure").checked = false;
	if (!isOn) ring = null;
	say(isOn ? "Set corners by clicks, or Enter in the middle of the map; click the first corner to close." : "");
	redraw();
}

function addCorner(point) {
	const near = ring?.length > 2 && hypot(...toScreen(...ring[0]).map((one, k) => one - toScreen(...point)[k])) < DOT;
	if (near) return closeZone();
	remember();
	(ring ??= []).push(point);
	redraw();
}

function closeZone() {
	if (!ring || ring.length < 3) return say("A zone needs at least three corners.");
	if (crosses(ring)) return say("The outline crosses itself: undo a corner.");
	remember();
	const { kind, speed, name } = fieldsOf();
	entry.zones.push({ kind, speed, name, rings: [ring] });
	ring = null;
	box("name").value = "";
	listZones(entry.zones.at(-1));
	say(`Zone of ${metres(zoneArea(chosen), 2)} m\u00b2: the panel Zones names and saves it.`);
}

function deleteZone() {
	if (!ring && !chosen) return say("Choose a zone in the list first.");
	remember();
	if (ring) ring = null;
	else entry.zones = entry.zones.filter((zone) => zone !== chosen);
	listZones(null);
}

const fieldsOf = () => {
	const kind = box("kind").value, speed = box("speed").value;
	return { kind, speed: kind === "speed" && speed ? +speed : null, name: box("name").value };
};

// What is typed into the fields is of the chosen zone, or of the next one.
function zoneTyped() {
	zonesPanel.classList.toggle("with-speed", box("kind").value === "speed");
	if (!chosen) return;
	if (steps.typed !== chosen) remember();
	steps.typed = chosen;
	Object.assign(chosen, fieldsOf());
	listZones(chosen, true);
}

const zoneText = (zone) => {
	const words = [zone.name, zone.speed === null ? zone.kind : `${zone.kind} ${zone.speed} %`].filter(Boolean).join(": ");
	return `${words}, ${metres(zoneArea(zone), 2)} m\u00b2, ${zone.rings[0].length} corners${zone.rings.some(crosses) ? ", crosses itself" : ""}`;
};

// Show the zones of the entry in the panel; one of them may be chosen.
function listZones(zone, isTyped) {
	chosen = zone;
	const list = find("ul", zonesPanel);
	list.replaceChildren(...entry.zones.map((one) => {
		const row = document.createElement("li"), button = document.createElement("button");
		Object.assign(button, { type: "button", textContent: zoneText(one), onclick: () => (listZones(one), goToZone(one)) });
		button.ariaCurrent = one === chosen || null;
		row.append(button);
		return row;
	}));
	if (chosen && !isTyped) for (const name of ["kind", "speed", "name"]) box(name).value = chosen[name] ?? "";
	zonesPanel.classList.toggle("with-speed", box("kind").value === "speed");
	const kinds = [...new Set(entry.zones.map(({ kind }) => kind))];
	find(".saves", zonesPanel).replaceChildren(...kinds.map((kind) => {
		const button = document.createElement("button"), count = entry.zones.filter((one) => one.kind === kind).length;
		return Object.assign(button, { type: "button", textContent: `Save ${count} ${kind} zone${count === 1 ? "" : "s"}`, onclick: () => saveZones(kind) });
	}));
	redraw();
}

function goToZone({ rings: [points] }) {
	const [xs, ys] = [0, 1].map((k) => points.map((point) => point[k]));
	goTo([min(...xs), min(...ys), max(...xs), max(...ys)], 0.5, max(view.scale, 12 / entry.layers[0].frame.resolution));
}

// GeoJSON has outer rings counterclockwise, holes clockwise, and closes each.
function geojsonOf(zones) {
	const closed = (points, sign) => {
		const turned = areaOf(points) * sign < 0 ? points.toReversed?.() ?? [...points].reverse() : points;
		return [...turned, turned[0]].map((point) => point.map((one) => +one.toFixed(4)));
	};
	const features = zones.map(({ kind, speed, name, rings }) => ({
		type: "Feature",
		properties: { kind, speed, name, ...(kind === "keepout" ? { value: 100 } : {}) },
		geometry: { type: "Polygon", coordinates: rings.map((points, k) => closed(points, k ? -1 : 1)) },
	}));
	return `{"type": "FeatureCollection", "features": [\n${features.map((one) => JSON.stringify(one)).join(",\n")}\n]}\n`;
}

function saveZones(kind) {
	const zones = entry.zones.filter((one) => one.kind === kind), bad = zones.find(({ rings }) => rings.some(crosses));
	if (bad) return say(`Not saved: ${bad.name || "a zone"} crosses itself.`);
	const unlimited = zones.find((zone) => kind === "speed" && !(zone.speed > 0 && zone.speed <= 100));
	if (unlimited) return say(`Not saved: ${unlimited.name || "a speed zone"} needs a speed above 0 and at most 100 percent.`);
	const link = document.createElement("a"), url = URL.createObjectURL(new Blob([geojsonOf(zones)], { type: "application/geo+json" }));
	Object.assign(link, { href: url, download: `${entry.name.split("/").pop()}_${kind}.geojson` });
	link.click();
	setTimeout(() => URL.revokeObjectURL(url), 60000);
	savedKinds.push(kind);
	say(`Saved ${zones.length === 1 ? "1 zone" : `${zones.length} zones`} as ${link.download}.`);
}

const MOST_BYTES = 2e7, MOST_CORNERS = 5000, FARTHEST = 1e6; // a page stays quick; metres

// Return the zone that a feature of a GeoJSON file is.
function zoneOf(feature, number) {
	const refuse = (rule, value) => { throw Error(`feature ${number} ${rule}${value === undefined ? "" : `, got ${JSON.stringify(value)?.slice(0, 60)}`}`); };
	const { type, coordinates } = feature?.geometry ?? {}, isPair = (point) => Array.isArray(point) && point.length > 1
		&& point.slice(0, 2).every((part) => Number.isFinite(part) && abs(part) <= FARTHEST);
	if (type !== "Polygon") refuse(type ? "must be a Polygon" : "has no geometry", type);
	if (!Array.isArray(coordinates) || !coordinates.length) refuse("has no coordinates");
	const rings = coordinates.map((points) => {
		if (!Array.isArray(points) || points.length < 4) refuse("must have rings of at least 4 points, of which the last repeats the first");
		const bad = points.find((point) => !isPair(point));
		if (bad !== undefined) refuse("must have points of two numbers in metres", bad);
		return points.slice(0, -1).map((point) => point.slice(0, 2));
	});
	const { speed = null, name, kind: own } = feature.properties ?? {}, kind = own ?? (speed === null ? "keepout" : "speed");
	if (!KINDS.includes(kind)) refuse(`must be of the kind ${KINDS.join(", ")}`, kind);
	if (speed !== null && !(speed > 0 && speed <= 100 && Number.isFinite(speed))) refuse("must have a speed above 0 and at most 100 percent", speed);
	return { kind, speed: kind === "speed" ? speed : null, name: ["string", "number"].includes(typeof name) ? `${name}` : "", rings };
}

// Add the polygons of a GeoJSON file to the zones.
async function openZones(file) {
	if (file.size > MOST_BYTES) throw Error("it is larger than 20 MB");
	let collection = null;
	try { collection = JSON.parse(await file.text()); } catch { throw Error(file.size ? "it is not JSON" : "it is empty"); }
	if (!Array.isArray(collection?.features)) throw Error("it is not a GeoJSON FeatureCollection");
	const zones = collection.features.map((feature, k) => zoneOf(feature, k + 1));
	if (!zones.length) throw Error("it has no features");
	if (zones.flatMap(({ rings }) => rings.flat()).length > MOST_CORNERS) throw Error(`it has more than ${MOST_CORNERS} corners`);
	remember();
	entry.zones.push(...zones);
	listZones(zones[0]);
	say(`${file.name}: ${zones.length === 1 ? "1 zone" : `${zones.length} zones`}.`);
}

find("[type=file]", zonesPanel).onchange = async ({ target }) => {
	for (const file of target.files)
		try { await openZones(file); } catch ({ message }) { say(`${file.name} was not opened: ${message}.`); }
	target.value = "";
};
onbeforeunload = (event) => { // any other value than none would ask, too
	if (isChanged && entry?.zones.some(({ kind }) => !savedKinds.includes(kind))) event.preventDefault();
};

// The corner of a zone at a point of the screen, as its ring and its number.
function cornerAt(sx, sy) {
	for (const points of [...(ring ? [ring] : []), ...(chosen ? [chosen, ...entry.zones] : entry.zones).flatMap(({ rings }) => rings)]) {
		const number = points.findIndex((point) => hypot(...toScreen(...point).map((one, k) => one - [sx, sy][k])) < DOT);
		if (number >= 0) return [points, number];
	}
	return null;
}

const zoneWith = (points) => entry.zones.find(({ rings }) => rings.includes(points)) ?? null;

const drawCentred = (text, sx, sy, colour) => drawText(text, sx - context.measureText(text).width / 2, sy, colour);

function drawLengths(edges) {
	for (const [a, b] of edges) {
		const [[ax, ay], [bx, by]] = [toScreen(...a), toScreen(...b)];
		if (hypot(ax - bx, ay - by) > 60) drawCentred(`${metres(hypot(a[0] - b[0], a[1] - b[1]), 2)} m`, (ax + bx) / 2, (ay + by) / 2 - 5);
	}
}

function drawCorners(points, colour) {
	for (const point of points) {
		const [sx, sy] = toScreen(...point), mark = new Path2D();
		mark.rect(sx - 5, sy - 5, 10, 10);
		strokePath(mark, colour, 1.5);
		context.fillStyle = "#fff";
		context.fill(mark);
	}
}

function drawZones() {
	for (const zone of entry.zones) {
		const path = pathOf(zone.rings.map((points) => [...points, points[0]])), colour = zoneColour(zone);
		context.fillStyle = `${colour}33`;
		context.fill(path, "evenodd");
		strokePath(path, colour, zone === chosen ? 3.5 : 2, zone.kind === "keepout" ? [] : [9, 4]);
		zone.path = () => path;
		if (zone === chosen) drawLengths(zone.rings.flatMap(pairsOf));
		if (zone === chosen || isDrawing()) drawCorners(zone.rings.flat(), colour);
		const [sx, sy] = toScreen(...[0, 1].map((k) => zone.rings[0].reduce((sum, point) => sum + point[k], 0) / zone.rings[0].length));
		drawCentred(zone.name || zone.kind, sx, sy, colour);
	}
	if (!ring) return;
	const open = byKeys || pointer ? [...ring, cursor()] : ring;
	strokePath(pathOf([open]), ZONE_COLOURS.keepout, 2.5, [6, 4]);
	drawLengths(open.slice(1).map((point, k) => [open[k], point]));
	drawCorners(ring, ZONE_COLOURS.keepout);
}
