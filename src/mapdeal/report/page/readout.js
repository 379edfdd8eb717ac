// What layers say of a point, from their finest levels.

async function valueAt(layer, row, col) {
  const level = layer.levels.length - 1, { reduce, width } = layer.levels[level];
  const [r, c] = [row, col].map((one) => Math.floor(one / reduce));
  const tile = Math.floor(r / TILE) * Math.ceil(width / TILE) + Math.floor(c / TILE);
  const found = await values.get(layer, level, tile);
  return found.values[(r % TILE) * found.width + (c % TILE)];
}

// Distance and gradient between the centres of cells, as DistanceField.query has them.
async function between(layer, x, y) {
  const { frame } = layer, place = placeOf(frame, x, y);
  const [[south, north, v], [west, east, u]] = [frame.height, frame.width].map((count, k) => {
    const centre = Math.round(place[k] - 0.5), from = place[k] - 0.5;
    const at = Math.abs(from - centre) <= place[2] ? centre : from, below = Math.floor(at);
    return [...[below, below + 1].map((one) => Math.max(0, Math.min(count - 1, one))), at - below];
  });
  const corners = await Promise.all([[south, west], [south, east], [north, west], [north, east]].map((cell) => valueAt(layer, ...cell)));
  const [a, b, c, d] = corners;
  if (!corners.every(Number.isFinite)) return { value: corners[(v < 0.5 ? 0 : 2) + (u < 0.5 ? 0 : 1)] };
  const slopes = [(1 - v) * (b - a) + v * (d - c), (1 - u) * (c - a) + u * (d - b)].map((slope) => slope / frame.resolution);
  return { value: (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d), gradient: turned(...slopes, frame.yaw) };
}

async function layerAt(layer, x, y) {
  const cell = cellAt(layer.frame, x, y), { name, look, levels, convention } = layer, { reduce } = levels.at(-1);
  if (!cell) return { name, cell, text: "outside" };
  const found = convention && reduce === 1 ? await between(layer, x, y) : { value: await valueAt(layer, ...cell) };
  const { value, gradient } = found, label = look.labels[value];
  let text = layer.unit === "m" ? metres(value) : signed(Number(value.toPrecision(5)));
  text = Number.isNaN(value) ? "none" : [text, layer.unit].join(" ").trim();
  if (label) text = value === 255 ? label : `${label} (${text})`;
  if (gradient) text += `, gradient ${gradient.map((part) => metres(part, 2)).join(", ")}`;
  if (reduce > 1) text += `, ${layer.pooled} of ${reduce} \u00d7 ${reduce} cells`;
  return { name, cell, label, text, reduce, ...found };
}

const readout = (entry, x, y) => Promise.all(entry.layers.map((layer) => layerAt(layer, x, y)));

const signed = (number) => String(number).replace("-", "\u2212").replace("Infinity", "\u221e");
const metres = (value, digits = 3) => signed(value.toFixed(digits));
const pair = (point) => point.map((one) => metres(one)).join(", ");
