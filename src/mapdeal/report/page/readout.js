// What layers say of a point, from their finest levels.

const signed = (number) => String(number).replace("-", "\u2212").replace("Infinity", "\u221e");
const metres = (value, digits = 3) => signed(value.toFixed(digits));
const pairText = (numbers, digits) => numbers.map((one) => metres(one, digits)).join(", ");

async function valueAt(layer, row, col) {
	const level = layer.levels.length - 1, { reduce, width } = layer.levels[level];
	const [r, c] = [row, col].map((one) => floor(one / reduce));
	const found = await valuesOf(layer, level, floor(r / TILE) * Math.ceil(width / TILE) + floor(c / TILE));
	return found.values[(r % TILE) * found.width + (c % TILE)];
}

// Distance and gradient between the centres of cells, as DistanceField.query has them.
async function between(layer, x, y) {
	const { frame } = layer, place = placeOf(frame, x, y);
	const [[south, north, v], [west, east, u]] = [frame.height, frame.width].map((count, k) => {
		const from = place[k] - 0.5, centre = round(from), at = abs(from - centre) <= place[2] ? centre : from;
		const below = floor(at);
		return [limited(below, 0, count - 1), limited(below + 1, 0, count - 1), at - below];
	});
	const corners = await Promise.all([[south, west], [south, east], [north, west], [north, east]].map((cell) => valueAt(layer, ...cell)));
	const [a, b, c, d] = corners;
	if (!corners.every(Number.isFinite)) return { value: corners[2 * (v >= 0.5) + (u >= 0.5)] };
	const slopes = [(1 - v) * (b - a) + v * (d - c), (1 - u) * (c - a) + u * (d - b)].map((slope) => slope / frame.resolution);
	return { value: (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d), gradient: turned(...slopes, frame.yaw) };
}

async function layerAt(layer, x, y) {
	const { frame, look, convention, unit, pooled } = layer, cell = cellAt(frame, x, y), { reduce } = layer.levels.at(-1);
	if (!cell) return { cell, text: "outside" };
	const found = convention && reduce === 1 ? await between(layer, x, y) : { value: await valueAt(layer, ...cell) };
	const { value, gradient } = found, label = look.labels[value];
	let text = unit === "m" ? metres(value) : signed(Number(value.toPrecision(5)));
	text = Number.isNaN(value) ? "none" : `${text} ${unit}`.trim();
	if (label) text = value === 255 ? label : `${label} (${text})`;
	if (gradient) text += `, gradient ${pairText(gradient, 2)}`;
	if (reduce > 1) text += `, ${pooled} of ${reduce} \u00d7 ${reduce} cells`;
	return { cell, label, text, reduce, ...found };
}

const readout = ({ layers }, x, y) => Promise.all(layers.map((layer) => layerAt(layer, x, y)));
