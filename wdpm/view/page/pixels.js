// Pixels as floats, and as a screen shows them.

import { TRANSFORMS } from "./transforms.js";

const ENCODED = Uint8ClampedArray.from({ length: 4096 }, (_, i) => {
  const v = (i / 4095) ** 2; // steps of the root: dark values need the finer ones
  return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
});

// Viridis (van der Walt & Smith 2015, CC0): as bright as values are large, also to the colour-blind.
const VIRIDIS = [[68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140], [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37]];
export const DECADES = 4; // of false colour; the upper end is 10 at exposure 0

// Okabe & Ito's colours, then others: slaves are told apart by them.
const SLAVES = [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [204, 121, 167], [160, 160, 160]];

/** Of a slave by its number; dark for nobody. */
export const slaveColor = (number) => (number === undefined ? [20, 20, 20] : SLAVES[number % SLAVES.length]);

export function viridis(share) {
  const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1);
  const low = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[low].map((v, i) => v + (VIRIDIS[low + 1][i] - v) * (at - low));
}

const FALSE = Array.from({ length: 1024 }, (_, i) => viridis(i / 1023));

/** One layer of one picture. */
export class Layer {
  constructor(name, width, height, channels) {
    Object.assign(this, { name, width, height, channels, most: 0 });
    this.data = new Float32Array(width * height * channels);
  }

  put(tile) {
    const row = tile.width * this.channels;
    for (let y = 0; y < tile.height; y++) {
      this.data.set(tile.pixels.subarray(y * row, (y + 1) * row), ((tile.y + y) * this.width + tile.x) * this.channels);
    }
    if (this.name === "depth") for (const v of tile.pixels) if (v > this.most && v < Infinity) this.most = v;
  }

  /** The values of a pixel, or null outside. */
  at(x, y) {
    if (x < 0 || y < 0 || x >= this.width || y >= this.height) return null;
    const i = (y * this.width + x) * this.channels;
    return Array.from(this.data.subarray(i, i + this.channels));
  }
}

/** |a - b| of two layers of one size; null if they have none in common. */
export function difference(a, b) {
  if (!a || !b || a.width !== b.width || a.height !== b.height || a.channels !== b.channels) return null;
  const layer = new Layer("difference", a.width, a.height, a.channels);
  let squares = 0, counted = 0;
  for (let i = 0; i < a.data.length; i++) {
    const d = a.data[i] - b.data[i];
    layer.data[i] = Math.abs(d);
    const share = (d * d) / (b.data[i] * b.data[i] + 0.01); // as `wdpm compare` has it
    if (share < Infinity) { squares += share; counted++; }
  }
  layer.relMSE = squares / Math.max(counted, 1);
  return layer;
}

/** Paint a rectangle of a layer into an ImageData of the same size as the rectangle. */
export function paint(layer, look, box, out) {
  const { channels, width, data, name } = layer;
  const gain = 2 ** look.exposure, transform = TRANSFORMS[look.transform];
  const scale = name === "depth" ? gain / (layer.most || 1) : gain;
  const owners = look.cells && look.cells.width === width && look.cells.height === layer.height ? look.cells.data : null;
  let to = 0;
  for (let y = box.y; y < box.y + box.height; y++) {
    for (let x = box.x; x < box.x + box.width; x++, to += 4) {
      const p = y * width + x, i = p * channels;
      let r = data[i], g = channels === 3 ? data[i + 1] : r, b = channels === 3 ? data[i + 2] : r;
      out[to + 3] = 255;
      if (!(Math.abs(r + g + b) < Infinity)) { out[to] = 255; out[to + 1] = 0; out[to + 2] = 255; continue; }
      if (name === "cell") {
        [r, g, b] = slaveColor(look.holder(Math.round(r)));
      } else if (look.falseColor) {
        const v = Math.abs(channels === 3 ? 0.2126 * r + 0.7152 * g + 0.0722 * b : r) * scale;
        const share = 1 + (Math.log10(v) - 1) / DECADES;
        [r, g, b] = FALSE[Math.round(Math.min(Math.max(share, 0), 1) * 1023)];
      } else if (name === "normal") {
        r = 127.5 * (r + 1); g = 127.5 * (g + 1); b = 127.5 * (b + 1);
      } else {
        // signed layers (bias) show their size; what has one channel is no light
        const light = channels === 3 ? transform(Math.abs(r) * scale, Math.abs(g) * scale, Math.abs(b) * scale) : [r * scale, r * scale, r * scale];
        [r, g, b] = light.map(encode);
      }
      const owner = owners && name !== "cell" ? look.holder(Math.round(owners[p])) : undefined;
      if (owner !== undefined) {
        const tint = slaveColor(owner);
        r = r * 0.6 + tint[0] * 0.4; g = g * 0.6 + tint[1] * 0.4; b = b * 0.6 + tint[2] * 0.4;
      }
      out[to] = r; out[to + 1] = g; out[to + 2] = b;
    }
  }
}

function encode(v) {
  return ENCODED[Math.round(Math.sqrt(Math.min(Math.max(v, 0), 1)) * 4095)];
}

/** A binary message (docs/view.md). */
export function readTile(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { ...header, pixels: new Float32Array(buffer, 4 + length) };
}
