// Decodes all tiles of a page's header and data with decode.js, outside of a browser.
import { readFileSync } from "node:fs";

const [script, page] = process.argv.slice(2);
const { data, layers } = JSON.parse(readFileSync(page, "utf8"));
globalThis.document = { getElementById: (id) => (id === "data" ? { textContent: `\n${data}\n` } : null) };
const decodeTile = new Function(`${readFileSync(script, "utf8")}; return decodeTile;`)();
const told = [];
for (const layer of layers) {
  for (let level = 0; level < layer.levels.length; level++) {
    for (let tile = 0; tile < layer.levels[level].tiles.length; tile++) {
      const { width, height, values } = await decodeTile(layer, level, tile);
      const bytes = Buffer.from(values.buffer, values.byteOffset, values.byteLength);
      told.push({ width, height, type: values.constructor.name, values: bytes.toString("base64") });
    }
  }
}
process.stdout.write(JSON.stringify(told));
