// The viewer: one canvas, which shows the entry that is open.

const find = (selector, within = document) => within.querySelector(selector);
const every = (selector, within = document) => [...within.querySelectorAll(selector)];
const canvas = find("#map"), context = canvas.getContext("2d"), table = find("#maps");
let section, entry, view, pointer, pinned, ends, selected, byKeys, asked, beat, later;
let blinks = 0, busy = 0, wanted = [];

const buttonOf = (name) => find(`[data-do=${name}]`, section);
const isOn = (name) => buttonOf(name)?.ariaPressed === "true";
const turn = (name, on) => buttonOf(name) && (buttonOf(name).ariaPressed = on);
const say = (text) => (find("#status").textContent = text);
const fail = (error) => say(`Part of this report cannot be shown: ${error.message}`);
const divider = () => (view.width * find("#divider").value) / 100;

// Layers with their opacities, the lowest first.
function stackOf() {
  return entry.layers.map((layer, k) => {
    const row = find(`[data-layer="${k}"]`, section);
    return [layer, find("[type=checkbox]", row).checked ? find("[type=range]", row).value / 100 : 0];
  });
}

// The two layers that are compared, if any, and what they are called.
function comparedPair() {
  return isOn("compare") || isOn("blink")
    ? every("select", section).map(({ value, selectedOptions }) => [entry.layers[value], selectedOptions[0].text]) : null;
}

function shownItems() {
  const kinds = every(".kinds :checked", section).map(({ value }) => value);
  return entry.items.filter(({ kind }) => kinds.includes(kind));
}

function redraw() {
  asked ??= requestAnimationFrame(draw);
}

function draw() {
  asked = null;
  if (!entry || !view) return;
  frameNumber++;
  const ratio = canvas.width / view.width, pair = comparedPair();
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, view.width, view.height);
  context.font = "600 13px system-ui, sans-serif";
  if (!pair) wanted = drawStack(context, stackOf(), view, ratio);
  else if (isOn("blink")) wanted = drawStack(context, [[pair[blinks % 2][0], 1]], view, ratio);
  else wanted = pair.flatMap(([layer], k) => drawHalf(layer, k, ratio));
  pump();
  drawItems(context, shownItems(), view, selected);
  if (ends?.length) drawMeasure(context, ends.length < 2 && pointer ? [...ends, pointer] : ends, view);
  if (pinned) drawCross(context, toScreen(view, ...pinned), TONES.error);
  if (byKeys) drawCross(context, [view.width / 2, view.height / 2], TONES.plain);
  drawScaleBar(context, view);
  if (isOn("blink")) drawText(context, pair[blinks % 2][1], 14, 24);
  else if (pair) {
    strokePath(context, new Path2D(`M${divider()} 0v${view.height}`), TONES.plain, 2);
    drawText(context, pair[0][1], divider() - 12 - context.measureText(pair[0][1]).width, 24);
    drawText(context, pair[1][1], divider() + 12, 24);
  }
  if (!wanted.length && !busy) performance.mark("mapdeal");
}

function drawHalf(layer, k, ratio) {
  context.save();
  context.beginPath();
  context.rect(k ? divider() : 0, 0, k ? view.width : divider(), view.height);
  context.clip();
  const missing = drawStack(context, [[layer, 1]], view, ratio);
  context.restore();
  return missing;
}

// Make images that the last drawing missed, a few at a time.
function pump() {
  while (busy < 3 && wanted.length) {
    const next = wanted.shift();
    if (images.peek(...next)) continue;
    busy++;
    images.get(...next).catch(fail).then(() => {
      busy--;
      redraw();
    });
  }
}

function resize() {
  const { clientWidth: width, clientHeight: height } = canvas, ratio = Math.min(devicePixelRatio, 2);
  if (!entry || !width) return;
  Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
  view = view ? { ...view, width, height } : fitted(entry.extent, { width, height });
  cancelAnimationFrame(asked);
  draw();
}

function moveTo(x, y, scale = view.scale) {
  const [left, low, right, high] = entry.whole, limit = (value, least, most) => Math.max(least, Math.min(most, value));
  const least = fitted(entry.whole, view, 0.2).scale, most = 300 / entry.layers[0].frame.resolution;
  view = { ...view, x: limit(x, left, right), y: limit(y, low, high), scale: limit(scale, least, most) };
  redraw();
  clearTimeout(later);
  later = setTimeout(() => {
    const place = [view.x.toFixed(3), view.y.toFixed(3), view.scale.toPrecision(5)].map(Number);
    history.replaceState(null, "", `#${section.id}/${place}`);
  }, 300);
}

function zoom(factor, sx = view.width / 2, sy = view.height / 2) {
  const [x, y] = toMap(view, sx, sy), scale = view.scale * factor;
  moveTo(x - (sx - view.width / 2) / scale, y + (sy - view.height / 2) / scale, scale);
}

function goTo(box, share, most) {
  const { x, y, scale } = fitted(box, view, share);
  moveTo(x, y, Math.min(scale, most));
}

// Fill a column of the readout: 1 for the pointer, 2 for the pin.
const asking = [];

async function tell(column, point) {
  const mine = (asking[column] = {}), rows = every(".readout tbody tr", section), texts = [];
  if (point) {
    const found = await readout(entry, ...point).catch(fail), top = stackOf().findLastIndex(([, alpha]) => alpha);
    if (!found) return;
    texts.push(pair(point), found[top]?.cell?.join(", ") ?? "", ...found.map(({ text }) => text));
  }
  if (asking[column] === mine) rows.forEach((row, k) => (row.cells[column].textContent = texts[k] ?? ""));
}

function pin(point) {
  pinned = point;
  tell(2, point);
  say(point ? `Pinned ${pair(point)}.` : "");
  redraw();
}

const cursor = () => (byKeys || !pointer ? [view.x, view.y] : pointer);

// Begin to measure, or end it, at a point; without one the next click tells it.
function measure(point) {
  if (ends?.length === 1 && point) ends.push(point);
  else ends = point ? [point] : [];
  const [a, b] = ends;
  turn("measure", !b);
  say(b ? `Measured ${lengthOf(ends)}: dx ${metres(b[0] - a[0])}, dy ${metres(b[1] - a[1])}.` : "Measuring: choose two points.");
  redraw();
}

function select(item) {
  selected = item;
  every("[data-item]", section).forEach((one) => {
    one.ariaCurrent = entry.items[one.dataset.item] === item ? "true" : null;
    if (one.ariaCurrent) one.scrollIntoView({ block: "nearest" });
  });
  redraw();
}

function clear() {
  ends = null;
  turn("measure", false);
  stopBlink();
  select(null);
  pin(null);
}

function stopBlink() {
  clearInterval(beat);
  turn("blink", false);
}
