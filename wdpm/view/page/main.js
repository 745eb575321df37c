// The page: a socket, controls and keys, and what they change.

import { DECADES, Layer, readTile, viridis } from "./pixels.js";
import { show } from "./panel.js";
import { short, Stage } from "./stage.js";
import { autoExposure } from "./transforms.js";

const $ = (id) => document.getElementById(id);
const RETRY_MS = [1000, 2000, 4000, 5000];

const pictures = {}; // "a", "b" -> {image, width, height, layers, shown: Layer, cells: Layer}
const look = { exposure: 0, transform: "standard", falseColor: false, mode: "a", cells: null, holder: (cell) => holders.get(cell) };
let holders = new Map();
let status = null, socket = null, tries = 0, layerName = "beauty", given = null, automatic = false;

const stage = new Stage($("canvas"), pictures, look, showPixel);

// The socket.

function connect() {
  socket = new WebSocket(new URL("socket", location.href).href.replace(/^http/, "ws"));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { tries = 0; forget(); banner(null); };
  socket.onmessage = ({ data }) => (typeof data === "string" ? told(JSON.parse(data)) : took(readTile(data)));
  socket.onclose = () => {
    if (status) show(status, false);
    if (status?.ended) return;
    banner("Connection lost: the render has ended without a word, or cannot be reached. Trying again ...");
    setTimeout(connect, RETRY_MS[Math.min(tries++, RETRY_MS.length - 1)]);
  };
}

function send(message) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function banner(text, ended = false) {
  $("banner").hidden = text === null;
  $("banner").textContent = text ?? "";
  $("banner").className = ended ? "ended" : "";
}

function forget() {
  for (const picture of Object.values(pictures)) picture.image = null;
}

function told(message) {
  if (message.kind !== "status") return banner(message.reason);
  status = message;
  holders = new Map(status.slaves.flatMap((slave, number) => slave.cells.map((cell) => [cell, number])));
  let changed = false;
  for (const [name, state] of Object.entries(status.pictures)) {
    const known = pictures[name];
    changed ||= !known || known.image !== state.image || known.layers.length !== state.layers.length;
    pictures[name] = known && known.image === state.image ? Object.assign(known, state) : { ...state, shown: null, cells: null };
  }
  if (changed) pick();
  lookAs(status.look);
  if (automatic) autoExpose();
  show(status, true);
  if (status.ended !== null) banner(`${status.title}: ${status.ended}. What is shown stays until the page is closed.`, !status.ended.startsWith("failed"));
}

function took(tile) {
  const picture = pictures[tile.source];
  if (!picture || tile.image !== picture.image) return; // of an image that is no more
  for (const slot of ["shown", "cells"]) {
    const wanted = slot === "shown" ? layerName : look.cells && "cell";
    if (tile.layer !== wanted || (slot === "cells" && tile.source !== "a")) continue;
    picture[slot] ??= new Layer(tile.layer, picture.width, picture.height, tile.channels);
    picture[slot].put(tile);
    if (slot === "cells") look.cells = picture.cells;
    stage.touch(tile.source, tile);
  }
}

/** Fill the list of layers, and ask for the one that is chosen. */
function pick() {
  const names = [...new Set(Object.values(pictures).flatMap((picture) => picture.layers))];
  if (names.length && !names.includes(layerName)) layerName = names[0];
  $("layer").replaceChildren(...names.map((name) => new Option(name, name, false, name === layerName)));
  document.querySelector(".two").hidden = !pictures.b;
  want();
}

function want() {
  const layers = [];
  for (const [source, picture] of Object.entries(pictures)) {
    if (picture.shown?.name !== layerName) picture.shown = null;
    if (picture.layers.includes(layerName)) layers.push([source, layerName]);
  }
  const who = $("who").checked && pictures.a?.layers.includes("cell");
  if (who) layers.push(["a", "cell"]);
  look.cells = who ? pictures.a.cells ?? {} : null;
  send({ kind: "want", layers });
  stage.touchAll();
}

// Controls.

function setMode(mode) {
  if (!pictures.b) return;
  look.mode = $("mode").value = mode;
  stage.refresh();
}

function setExposure(stops) {
  look.exposure = Math.min(Math.max(stops, -10), 10);
  $("exposure").value = look.exposure;
  $("stops").textContent = (look.exposure > 0 ? "+" : "") + look.exposure;
  scale();
  stage.touchAll();
}

function autoExpose() {
  const layer = stage.base;
  if (layer && layer.channels === 3) setExposure(autoExposure(layer.data));
}

