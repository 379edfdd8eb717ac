// The tiles of a layer, as mapdeal/report/tiles.py and coding.py write them.

const TILE = 512; // cells of a tile's side
let tileText = null;

async function inflated(offset, length) {
  tileText ??= document.getElementById("data").textContent.trim();
  const text = atob(tileText.slice(offset, offset + length));
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// Whole numbers of bytes that say how each differs from left + below - below left.
function integers(planes, count, width, height) {
  const size = width * height;
  const found = new Int32Array(size);
  for (let plane = 0; plane < count; plane++) {
    for (let i = 0; i < size; i++) found[i] |= planes[plane * size + i] << (8 * plane);
  }
  for (let row = 0, i = 0; row < height; row++) {
    for (let column = 0, sum = 0; column < width; column++, i++) {
      sum = (sum + ((found[i] >>> 1) ^ -(found[i] & 1))) | 0;
      found[i] = row ? sum + found[i - width] : sum;
    }
  }
  return found;
}

// What number a whole one stands for.
function meaning(way) {
  if (way.kind === "steps") return (n) => n * way.step;
  if (way.kind === "squares") {
    const [[over, unit], [under, other]] = [way.above, way.below];
    return (n) => (n < 0 ? (under - Math.sqrt(-n)) * other : (Math.sqrt(n) - over) * unit);
  }
  const bits = new Int32Array(1), number = new Float32Array(bits.buffer);
  return (n) => {
    const ordered = n << way.hidden;
    bits[0] = ordered < 0 ? ordered ^ 0x7fffffff : ordered;
    return number[0];
  };
}

// A tile of a level: row 0 in the south.
async function decodeTile(layer, levelIndex, tileIndex) {
  const level = layer.levels[levelIndex];
  const columns = Math.ceil(level.width / TILE);
  const width = Math.min(TILE, level.width - (tileIndex % columns) * TILE);
  const height = Math.min(TILE, level.height - Math.floor(tileIndex / columns) * TILE);
  const data = await inflated(...level.tiles[tileIndex]);
  if (layer.coding.kind === "bytes") return { width, height, values: new Uint8Array(data) };
  const [way, planes, top, count] = new Int32Array(data, 0, 4);
  const others = new Float32Array(data, 16, count);
  const found = integers(new Uint8Array(data, 16 + 4 * count), planes, width, height);
  const number = meaning(layer.coding.ways[way]);
  const values = new Float32Array(found.length);
  for (let i = 0; i < found.length; i++) {
    values[i] = found[i] > top ? others[found[i] - top - 1] : number(found[i]);
  }
  return { width, height, values };
}
