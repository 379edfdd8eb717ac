// Where things lie, as mapdeal.grid.frame has it. A view is the map point {x, y} in the middle of
// a canvas, its {width, height}, and its scale, pixels a metre.

const turned = (x, y, yaw) =>
  [x * Math.cos(yaw) - y * Math.sin(yaw), x * Math.sin(yaw) + y * Math.cos(yaw)];

// Row and column with fractions, and what they may be off by rounding.
function placeOf({ x: left, y: low, yaw, resolution }, x, y) {
  const [u, v] = turned(x - left, y - low, -yaw), largest = Math.max(...[x, y, left, low].map(Math.abs));
  return [v / resolution, u / resolution, Math.max(1e-9, (4 * Number.EPSILON * largest) / resolution)];
}

function pointOf({ x, y, yaw, resolution }, row, col) {
  const [dx, dy] = turned(col * resolution, row * resolution, yaw);
  return [x + dx, y + dy];
}

function cellAt(frame, x, y) {
  const [v, u, tolerance] = placeOf(frame, x, y), row = Math.floor(v + tolerance), col = Math.floor(u + tolerance);
  return row >= 0 && row < frame.height && col >= 0 && col < frame.width ? [row, col] : null;
}

const toMap = (view, sx, sy) =>
  [view.x + (sx - view.width / 2) / view.scale, view.y - (sy - view.height / 2) / view.scale];
const toScreen = (view, x, y) =>
  [view.width / 2 + (x - view.x) * view.scale, view.height / 2 - (y - view.y) * view.scale];

// Least and most of points: left, low, right, high.
function boxOf(points) {
  const [xs, ys] = [0, 1].map((k) => points.map((point) => point[k]));
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

const cornersOf = (width, height) => [[0, 0], [width, 0], [0, height], [width, height]];

// A view of a box of the map, on a canvas of a size.
function fitted([left, low, right, high], { width, height }, share = 0.96) {
  const scale = share * Math.min(width / (right - left || 1e-9), height / (high - low || 1e-9));
  return { x: (left + right) / 2, y: (low + high) / 2, scale, width, height };
}