function chooseExposure(stops) {
  automatic = false;
  setExposure(stops);
}

function setTransform(name) {
  look.transform = $("transform").value = name;
  stage.touchAll();
}

/** Show it as the scene or the person who renders wants it shown, until somebody changes that here. */
function lookAs(wanted) {
  const key = JSON.stringify(wanted);
  if (key === given) return;
  given = key;
  setTransform(wanted.transform);
  automatic = wanted.exposure === null; // then it follows the image as it comes
  if (!automatic) setExposure(wanted.exposure);
}

function setLayer(name) {
  layerName = $("layer").value = name;
  want();
}

function setFalse(on) {
  $("false").checked = look.falseColor = on;
  scale();
  stage.touchAll();
}

function scale() {
  $("scale").hidden = !look.falseColor;
  $("low").textContent = short(10 ** (1 - DECADES) * 2 ** -look.exposure);
  $("high").textContent = short(10 * 2 ** -look.exposure);
}

function showPixel(at) {
  if (!at || !status) return void ($("pixel").hidden = true);
  const words = [`x ${at[0]} y ${at[1]}`];
  for (const source of ["a", "b"]) {
    const values = pictures[source]?.shown?.at(...at);
    if (values) words.push(`${pictures.b ? (source === "a" ? "this " : "other ") : ""}${values.map(short).join(" ")}`);
  }
  const cell = pictures.a?.cells?.at(...at)?.[0];
  if (cell >= 0 && $("who").checked) words.push(`cell ${cell}, slave ${look.holder(Math.round(cell))}`);
  $("pixel").hidden = false;
  $("pixel").textContent = words.join("  |  ");
}

function next(select, step) {
  const count = select.options.length;
  return count ? select.options[(select.selectedIndex + step + count) % count].value : null;
}

const KEYS = {
  "+": () => stage.zoomBy(2), "=": () => stage.zoomBy(2), "-": () => stage.zoomBy(0.5),
  0: () => stage.fit(), 1: () => stage.oneToOne(),
  ArrowLeft: () => stage.pan(60, 0), ArrowRight: () => stage.pan(-60, 0), ArrowUp: () => stage.pan(0, 60), ArrowDown: () => stage.pan(0, -60),
  e: () => chooseExposure(look.exposure + 0.5), E: () => chooseExposure(look.exposure - 0.5),
  a: () => { automatic = false; autoExpose(); }, t: () => setTransform(next($("transform"), 1)),
  f: () => setFalse(!look.falseColor),
  l: () => setLayer(next($("layer"), 1)), L: () => setLayer(next($("layer"), -1)),
  w: () => { $("who").checked = !$("who").checked; want(); },
  c: () => setMode(next($("mode"), 1)),
  x: () => { if (look.mode === "flip") stage.flipped = !stage.flipped; setMode("flip"); },
  d: () => setMode(look.mode === "difference" ? "a" : "difference"),
};

document.addEventListener("keydown", (e) => {
  const typing = /^(SELECT|INPUT)$/.test(e.target.tagName) && e.target.type !== "checkbox";
  if (typing || e.ctrlKey || e.metaKey || e.altKey || !KEYS[e.key]) return;
  e.preventDefault();
  KEYS[e.key]();
});

$("layer").onchange = (e) => setLayer(e.target.value);
$("mode").onchange = (e) => setMode(e.target.value);
$("exposure").oninput = (e) => chooseExposure(Number(e.target.value));
$("auto").onclick = KEYS.a;
$("transform").onchange = (e) => setTransform(e.target.value);
$("false").onchange = (e) => setFalse(e.target.checked);
$("who").onchange = want;
$("in").onclick = () => stage.zoomBy(2);
$("out").onclick = () => stage.zoomBy(0.5);
$("fit").onclick = () => stage.fit();
$("one").onclick = () => stage.oneToOne();
$("enough").onclick = () => send({ kind: "enough" });
$("stop").onclick = ({ target }) => {
  if (target.classList.contains("sure")) send({ kind: "stop" });
  const sure = target.classList.toggle("sure");
  target.textContent = sure ? "Really stop?" : "Stop";
};

const ramp = $("ramp").getContext("2d");
for (let x = 0; x < 256; x++) {
  ramp.fillStyle = `rgb(${viridis(x / 255).map(Math.round)})`;
  ramp.fillRect(x, 0, 1, 10);
}
// For tests and the curious: what the page has, as numbers.
window.wdpm = { pictures, look, stage, get status() { return status; }, get socket() { return socket; } };
connect();
