// The canvas: zoom, pan, ways to compare, and the values of pixels.

import { difference, paint } from "./pixels.js";

const VALUES_FROM = 56; // screen pixels a pixel, from which three numbers fit in
const MOST_ZOOM = 128;

export class Stage {
  constructor(canvas, pictures, look, onPixel) {
    Object.assign(this, { canvas, pictures, look, onPixel });
    this.zoom = 0; // screen pixels a pixel; 0 fits the whole image
    this.x = this.y = 0; // pixel in the middle
    this.swipe = 0.5;
    this.flipped = false;
    this.pointers = new Map();
    this.painted = {}; // "a", "b", "d" -> canvas of the picture's size
    this.dirty = { a: null, b: null, d: null }; // box to paint anew
    this.context = canvas.getContext("2d");
    new ResizeObserver(() => this.refresh()).observe(canvas);
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoomBy(2 ** (-e.deltaY / 300), e.offsetX, e.offsetY); }, { passive: false });
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.move(e));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (e) => { this.pointers.delete(e.pointerId); this.swiping = false; });
    canvas.addEventListener("pointerleave", () => this.onPixel(null));
  }

  layer(source) { return this.pictures[source]?.shown ?? null; }
  get base() { return this.layer(this.look.mode === "b" ? "b" : "a") ?? this.layer("a") ?? this.layer("b"); }
  get panes() { return this.look.mode === "side" ? 2 : 1; }
  get paneWidth() { return this.canvas.clientWidth / this.panes; }

  get scale() {
    const base = this.base;
    if (this.zoom || !base) return this.zoom || 1;
    return Math.min(this.paneWidth / base.width, this.canvas.clientHeight / base.height);
  }

  // What is to be painted anew.

  touch(source, box) {
    const old = this.dirty[source];
    this.dirty[source] = !old ? box : {
      x: Math.min(old.x, box.x), y: Math.min(old.y, box.y),
      width: Math.max(old.x + old.width, box.x + box.width) - Math.min(old.x, box.x),
      height: Math.max(old.y + old.height, box.y + box.height) - Math.min(old.y, box.y),
    };
    this.refresh();
  }

  touchAll() {
    for (const source of ["a", "b"]) {
      const layer = this.layer(source);
      if (layer) this.touch(source, { x: 0, y: 0, width: layer.width, height: layer.height });
    }
    this.refresh();
  }

  refresh() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  // Drawing.

  picture(source) {
    const layer = source === "d" ? this.differed : this.layer(source);
    if (!layer) return null;
    let canvas = this.painted[source];
    if (!canvas || canvas.width !== layer.width || canvas.height !== layer.height) {
      canvas = this.painted[source] = Object.assign(document.createElement("canvas"), { width: layer.width, height: layer.height });
      this.dirty[source] = { x: 0, y: 0, width: layer.width, height: layer.height };
    }
    const box = this.dirty[source];
    if (box) {
      const data = new ImageData(box.width, box.height);
      paint(layer, { ...this.look, cells: source === "a" ? this.look.cells : null }, box, data.data);
      canvas.getContext("2d").putImageData(data, box.x, box.y);
      this.dirty[source] = null;
    }
    return canvas;
  }

  draw() {
    const { canvas, context, look } = this, ratio = devicePixelRatio;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = "#0c0d0f";
    context.fillRect(0, 0, width, height);
    if (!this.base) return;
    if (!this.zoom) { this.x = this.base.width / 2; this.y = this.base.height / 2; }
    if (look.mode === "side") {
      this.pane("a", 0, width / 2, "this image");
      this.pane("b", width / 2, width / 2, "the other");
    } else if (look.mode === "swipe") {
      this.pane("a", 0, width, "this image", 0, width * this.swipe);
      this.pane("b", 0, width, "the other", width * this.swipe, width);
      context.fillStyle = "#fff";
      context.fillRect(width * this.swipe - 1, 0, 2, height);
    } else if (look.mode === "difference") {
      this.differed = difference(this.layer("a"), this.layer("b"));
      if (this.differed) this.dirty.d = { x: 0, y: 0, width: this.differed.width, height: this.differed.height };
      this.pane("d", 0, width, this.differed ? `difference, relMSE ${this.differed.relMSE.toPrecision(3)}` : "no difference: sizes or layers are not the same");
    } else {
      const source = look.mode === "b" || (look.mode === "flip" && this.flipped) ? "b" : "a";
      this.pane(source, 0, width, this.pictures.b ? (source === "b" ? "the other" : "this image") : "");
    }
  }

  pane(source, left, width, label, from = left, to = left + width) {
    const { context, scale } = this, height = this.canvas.clientHeight;
    const picture = this.picture(source);
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, height);
    context.clip();
    if (picture) {
      context.imageSmoothingEnabled = scale < 1;
      const x = left + width / 2 - this.x * scale, y = height / 2 - this.y * scale;
      context.drawImage(picture, x, y, picture.width * scale, picture.height * scale);
      if (scale >= VALUES_FROM) this.values(source, x, y, from, to);
    }
    if (label || !picture) {
      const none = this.pictures[source]?.layers.length ? "it has no such layer" : "nothing to see yet";
      const text = picture || source === "d" ? label : `${label} ${none}`.trim();
      context.font = "12px system-ui, sans-serif";
      const wide = context.measureText(text).width + 12;
      const at = source === "b" && this.look.mode === "swipe" ? to - wide - 6 : from + 6;
      context.fillStyle = "#000b";
      context.fillRect(at, 6, wide, 20);
      context.fillStyle = "#e4e6e9";
      context.fillText(text, at + 6, 20);
    }
    context.restore();
  }

  values(source, x, y, from, to) {
    const { context, scale } = this, layer = source === "d" ? this.differed : this.layer(source);
    const x0 = Math.max(0, Math.floor((from - x) / scale)), x1 = Math.min(layer.width, Math.ceil((to - x) / scale));
    const y0 = Math.max(0, Math.floor(-y / scale)), y1 = Math.min(layer.height, Math.ceil((this.canvas.clientHeight - y) / scale));
    context.font = "10px ui-monospace, monospace";
    context.textAlign = "center";
    context.lineWidth = 2;
    for (let py = y0; py < y1; py++) for (let px = x0; px < x1; px++) {
      layer.at(px, py).forEach((value, i, all) => {
        const place = [short(value), x + (px + 0.5) * scale, y + (py + 0.5) * scale + (i - (all.length - 1) / 2) * 12 + 3];
        context.strokeStyle = "#000";
        context.strokeText(...place);
        context.fillStyle = "#fff";
        context.fillText(...place);
      });
    }
    context.textAlign = "start";
  }

  // Moving about.

  fit() { this.zoom = 0; this.refresh(); }
  oneToOne() { this.zoom = 1; this.refresh(); }

  zoomBy(factor, left = this.paneWidth / 2, top = this.canvas.clientHeight / 2) {
    if (!this.base) return;
    const [x, y] = this.place(left, top);
    this.zoom = Math.min(Math.max(this.scale * factor, 0.02), MOST_ZOOM);
    const [nx, ny] = this.place(left, top);
    this.x += x - nx;
    this.y += y - ny;
    this.refresh();
  }

  pan(dx, dy) {
    this.zoom = this.scale;
    this.x -= dx / this.scale;
    this.y -= dy / this.scale;
    this.refresh();
  }

  /** The place in the image under a place of the canvas. */
  place(left, top) {
    return [((left % this.paneWidth) - this.paneWidth / 2) / this.scale + this.x, (top - this.canvas.clientHeight / 2) / this.scale + this.y];
  }

  down(e) {
    this.canvas.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, [e.offsetX, e.offsetY]);
    this.swiping = this.look.mode === "swipe" && Math.abs(e.offsetX - this.swipe * this.canvas.clientWidth) < 16;
  }

  move(e) {
    const before = this.pointers.get(e.pointerId);
    if (before) {
      this.pointers.set(e.pointerId, [e.offsetX, e.offsetY]);
      if (this.swiping) {
        this.swipe = Math.min(Math.max(e.offsetX / this.canvas.clientWidth, 0), 1);
        this.refresh();
      } else if (this.pointers.size === 2) {
        const [other] = [...this.pointers].filter(([id]) => id !== e.pointerId).map(([, at]) => at);
        const apart = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]);
        this.zoomBy(apart([e.offsetX, e.offsetY]) / Math.max(apart(before), 1), other[0], other[1]);
      } else {
        this.pan(e.offsetX - before[0], e.offsetY - before[1]);
      }
    }
    const [x, y] = this.place(e.offsetX, e.offsetY).map(Math.floor);
    this.onPixel(this.base?.at(x, y) ? [x, y] : null);
  }
}

export function short(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e4 || size < 1e-3 ? value.toExponential(1) : value.toPrecision(4).slice(0, 7);
}
