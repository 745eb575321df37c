// From light to what a screen shows: as wdpm/images/view_transform.py has it, which names the sources.

const clipped = (v) => Math.min(Math.max(v, 0), 1e9);

const hable = (x) => (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
const filmic = (v) => hable(2 * clipped(v)) / hable(11.2);

const AGX_IN = [0.842479062253094, 0.0784335999999992, 0.0792237451477643, 0.0423282422610123, 0.878468636469772, 0.0791661274605434, 0.0423756549057051, 0.0784336, 0.879142973793104];
const AGX_OUT = [1.19687900512017, -0.0980208811401368, -0.0990297440797205, -0.0528968517574562, 1.15190312990417, -0.0989611768448433, -0.0529716355144438, -0.0980434501171241, 1.15107367264116];
const AGX_LOW = -12.47393, AGX_HIGH = 4.026069;
const times = (m, [r, g, b]) => [0, 3, 6].map((i) => m[i] * r + m[i + 1] * g + m[i + 2] * b);

function agxCurve(v) {
  const x = (Math.min(Math.max(Math.log2(Math.max(v, 1e-10)), AGX_LOW), AGX_HIGH) - AGX_LOW) / (AGX_HIGH - AGX_LOW);
  return (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232;
}

function neutral(r, g, b) {
  const least = Math.min(r, g, b), offset = least < 0.08 ? least - 6.25 * least * least : 0.04;
  const light = [r - offset, g - offset, b - offset], peak = Math.max(...light);
  if (peak < 0.76) return light;
  const pressed = 1 - 0.0576 / (peak - 0.52), white = 1 - 1 / (0.15 * (peak - pressed) + 1);
  return light.map((v) => { const squeezed = v * pressed / peak; return squeezed + (pressed - squeezed) * white; });
}

/** By name: linear [r, g, b], exposed, to linear light of the screen. */
export const TRANSFORMS = {
  standard: (r, g, b) => [r, g, b],
  filmic: (r, g, b) => [filmic(r), filmic(g), filmic(b)],
  agx: (r, g, b) => times(AGX_OUT, times(AGX_IN, [clipped(r), clipped(g), clipped(b)]).map(agxCurve)).map((v) => Math.max(v, 0) ** 2.2),
  neutral: (r, g, b) => neutral(clipped(r), clipped(g), clipped(b)),
};

/** Stops that make a picture of three channels neither dark nor burnt out. */
export function autoExposure(data) {
  const luminance = [];
  for (let i = 0; i < data.length; i += 3) {
    const v = 0.2126 * data[i] + 0.7152 * data[i + 1] + 0.0722 * data[i + 2];
    if (v > 0 && v < Infinity) luminance.push(v);
  }
  if (!luminance.length) return 0;
  luminance.sort((a, b) => a - b);
  const lit = luminance.filter((v) => v > luminance.at(-1) * 1e-6);
  const middle = Math.log2(0.18) - lit.reduce((sum, v) => sum + Math.log2(v), 0) / lit.length;
  const at = 0.9 * (luminance.length - 1), low = luminance[Math.floor(at)], high = luminance[Math.ceil(at)];
  return Math.round(Math.min(middle, -Math.log2(low + (high - low) * (at % 1))) * 10) / 10;
}
