#pragma once

namespace inceres::tools {

/// The style sheet of BalPageHtml: colors by role, for light and dark screens.
inline constexpr char kPageStyle[] = R"css(
:root {
  color-scheme: light dark;
  --paper: #f6f7f9; --card: #fff; --ink: #1c2430; --soft: #5d6877; --line: #e3e7ec; --axis: #707b8a;
  --before: #d9772b; --after: #2467c9; --point: #5b7c99; --camera: #d0451b;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #12161c; --card: #1a2029; --ink: #e6eaf0; --soft: #9ba7b6; --line: #2a323d;
    --axis: #8f9bab; --before: #f09a52; --after: #6ea8ff; --point: #8fb0cd; --camera: #ff8a5c;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; }
main { max-width: 1100px; margin: 0 auto; padding: 28px 20px 60px; display: grid; gap: 16px;
  grid-template-columns: repeat(2, minmax(0, 1fr)); }
main > * { grid-column: 1 / -1; }
main > .half { grid-column: span 1; }
h1 { margin: 0; font-size: 24px; overflow-wrap: anywhere; }
h2 { margin: 0 0 2px; font-size: 16px; }
header p, .note { margin: 2px 0 8px; color: var(--soft); font-size: 13px; }
.card, .tile { background: var(--card); border: 1px solid var(--line); border-radius: 12px; }
.card { padding: 18px 20px; min-width: 0; }
.tiles { display: grid; grid-template-columns: repeat(4, 1fr); gap: 12px; }
.tile { padding: 14px 18px; }
.tile p { margin: 0; color: var(--soft); font-size: 13px; }
.tile .big { font-size: 22px; font-weight: 650; color: var(--ink);
  font-variant-numeric: tabular-nums; }
figure { margin: 6px 0 0; }
figcaption { color: var(--soft); font-size: 13px; margin-top: 4px; }
svg { display: block; width: 100%; height: auto; }
svg.narrow { display: none; }
svg text { font-size: 12px; fill: var(--axis); }
svg text.tick, svg text.last { text-anchor: end; }
svg text.mid { text-anchor: middle; }
.frame { fill: var(--paper); stroke: var(--line); }
.points { stroke: var(--point); stroke-width: 1.4; stroke-linecap: round; stroke-opacity: .6;
  fill: none; }
.camera { fill: var(--camera); fill-opacity: .8; stroke: var(--camera); stroke-width: .6; }
.grid { stroke: var(--line); fill: none; }
.zero { stroke: var(--axis); fill: none; }
.curve { stroke: var(--after); stroke-width: 2; fill: none; }
.accepted { fill: var(--after); }
.rejected { fill: var(--card); stroke: var(--axis); }
rect.before { fill: var(--before); }
rect.after { fill: var(--after); }
.key::before { content: ""; display: inline-block; width: 10px; height: 10px; border-radius: 3px;
  margin-right: 6px; }
.key { margin-right: 16px; }
.key.before::before { background: var(--before); }
.key.after::before { background: var(--after); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line);
  vertical-align: top; overflow-wrap: anywhere; }
th { color: var(--soft); font-weight: 600; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
tr:last-child > * { border-bottom: 0; }
@media (max-width: 720px) {
  main { grid-template-columns: minmax(0, 1fr); padding: 16px 12px 40px; gap: 12px; }
  main > .half { grid-column: 1 / -1; }
  .tiles { grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 10px; }
  .tile { padding: 12px 14px; }
  .card { padding: 14px; }
  svg.wide { display: none; }
  svg.narrow { display: block; }
}
@media print { body { background: #fff; } .card, .tile { break-inside: avoid; } }
)css";

}  // namespace inceres::tools
