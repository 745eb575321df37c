"""The looks of the page of a sweep, as CSS: light and dark, one column on a phone.

A string and not a file of its own, since the page carries it within: a page that is moved or mailed keeps its looks.
"""

STYLE = """
:root {
  color-scheme: light dark;
  --back: #fbfaf8; --card: #ffffff; --ink: #1d1f23; --soft: #5d636e; --rule: #e2e0db; --warn: #8a4b00;
  --noise: #3f7fd1; --bias: #e08a3c;
  --c0: #2f6fc4; --c1: #d1672b; --c2: #23875c; --c3: #9051bd; --c4: #c23b4b; --c5: #0f8a9b; --c6: #87791a;
    --c7: #6b6f78;
}
@media (prefers-color-scheme: dark) {
  :root {
    --back: #15171b; --card: #1d2025; --ink: #e9e7e2; --soft: #a2a7b0; --rule: #33373f; --warn: #f0b35c;
    --noise: #5b98e6; --bias: #f0a35c;
    --c0: #6aa5f0; --c1: #f0935c; --c2: #56c193; --c3: #c191ea; --c4: #f07c88; --c5: #4fc4d4; --c6: #cdbb4d;
      --c7: #a5a9b3;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--back); color: var(--ink); font: 17px/1.55 system-ui, -apple-system, "Segoe UI",
  Roboto,
  "DejaVu Sans", sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 40px 24px 80px; }
h1 { font-size: 2.1rem; line-height: 1.15; margin: 0 0 6px; letter-spacing: -0.02em; text-wrap: balance; }
h2 { font-size: 1.35rem; margin: 0 0 4px; letter-spacing: -0.01em; }
h3 { font-size: 1rem; margin: 0 0 8px; }
section { margin-top: 52px; }
section > p, li { color: var(--soft); max-width: 46em; margin: 0 0 14px; }
li { margin: 0 0 6px; }
.facts { color: var(--soft); margin: 0 0 22px; font-size: 0.92rem; overflow-wrap: anywhere; }
.lede { font-size: 1.18rem; line-height: 1.55; max-width: 42em; margin: 0; }
.warn { color: var(--warn); max-width: 46em; margin: 14px 0 0; }
.plot, .panel, .small > svg { background: var(--card); border: 1px solid var(--rule); border-radius: 10px; }
.plot { padding: 10px; }
svg { display: block; width: 100%; height: auto; }
.grid { stroke: var(--rule); fill: none; }
.tick, .axis, .title, .label, .basetext { font: 13px system-ui, "DejaVu Sans", sans-serif; fill: var(--soft); }
.axis { font-style: italic; }
.title { fill: var(--ink); font-weight: 600; font-size: 14px; }
.label { fill: var(--c); font-weight: 600; paint-order: stroke; stroke: var(--card); stroke-width: 4px; }
.basetext { fill: var(--ink); font-weight: 700; paint-order: stroke; stroke: var(--card); stroke-width: 4px; }
.best { list-style: none; padding: 0; margin: 0; border: 1px solid var(--rule); border-radius: 10px;
  background: var(--card); }
.best li { max-width: none; margin: 0; padding: 12px 16px; border-top: 1px solid var(--rule); color: var(--ink); }
.best li:first-child { border-top: 0; }
.best p { margin: 0 0 4px; display: flex; flex-wrap: wrap; gap: 2px 18px; font-variant-numeric: tabular-nums; }
.best span, .best code { color: var(--soft); }
.loose { stroke-dasharray: 2 4; }
.line { stroke: var(--c); stroke-width: 2.2; fill: none; stroke-linejoin: round; }
.mark { fill: var(--c); stroke: var(--card); stroke-width: 1.2; }
.whisker { stroke: var(--c); stroke-width: 1.3; opacity: 0.4; }
.base { fill: var(--card); stroke: var(--ink); stroke-width: 3; }
.front { stroke: var(--soft); stroke-width: 1.4; stroke-dasharray: 5 4; fill: none; opacity: 0.8; }
.c0 { --c: var(--c0); } .c1 { --c: var(--c1); } .c2 { --c: var(--c2); } .c3 { --c: var(--c3); }
.c4 { --c: var(--c4); } .c5 { --c: var(--c5); } .c6 { --c: var(--c6); } .c7 { --c: var(--c7); }
.legend { display: flex; flex-wrap: wrap; gap: 6px 18px; margin: 12px 2px 0; color: var(--ink); font-size: 0.92rem; }
.panels + .legend, .legend + .panels { margin-top: 12px; }
.chip { display: inline-flex; align-items: center; gap: 6px; }
.chip svg { width: 18px; } .chip.long svg { width: 22px; }
.swatch { width: 14px; height: 14px; border-radius: 3px; }
.noise { background: var(--noise); } .bias { background: var(--bias); }
.panels { display: grid; grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); gap: 14px; }
.panel { padding: 14px 16px 10px; margin: 0; }
.bar { display: grid; grid-template-columns: 4.6em 1fr 4.4em; gap: 10px; align-items: center; font-size: 0.86rem;
  padding: 3px 0; font-variant-numeric: tabular-nums; }
.bar .value { text-align: right; color: var(--soft); } .bar .sum { text-align: left; }
.bar.own .value, .bar.own .sum { color: var(--ink); font-weight: 700; }
.track { position: relative; display: flex; height: 15px; }
.track i { height: 100%; } .track i:first-child { border-radius: 3px 0 0 3px; }
.track b { position: absolute; top: 6.5px; height: 2px; background: var(--ink); opacity: 0.75; }
.small { display: grid; grid-template-columns: repeat(auto-fill, minmax(215px, 1fr)); gap: 14px; }
.wide { overflow-x: auto; border: 1px solid var(--rule); border-radius: 10px; background: var(--card); }
table { border-collapse: collapse; width: 100%; font-size: 0.88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: 7px 12px; border-top: 1px solid var(--rule); white-space: nowrap;
  vertical-align: top; }
thead th { border-top: 0; color: var(--soft); font-weight: 600; }
th:last-child, td:last-child { text-align: left; }
table td:first-child, table th:first-child { text-align: left; }
code { font: 0.84rem/1.45 ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace; white-space: pre-wrap;
  overflow-wrap: anywhere; display: inline-block; min-width: 22em; }
summary { cursor: pointer; color: var(--c0); }
.strip { display: grid; grid-template-columns: repeat(auto-fill, minmax(200px, 256px)); gap: 12px;
  margin-bottom: 22px; }
figure { margin: 0; }
.pic { width: 100%; background-size: cover; border-radius: 6px; background-color: var(--rule); }
figcaption { font-size: 0.88rem; margin-top: 5px; display: flex; justify-content: space-between; gap: 8px; }
figcaption small { color: var(--soft); }
.scale { font-size: 0.92rem; } .scale .magma { display: inline-block; width: 110px; height: 12px; border-radius: 3px;
  margin: 0 8px; vertical-align: -1px; }
@media (max-width: 640px) {
  main { padding: 24px 14px 60px; }
  body { font-size: 16px; } h1 { font-size: 1.6rem; } .lede { font-size: 1.06rem; }
  section { margin-top: 40px; } .plot { padding: 4px; }
  .panels { grid-template-columns: 1fr; } .small { gap: 8px; }
  .strip { grid-template-columns: 1fr 1fr; gap: 8px; }
  .plot .tick, .plot .axis, .plot .label, .plot .basetext { font-size: 18px; }
}
"""
