// Where things lie, as mapdeal.grid.frame has it. A view is the map point {x, y} in the middle of
// a canvas of {width, height}, and its scale: pixels a metre.

const turned = (x, y, yaw) =>
	[x * cos(yaw) - y * sin(yaw), x * sin(yaw) + y * cos(yaw)];
const limited = (value, least, most) => max(least, min(most, value));

// Row and column with fractions, and what they may be off by rounding.
function placeOf({ x: left, y: low, yaw, resolution }, x, y) {
	const [u, v] = turned(x - left, y - low, -yaw), largest = max(...[x, y, left, low].map(abs));
	return [v / resolution, u / resolution, max(1e-9, (4 * Number.EPSILON * largest) / resolution)];
}

function pointOf({ x, y, yaw, resolution }, row, col) {
	const [dx, dy] = turned(col * resolution, row * resolution, yaw);
	return [x + dx, y + dy];
}

function cellAt(frame, x, y) {
	const [v, u, tolerance] = placeOf(frame, x, y), row = floor(v + tolerance), col = floor(u + tolerance);
	return row >= 0 && row < frame.height && col >= 0 && col < frame.width ? [row, col] : null;
}

const toMap = ({ x, y, scale, width, height }, sx, sy) => [x + (sx - width / 2) / scale, y - (sy - height / 2) / scale];
const toScreen = (x, y, of = view) => [of.width / 2 + (x - of.x) * of.scale, of.height / 2 - (y - of.y) * of.scale];

// A view of a box of the map: left, low, right, high.
function fitted([left, low, right, high], { width, height }, share = 0.96) {
	const scale = share * min(width / (right - left || 1e-9), height / (high - low || 1e-9));
	return { x: (left + right) / 2, y: (low + high) / 2, scale, width, height };
}
