// What stands beside the image: phases, slaves, notes, the error as it falls.

import { slaveColor } from "./pixels.js";

const $ = (id) => document.getElementById(id);

export function time(seconds) {
  const s = Math.round(seconds);
  if (s < 60) return `${s} s`;
  return s < 3600 ? `${Math.floor(s / 60)} min ${s % 60} s` : `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}

function bytes(count) {
  const units = ["B", "KiB", "MiB", "GiB", "TiB"];
  let unit = 0;
  for (; count >= 1024 && unit < units.length - 1; unit++) count /= 1024;
  return `${count < 10 && unit ? count.toFixed(1) : Math.round(count)} ${units[unit]}`;
}

/** Show a status (docs/view.md). */
export function show(status, connected) {
  document.title = `${status.title} - wdpm`;
  $("title").textContent = status.title;
  $("phase").textContent = phase(status);
  $("done").style.width = status.total ? `${(100 * status.done) / status.total}%` : "0";
  const over = status.ended !== null || !connected;
  $("stop").disabled = over;
  $("save").hidden = over || !status.pictures.a.layers.length || !status.slaves.length;
  $("enough").hidden = !status.passes;
  $("enough").disabled = over || status.enough;
  $("enough").textContent = status.enough ? "Ends after this pass" : "Good enough: save";
  $("errors").hidden = status.errors.length === 0;
  $("slaves").hidden = status.slaves.length === 0;
  $("lines").hidden = status.notes.length === 0;
  rows(status.slaves);
  notes(status.notes);
  if (status.errors.length) chart(status.errors);
}

function phase(status) {
  if (status.ended !== null) return status.ended;
  if (!status.phase) return "";
  const done = status.total ? `, ${status.done.toLocaleString("en")} of ${status.total.toLocaleString("en")}` : "";
  const left = status.left === null ? "" : `, about ${time(status.left)} left`;
  const frames = status.frames > 1 ? `pass ${status.frames}, ` : "";
  const name = status.phase === "passes" ? "buckets of all passes" : status.phase;
  return `${frames}${name}${done}${left}, ${time(status.seconds)} so far`;
}

function rows(slaves) {
  $("rows").replaceChildren(...slaves.map((slave, number) => {
    const f = slave.figures;
    const row = Object.assign(document.createElement("li"), { className: "slave", textContent: `${number}: ${slave.name}` });
    row.style.borderColor = `rgb(${slaveColor(number)})`;
    row.classList.toggle("lost", slave.lost);
    const holds = slave.lost ? "lost" : slave.whole ? "the whole scene" : count(slave.holds, "cell");
    row.append(small(`${holds}, ${count(slave.buckets, "bucket")}${slave.silent === null ? "" : `, the last ${time(slave.silent)} ago`}`));
    if (slave.now) row.append(small(`now ${bytes(slave.now.memory)} memory, ${slave.now.cores.toFixed(1)} cores, ${bytes(slave.now.received)}/s in, ${bytes(slave.now.sent)}/s out`));
    if (f) row.append(small(`busy ${time(f.busy_s)}, ${bytes(f.peak_memory_bytes)} memory, ${bytes(f.bytes_in)} in, ${bytes(f.bytes_out)} out, ${slave.dropped} dropped or cut`));
    return row;
  }));
}

const count = (number, what) => `${number.toLocaleString("en")} ${what}${number === 1 ? "" : "s"}`;
const small = (text) => Object.assign(document.createElement("small"), { textContent: text });

function notes(lines) {
  const list = $("notes");
  if (list.childElementCount === lines.length && list.lastChild?.textContent === lines.at(-1)) return;
  list.replaceChildren(...lines.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
  list.scrollTop = list.scrollHeight;
}

/** relMSE with its interval against seconds, both logarithmic. */
function chart(errors) {
  const canvas = $("chart"), ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  const [, spp, value, low, high] = errors.at(-1);
  $("error").textContent = `relMSE ${value.toPrecision(2)} (${low.toPrecision(2)} to ${high.toPrecision(2)}) at ${spp} samples`;
  if (!width) return;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const log = (v) => Math.log10(Math.max(v, 1e-12));
  const t0 = log(errors[0][0]), t1 = Math.max(log(errors.at(-1)[0]), t0 + 0.1);
  const known = errors.flatMap((e) => [e[2], e[4], e[3]]).filter((v) => v > 0).map(log);
  const e1 = Math.max(...known), e0 = Math.max(Math.min(...known), e1 - 4);
  const x = (t) => 44 + ((width - 54) * (log(t) - t0)) / (t1 - t0);
  const y = (e) => 8 + ((height - 26) * (e1 - Math.min(Math.max(log(e), e0), e1))) / Math.max(e1 - e0, 0.1);
  context.fillStyle = "#ffb45433";
  context.beginPath();
  errors.forEach((e) => context.lineTo(x(e[0]), y(e[4])));
  [...errors].reverse().forEach((e) => context.lineTo(x(e[0]), y(e[3])));
  context.fill();
  context.strokeStyle = context.fillStyle = "#ffb454";
  context.beginPath();
  errors.forEach((e) => context.lineTo(x(e[0]), y(e[2])));
  context.stroke();
  errors.forEach((e) => context.fillRect(x(e[0]) - 2, y(e[2]) - 2, 4, 4));
  context.fillStyle = "#9aa1aa";
  context.font = "11px system-ui, sans-serif";
  context.fillText((10 ** e1).toPrecision(2), 2, 14);
  context.fillText((10 ** e0).toPrecision(2), 2, height - 20);
  context.fillText(time(errors[0][0]), 44, height - 4);
  const last = time(errors.at(-1)[0]);
  context.fillText(last, width - 6 - context.measureText(last).width, height - 4);
}
