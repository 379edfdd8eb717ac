// Values and images of tiles. Those used last are kept, and all that a frame needs.

let frameNumber = 0;

class Kept {
  all = new Map();

  constructor(most, make, drop) {
    Object.assign(this, { most, make, drop });
  }

  // What is at hand, if anything.
  peek(layer, level, tile) {
    const kept = this.all.get([layer.key, level, tile].join());
    if (kept) kept.frame = frameNumber;
    return kept;
  }

  get(layer, level, tile) {
    const key = [layer.key, level, tile].join();
    let kept = this.peek(layer, level, tile);
    this.all.delete(key);
    if (!kept) {
      kept = { frame: frameNumber, promise: this.make(layer, level, tile) };
      kept.promise.then((value) => (kept.value = value), () => this.all.delete(key));
    }
    this.all.set(key, kept);
    for (const [old, { frame, value }] of this.all) {
      if (this.all.size <= this.most) break;
      if (frame === frameNumber || !value) continue;
      this.all.delete(old);
      this.drop?.(value);
    }
    return kept.promise;
  }
}

const values = new Kept(24, decodeTile), images = new Kept(96, paint, (image) => image.close());
const bytesOf = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));

for (const style of report.styles) {
  const rgb = bytesOf(style.colours), rgba = new Uint8Array((rgb.length / 3 + 1) * 4); // the last: none
  rgb.forEach((part, k) => (rgba[k + Math.floor(k / 3)] = part));
  for (let k = 3; k < rgba.length - 4; k += 4) rgba[k] = 255;
  style.pixels = new Uint32Array(rgba.buffer);
  style.index = style.byValue && bytesOf(style.byValue);
}
report.entries.forEach((entry, number) => entry.layers.forEach((layer, k) => {
  layer.key = number + "/" + k;
  layer.look = report.styles[layer.style];
  layer.below = entry.layers.find(({ name }) => name === layer.states);
}));

async function paint(layer, level, tile) {
  const { pixels, index, scale, nowhere, line, fadedBy } = layer.look;
  const { width, height, values: found } = await values.get(layer, level, tile), image = new Uint32Array(width * height);
  if (index) found.forEach((value, k) => (image[k] = pixels[index[value]]));
  else {
    const states = layer.below?.levels[level] && (await values.get(layer.below, level, tile)).values;
    const factor = scale.levels / (scale.high - scale.low || 1), last = pixels.length - 1;
    const isObstacle = (k) => states[k] >= layer.lethal && states[k] < 255;
    // Whether it touches a cell of the tile that is none, over an edge.
    const isEdge = (k) => (k % width && !isObstacle(k - 1)) || ((k + 1) % width && !isObstacle(k + 1)) ||
      (k >= width && !isObstacle(k - width)) || (k + width < states.length && !isObstacle(k + width));
    found.forEach((value, k) => {
      let colour = nowhere ?? last;
      if (!Number.isNaN(value)) {
        colour = scale.first + Math.max(0, Math.min(scale.levels - 1, Math.floor((value - scale.low) * factor)));
        if (states?.[k] === 255) colour += fadedBy ?? 0;
        else if (states && line !== null && isObstacle(k) && isEdge(k)) colour = line;
      }
      image[k] = pixels[colour];
    });
  }
  return createImageBitmap(new ImageData(new Uint8ClampedArray(image.buffer), width, height));
}
