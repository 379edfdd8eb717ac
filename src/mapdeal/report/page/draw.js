// Draws layers on a canvas.

// The cells of a layer that a view shows: first and last row and column, with fractions.
function cellsIn(frame, view) {
  return boxOf(cornersOf(view.width, view.height).map((corner) => placeOf(frame, ...toMap(view, ...corner))));
}

// The tiles of a level that cells lie in: row, column, and number.
function tilesIn({ frame, levels }, level, [low, left, high, right]) {
  const { reduce, width, height } = levels[level], step = TILE * reduce, found = [];
  const columns = Math.ceil(width / TILE), rows = Math.ceil(height / TILE);
  if (high < 0 || right < 0 || low > frame.height || left > frame.width) return found;
  const limit = (value, count) => Math.max(0, Math.min(count - 1, Math.floor(value / step)));
  for (let row = limit(low, rows); row <= limit(high, rows); row++)
    for (let col = limit(left, columns); col <= limit(right, columns); col++) found.push([row, col, row * columns + col]);
  return found;
}

// Draw what is at hand of a layer, and return what is missing. Cells are at most as large as
// needed; coarser ones show until they are there.
function drawLayer(context, layer, view, ratio = 1) {
  const { frame, levels } = layer, cells = cellsIn(frame, view), missing = [], cell = frame.resolution * view.scale;
  const fine = levels.findIndex(({ reduce }) => reduce * cell * ratio <= 1.5), finest = fine < 0 ? levels.length - 1 : fine;
  const isReady = tilesIn(layer, finest, cells).every(([, , tile]) => images.peek(layer, finest, tile)?.value);
  for (let level = isReady ? finest : 0; level <= finest; level++)
    for (const [row, col, tile] of tilesIn(layer, level, cells)) {
      const kept = images.peek(layer, level, tile), { reduce } = levels[level], step = TILE * reduce;
      if (!kept && (level === 0 || level === finest)) missing.push([layer, level, tile]);
      if (!kept?.value) continue;
      const [cos, sin] = turned(cell, 0, frame.yaw), { value: image } = kept;
      // Cells at the edge may stand for fewer; within, a tile goes on below its neighbours.
      const width = Math.min(image.width * reduce, frame.width - col * step), height = Math.min(image.height * reduce, frame.height - row * step);
      const more = [col * step + width < frame.width, row * step + height < frame.height].map((is) => is && 1 / cell);
      context.save();
      context.transform(cos, -sin, -sin, -cos, ...toScreen(view, ...pointOf(frame, row * step, col * step)));
      context.imageSmoothingEnabled = cell * reduce * ratio < 1;
      context.drawImage(image, 0, 0, width / reduce, height / reduce, 0, 0, width + more[0], height + more[1]);
      context.restore();
    }
  return missing;
}

// Draw layers with their opacities, the lowest first; not those that another one hides.
function drawStack(context, stack, view, ratio) {
  const covers = (upper, { frame }) => {
    const [low, left, high, right] = cellsIn(upper.frame, view);
    return upper.opaque && (JSON.stringify(frame) === JSON.stringify(upper.frame) ||
      (low >= 0 && left >= 0 && high <= upper.frame.height && right <= upper.frame.width));
  };
  return stack.flatMap(([layer, alpha], k) => {
    if (!alpha || stack.slice(k + 1).some(([upper, its]) => its === 1 && covers(upper, layer))) return [];
    if (alpha === 1) return drawLayer(context, layer, view, ratio);
    const sheet = new OffscreenCanvas(context.canvas.width, context.canvas.height), other = sheet.getContext("2d");
    other.scale(ratio, ratio);
    const missing = drawLayer(other, layer, view, ratio);
    context.globalAlpha = alpha;
    context.drawImage(sheet, 0, 0, view.width, view.height);
    context.globalAlpha = 1;
    return missing;
  }).sort((a, b) => a[1] - b[1]);
}
