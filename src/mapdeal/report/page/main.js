// What users do, and what follows from it.

const actions = {
  in: () => zoom(1.5),
  out: () => zoom(1 / 1.5),
  fit: () => goTo(entry.extent, 0.96, Infinity),
  all: () => goTo(entry.whole, 0.96, Infinity),
  measure: () => (isOn("measure") ? clear() : measure()),
  clear,
  compare: () => turn("compare", !isOn("compare")) && stopBlink(),
  blink: () => {
    const on = !isOn("blink");
    stopBlink();
    turn("blink", on);
    if (on) beat = setInterval(() => redraw(blinks++), 800);
  },
};

function showOnly(number) {
  every(".layer", section).forEach((row) => (find("[type=checkbox]", row).checked = Number(row.dataset.layer) === number));
  changed();
}

// Follow what is chosen in the panels.
function changed() {
  if (!entry) return;
  const shown = comparedPair() ?? stackOf().filter(([, alpha]) => alpha);
  every(".layer", section).forEach((row) => (find(".legend", row).hidden = !shown.some(([layer]) => layer === entry.layers[row.dataset.layer])));
  find("#divider").hidden = !isOn("compare") || isOn("blink");
  tell(2, pinned);
  redraw();
}

document.addEventListener("click", ({ target }) => {
  const { do: action, item, only, sort: by } = target.closest("button")?.dataset ?? {};
  actions[action]?.();
  if (only) showOnly(Number(only));
  if (by !== undefined) sort(target.closest("th"));
  if (action) changed();
  if (!item) return;
  select(entry.items[item]);
  const { lines, place } = selected;
  goTo(boxOf([...lines.flat(), ...(place ? [place] : [])]), 0.4, Math.max(view.scale, 12 / entry.layers[0].frame.resolution));
  canvas.scrollIntoView({ block: "nearest" });
});
document.addEventListener("input", ({ target }) => (target.id === "filter" ? filter(target.value) : changed()));

// Pointers: one pans, two pinch, one that has not moved has clicked.
const held = new Map();
let moved;

canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  held.set(event.pointerId, [event.offsetX, event.offsetY]);
  moved = held.size > 1;
};
canvas.onpointermove = ({ pointerId, offsetX: sx, offsetY: sy }) => {
  const before = held.get(pointerId), other = [...held].find(([id]) => id !== pointerId)?.[1];
  if (before) {
    moved ||= Math.hypot(sx - before[0], sy - before[1]) > 4;
    if (!moved) return;
    held.set(pointerId, [sx, sy]);
    const share = other ? 2 : 1;
    moveTo(view.x - (sx - before[0]) / share / view.scale, view.y + (sy - before[1]) / share / view.scale);
    if (other) {
      const apart = ([x, y]) => Math.hypot(x - other[0], y - other[1]) + 1;
      zoom(apart([sx, sy]) / apart(before), (sx + other[0]) / 2, (sy + other[1]) / 2);
    }
  }
  point(sx, sy);
};
canvas.onpointerup = ({ pointerId, offsetX: sx, offsetY: sy }) => {
  if (!held.delete(pointerId) || moved) return;
  point(sx, sy);
  if (isOn("measure")) return measure(pointer);
  const ratio = canvas.width / view.width;
  context.lineWidth = 14;
  const item = shownItems().find(({ path }) => path && (context.isPointInStroke(path, sx * ratio, sy * ratio) || context.isPointInPath(path, sx * ratio, sy * ratio)));
  if (item) select(item);
  pin(pointer);
};
canvas.onpointercancel = ({ pointerId }) => held.delete(pointerId);
canvas.onpointerleave = () => tell(1, (pointer = null));
canvas.onwheel = (event) => {
  event.preventDefault();
  const by = event.deltaY * (event.deltaMode ? 30 : 1);
  zoom(Math.exp(-Math.max(-240, Math.min(240, by)) / 400), event.offsetX, event.offsetY);
  point(event.offsetX, event.offsetY);
};

function point(sx, sy) {
  byKeys = false;
  pointer = toMap(view, sx, sy);
  tell(1, pointer);
  if (isOn("measure")) redraw();
}

