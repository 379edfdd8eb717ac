// What lies over the layers of the viewer: items, a measured line, crosses and the scale bar.

const DARK = "#1f2937", TONES = { error: "#c4122f", warning: "#b45309", note: "#0b57c0", good: "#0a7a4b", plain: DARK };

// As the layers of what differs have them.
const CHANGES = { added: "#0078dc", removed: "#e11e3c", closed: "#aa00aa", opened: "#00965a", unknown: "#785a1e", known: "#a8861a", rose: "#b22230", fell: "#184f8c" };

function strokePath(path, colour, width, dash = []) {
	context.lineJoin = context.lineCap = "round";
	for (const [strokeStyle, more, pattern] of [["#fff", 3, []], [colour, 0, dash]]) {
		Object.assign(context, { strokeStyle, lineWidth: width + more });
		context.setLineDash(pattern);
		context.stroke(path);
	}
}

function pathOf(lines) {
	const path = new Path2D();
	for (const line of lines) line.forEach((point, k) => path[k ? "lineTo" : "moveTo"](...toScreen(...point)));
	return path;
}

function drawText(text, sx, sy, fillStyle = DARK) {
	Object.assign(context, { lineWidth: 4, strokeStyle: "#fff", fillStyle });
	context.setLineDash([]);
	context.strokeText(text, sx, sy);
	context.fillText(text, sx, sy);
}

// Draw items, the selected one last; a label only where no other one is.
function drawItems(items) {
	const taken = [];
	for (const item of items.sort((a, b) => (a === selected) - (b === selected))) {
		const { kind, lines, label, place } = item, chosen = item === selected, colour = CHANGES[kind] ?? TONES[item.tone];
		const [sx, sy] = toScreen(...(place ?? lines[0]?.[0] ?? [NaN, NaN])), radius = chosen ? 9 : kind === "graph" ? 3 : item.tone === "note" ? 4 : 6;
		item.path = pathOf(lines);
		strokePath(item.path, colour, (kind === "passage" ? 4 : 2.5) + 2 * chosen, kind === "shape" ? [7, 5] : kind === "removed" ? [5, 3] : []);
		if (place && !(lines.length && (CHANGES[kind] || (kind === "passage" && !chosen)))) {
			const mark = new Path2D();
			if (kind === "goal") mark.rect(sx - radius, sy - radius, 2 * radius, 2 * radius);
			else mark.arc(sx, sy, radius, 0, 7);
			strokePath(mark, chosen ? DARK : colour, 2);
			context.fillStyle = colour;
			context.fill(mark);
			item.path.addPath(mark);
		}
		const { width } = context.measureText(label);
		if (!label || taken.some(([x, y, w]) => sx < x + w && x < sx + width && abs(sy - y) < 16)) continue;
		taken.push([sx, sy, width]);
		drawText(label, sx + 11, sy - 8, colour);
	}
}

function drawCross([sx, sy], colour) {
	strokePath(new Path2D(`M${sx - 9} ${sy}h18M${sx} ${sy - 9}v18`), colour, 1.5);
}

function drawScaleBar({ scale, width, height }) {
	const most = min(180, width / 3) / scale, power = 10 ** floor(Math.log10(most));
	const length = power * [5, 2, 1].find((factor) => factor * power <= most);
	strokePath(new Path2D(`M14 ${height - 20}v6h${length * scale}v-6`), DARK, 2);
	drawText(length < 1 ? `${+(100 * length).toPrecision(3)} cm` : `${length} m`, 20, height - 24);
}

const lengthOf = ([a, b]) => `${metres(hypot(b[0] - a[0], b[1] - a[1]))} m`;

function drawMeasure(ends) {
	strokePath(pathOf([ends]), TONES.note, 2.5);
	if (ends[1]) drawText(lengthOf(ends), ...toScreen(...ends[1]).map((one) => one + 10));
}
