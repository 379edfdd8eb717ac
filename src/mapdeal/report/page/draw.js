// Draws layers on a canvas.

// The tiles of a level that a view shows: row, column and number.
function tilesIn({ frame, levels }, level, view) {
	const { reduce, width, height } = levels[level], step = TILE * reduce, found = [];
	const corners = [0, view.width].flatMap((sx) => [0, view.height].map((sy) => placeOf(frame, ...toMap(view, sx, sy))));
	const [[low, high], [left, right]] = [height, width].map((count, k) => {
		const places = corners.map((corner) => corner[k] / step), last = Math.ceil(count / TILE) - 1;
		return [max(0, floor(min(...places))), min(last, floor(max(...places)))];
	});
	for (let row = low; row <= high; row++)
		for (let col = left; col <= right; col++) found.push([row, col, row * Math.ceil(width / TILE) + col]);
	return found;
}

// Draw what is at hand of a layer, and return what is missing. Coarse cells show until fine ones,
// about as large as a pixel, are there.
function drawLayer(context, layer, view, ratio = 1) {
	const { frame, levels } = layer, missing = [], cell = frame.resolution * view.scale;
	const fine = levels.findIndex(({ reduce }) => reduce * cell * ratio <= 1.5), finest = fine < 0 ? levels.length - 1 : fine;
	const isReady = tilesIn(layer, finest, view).every(([, , tile]) => imageOf(layer, finest, tile, true)?.value);
	for (let level = isReady ? finest : 0; level <= finest; level++)
		for (const [row, col, tile] of tilesIn(layer, level, view)) {
			const kept = imageOf(layer, level, tile, true), { reduce } = levels[level], north = row * TILE * reduce, east = col * TILE * reduce;
			if (!kept && (level === 0 || level === finest)) missing.push([layer, level, tile]);
			if (!kept?.value) continue;
			// Cells at the edge may stand for fewer; within, a tile goes on below its neighbours.
			const width = min(kept.value.width * reduce, frame.width - east), height = min(kept.value.height * reduce, frame.height - north);
			const [cos, sin] = turned(cell, 0, frame.yaw), more = 1 / cell;
			context.save();
			context.transform(cos, -sin, -sin, -cos, ...toScreen(...pointOf(frame, north, east), view));
			context.imageSmoothingEnabled = cell * reduce * ratio < 1;
			context.drawImage(kept.value, 0, 0, width / reduce, height / reduce, 0, 0,
				width + more * (east + width < frame.width), height + more * (north + height < frame.height));
			context.restore();
		}
	return missing;
}

// Draw layers with their opacities, the lowest first; not those that another one hides.
function drawStack(context, stack, view, ratio) {
	return stack.flatMap(([layer, alpha], k) => {
		const hides = ([{ opaque, area }, its]) => opaque && its === 1 && area === layer.area;
		if (!alpha || stack.slice(k + 1).some(hides)) return [];
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
