// Values and images of tiles. Those used last are kept, and all that a frame needs.

let frameNumber = 0;

// Return a function that finds what `make` makes, or with `peek` what is at hand.
function keeping(most, make, drop) {
	const all = new Map();
	return (layer, level, tile, peek) => {
		const key = [layer.key, level, tile].join();
		let kept = all.get(key);
		if (peek && !kept) return null;
		all.delete(key);
		if (!kept) {
			kept = { promise: make(layer, level, tile) };
			kept.promise.then((value) => (kept.value = value), () => all.delete(key));
		}
		kept.frame = frameNumber;
		all.set(key, kept);
		for (const [old, { frame, value }] of all) {
			if (all.size <= most) break;
			if (frame === frameNumber || !value) continue;
			all.delete(old);
			drop?.(value);
		}
		return peek ? kept : kept.promise;
	};
}

const valuesOf = keeping(24, decodeTile), imageOf = keeping(96, paint, (image) => image.close());

const bytesOf = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));

for (const style of report.styles) {
	style.pixels = new Uint32Array(bytesOf(style.pixels).buffer); // the last one is no colour
	style.index = style.byValue && bytesOf(style.byValue);
}
report.entries.forEach(({ layers }, number) => layers.forEach((layer, k) => Object.assign(layer, {
	key: [number, k],
	look: report.styles[layer.style],
	below: layers.find(({ name }) => name === layer.states),
})));

async function paint(layer, level, tile) {
	const { pixels, index, scale, nowhere, line, fadedBy } = layer.look;
	const { width, height, values } = await valuesOf(layer, level, tile), image = new Uint32Array(values.length);
	if (index) values.forEach((value, k) => (image[k] = pixels[index[value]]));
	else {
		const states = layer.below?.levels[level] && (await valuesOf(layer.below, level, tile)).values;
		const isWall = (k) => states?.[k] >= layer.lethal && states[k] < 255;
		// Whether it touches a cell of the tile that is none.
		const isEdge = (k) => [-1, 1, -width, width].some((by) => states[k + by] !== undefined &&
			(by * by > 1 || ((k % width) + by + 1) % (width + 1)) && !isWall(k + by));
		values.forEach((value, k) => {
			// Where the field of an obstacle is 0 it is still on its side of the scale.
			const wall = line !== null && isWall(k), step = floor((value - scale.low) * scale.factor - (wall && 1e-6));
			let at = scale.first + limited(step, 0, scale.levels - 1);
			if (states?.[k] === 255) at += fadedBy;
			else if (wall && isEdge(k)) at = line;
			image[k] = pixels[Number.isNaN(value) ? nowhere : at];
		});
	}
	return createImageBitmap(new ImageData(new Uint8ClampedArray(image.buffer), width, height));
}
