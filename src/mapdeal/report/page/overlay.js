// What lies over the layers: items, lines that are measured, crosses and the scale bar.

const TONES = { error: "#c4122f", warning: "#b45309", note: "#0b57c0", good: "#0a7a4b", plain: "#1f2937" };

function strokePath(context, path, colour, width, dash = []) {
  context.lineJoin = context.lineCap = "round";
  for (const [style, more, pattern] of [["#fff", 3, []], [colour, 0, dash]]) {
    context.setLineDash(pattern);
    context.lineWidth = width + more;
    context.strokeStyle = style;
    context.stroke(path);
  }
}

function pathOf(lines, view) {
  const path = new Path2D();
  for (const line of lines) line.forEach((point, k) => path[k ? "lineTo" : "moveTo"](...toScreen(view, ...point)));
  return path;
}

function drawText(context, text, sx, sy, colour = TONES.plain) {
  Object.assign(context, { lineWidth: 4, lineJoin: "round", strokeStyle: "#fff", fillStyle: colour });
  context.setLineDash([]);
  context.strokeText(text, sx, sy);
  context.fillText(text, sx, sy);
}

// Draw items, the selected one last; a label only where no other one is.
function drawItems(context, items, view, selected) {
  const taken = [];
  for (const item of [...items].sort((a, b) => (a === selected) - (b === selected))) {
    const { kind, lines, label } = item, chosen = item === selected, colour = TONES[item.tone];
    const [sx, sy] = toScreen(view, ...(item.place ?? lines[0]?.[0] ?? [NaN, NaN]));
    item.path = pathOf(lines, view);
    strokePath(context, item.path, colour, (kind === "passage" ? 4 : 2.5) + 2 * chosen, kind === "shape" ? [7, 5] : []);
    if (item.place && (chosen || kind !== "passage" || !lines.length)) {
      const mark = new Path2D(), radius = chosen ? 9 : 6;
      if (kind === "goal") mark.rect(sx - radius, sy - radius, 2 * radius, 2 * radius);
      else mark.arc(sx, sy, radius, 0, 7);
      strokePath(context, mark, chosen ? "#111" : colour, 2);
      context.fillStyle = colour;
      context.fill(mark);
      item.path.addPath(mark);
    }
    const width = context.measureText(label).width;
    if (!label || taken.some(([x, y, w]) => sx < x + w && x < sx + width && Math.abs(sy - y) < 16)) continue;
    taken.push([sx, sy, width]);
    drawText(context, label, sx + 11, sy - 8, colour);
  }
}

function drawCross(context, [sx, sy], colour) {
  strokePath(context, new Path2D(`M${sx - 9} ${sy}h18M${sx} ${sy - 9}v18`), colour, 1.5);
}

function drawScaleBar(context, view) {
  const most = Math.min(180, view.width / 3) / view.scale, power = 10 ** Math.floor(Math.log10(most));
  const length = power * [5, 2, 1].find((factor) => factor * power <= most);
  strokePath(context, new Path2D(`M14 ${view.height - 20}v6h${length * view.scale}v-6`), TONES.plain, 2);
  drawText(context, length < 1 ? Number((100 * length).toPrecision(3)) + " cm" : length + " m", 20, view.height - 24);
}

const lengthOf = ([[ax, ay], [bx, by]]) => metres(Math.hypot(bx - ax, by - ay)) + " m";

function drawMeasure(context, ends, view) {
  strokePath(context, pathOf([ends], view), TONES.note, 2.5);
  if (ends[1]) drawText(context, lengthOf(ends), ...toScreen(view, (ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2));
}