const keys = {
  "+": actions.in, "=": actions.in, "-": actions.out, f: actions.fit, 0: actions.all, Escape: clear,
  m: () => measure(cursor()), p: () => pin(cursor()),
  Enter: () => (isOn("measure") ? measure(cursor()) : pin(cursor())),
};
const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

canvas.onkeydown = (event) => {
  const { key } = event, step = (event.shiftKey ? 8 : 60) / view.scale;
  if (event.ctrlKey || event.metaKey || event.altKey || !(keys[key] || arrows[key] || entry.layers[key - 1])) return;
  event.preventDefault();
  if (arrows[key]) {
    byKeys = true;
    moveTo(view.x + arrows[key][0] * step, view.y + arrows[key][1] * step);
    tell(1, [view.x, view.y]);
  } else if (keys[key]) keys[key]();
  else showOnly(key - 1);
};

// Show the entry that the address names; of several the table if it names none.
function open() {
  const [id, place = ""] = location.hash.slice(1).split("/"), sections = every(".entry");
  const next = sections.find((one) => one.id === id) ?? (table ? null : sections[0]);
  if (next !== section) {
    if (entry) clear();
    sections.forEach((one) => (one.hidden = one !== next));
    if (table) table.hidden = Boolean(next);
    section = next;
    const { layers } = (entry = report.entries[sections.indexOf(next)] ?? { layers: [] });
    if (!layers.length) entry = null;
    view = null;
    if (entry) {
      entry.whole = boxOf(layers.flatMap(({ frame }) => cornersOf(frame.width, frame.height).map(([col, row]) => pointOf(frame, row, col))));
      entry.extent ??= entry.whole;
      find(".slot", section).append(find("#viewer"));
      find("#viewer").hidden = false;
      if (entry.compared) turn("compare", true);
    }
    if (table) find("h2", next ?? table).focus();
  }
  changed();
  resize();
  const [x, y, scale] = place.split(",").map(Number);
  if (entry && scale > 0) moveTo(x || 0, y || 0, scale);
}

// The table of several: thumbnails, sorting and filtering.
const lines = every("tbody tr", table ?? document.createElement("p"));

async function drawThumb(thumb) {
  const layer = report.entries[thumb.dataset.entry].layers.at(-1);
  if (!layer) return;
  const { frame } = layer, box = boxOf(cornersOf(frame.width, frame.height).map(([col, row]) => pointOf(frame, row, col)));
  const only = { ...layer, levels: layer.levels.slice(0, 1) }, where = fitted(box, thumb);
  await Promise.all(drawLayer(thumb.getContext("2d"), only, where).map((missing) => images.get(...missing)));
  drawLayer(thumb.getContext("2d"), only, where);
}

const watch = new IntersectionObserver((seen) => seen.forEach(({ isIntersecting, target }) => {
  if (!isIntersecting) return;
  watch.unobserve(target);
  drawThumb(target).catch(fail);
}));

function sort(head) {
  const sign = head.ariaSort === "ascending" ? -1 : 1, { compare } = new Intl.Collator("en", { numeric: true });
  const textOf = ({ cells }) => cells[head.cellIndex].dataset.value ?? cells[head.cellIndex].textContent;
  const order = (a, b) => (a && b ? sign * (a - b || compare(a, b)) : !a - !b);
  every("th", table).forEach((one) => (one.ariaSort = null));
  head.ariaSort = sign > 0 ? "ascending" : "descending";
  find("tbody", table).append(...lines.sort((a, b) => order(textOf(a), textOf(b))));
}

function filter(text) {
  const words = text.toLowerCase().split(" ");
  lines.forEach((row) => (row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word))));
  find("#count").textContent = `${lines.filter((row) => !row.hidden).length} of ${lines.length} maps`;
}

// For tests, and for the curious.
window.mapdeal = { readout: (x, y, number) => readout(report.entries[number] ?? entry, x, y), state: () => ({ view, pinned, ends, selected }) };

if (!window.DecompressionStream || !window.OffscreenCanvas) find("#unsupported").hidden = false;
else {
  document.documentElement.className = "scripted";
  new ResizeObserver(resize).observe(canvas);
  every("[data-entry]").forEach((one) => watch.observe(one));
  const closed = every("details");
  window.onbeforeprint = () => closed.forEach((one) => (one.open = true));
  window.onafterprint = () => closed.forEach((one) => (one.open = false));
  window.onhashchange = open;
  open();
}
