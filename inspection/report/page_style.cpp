#include "report/page_style.h"

namespace gantry::report {

const char* const kPageStyle = R"css(
:root {
  color-scheme: light dark;
  --ground: #f4f5f7; --card: #ffffff; --ink: #16191d; --soft: #5d6672; --rule: #dfe3e8; --faint: #eef0f3;
  --pass: #17794a; --fail: #b81f27; --undecided: #a86300; --simulated: #5b3fa8;
  --badge: #16191d; --badge-ink: #ffffff; --halo: #ffffff;
}
@media screen and (prefers-color-scheme: dark) {
  :root {
    --ground: #101317; --card: #181c22; --ink: #e9ecf0; --soft: #9aa4b1; --rule: #2c323b; --faint: #20252c;
    --pass: #2aa56b; --fail: #e0474f; --undecided: #d58a1c; --simulated: #9a80ea;
    --badge: #f2f4f7; --badge-ink: #14171b; --halo: #101317;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--ground); color: var(--ink);
  font: 15px/1.5 -apple-system, "Segoe UI", Roboto, "Helvetica Neue", "Liberation Sans", Arial, system-ui, sans-serif;
  font-variant-numeric: tabular-nums; -webkit-print-color-adjust: exact; print-color-adjust: exact;
}
main { max-width: 1180px; margin: 0 auto; padding: 36px 28px 56px; }
header { display: flex; justify-content: space-between; align-items: flex-end; gap: 24px; margin-bottom: 22px; }
.kicker { color: var(--soft); font-size: 12.5px; letter-spacing: .09em; text-transform: uppercase; }
h1 { font-size: 34px; line-height: 1.15; letter-spacing: -.015em; font-weight: 650; margin: 4px 0 0; overflow-wrap: anywhere; }
h2 { font-size: 19px; letter-spacing: -.005em; font-weight: 640; margin: 44px 0 4px; }
h3 { font-size: 14px; font-weight: 640; margin: 0 0 8px; }
p { margin: 0 0 12px; }
.lead { color: var(--soft); max-width: none; }
.date { text-align: right; color: var(--soft); white-space: nowrap; }
.simulated {
  display: inline-block; margin-bottom: 6px; padding: 3px 11px; border: 1.5px solid var(--simulated); border-radius: 5px;
  color: var(--simulated); font-weight: 700; font-size: 13px; letter-spacing: .08em;
}
.card { background: var(--card); border: 1px solid var(--rule); border-radius: 10px; }
.verdict { display: flex; overflow: hidden; }
.verdict .badge-box {
  flex: none; display: flex; align-items: center; gap: 14px; padding: 24px 34px; color: #fff;
  font-size: 34px; font-weight: 750; letter-spacing: .03em;
}
.verdict svg { width: 38px; height: 38px; fill: none; stroke: #fff; stroke-width: 3.4; stroke-linecap: round; stroke-linejoin: round; }
.verdict .reason { padding: 18px 28px; font-size: 18px; line-height: 1.45; align-self: center; overflow-wrap: anywhere; }
.pass .badge-box { background: var(--pass); } .fail .badge-box { background: var(--fail); }
.undecided .badge-box { background: var(--undecided); }
.figures { display: grid; grid-template-columns: repeat(5, auto); margin-top: 14px; }
.figures div { padding: 14px 20px 15px; border-left: 1px solid var(--rule); }
.figures div:first-child { border-left: 0; }
.figures dt, .figures span { color: var(--soft); font-size: 13px; }
.figures b { display: block; font-size: 22px; line-height: 1.25; font-weight: 620; letter-spacing: -.01em; white-space: nowrap; }
.scale { display: flex; align-items: center; justify-content: center; flex-wrap: wrap; gap: 4px 30px; padding: 14px 18px; margin: 14px 0; }
.scale .legend { width: 640px; max-width: 100%; }
.keys { font-size: 13px; color: var(--soft); max-width: 360px; }
.keys div { display: flex; gap: 10px; align-items: baseline; margin: 3px 0; }
.swatch { flex: none; width: 26px; height: 13px; border-radius: 3px; transform: translateY(1px); }
.outline { border: 2px solid var(--ink); border-radius: 7px; }
.views { display: grid; grid-template-columns: 1fr 1fr; gap: 14px; }
.close-ups { display: grid; grid-template-columns: repeat(4, 1fr); gap: 14px; margin-top: 14px; }
figure { margin: 0; overflow: hidden; break-inside: avoid; }
figcaption { padding: 10px 14px 0; font-size: 13.5px; color: var(--soft); display: flex; justify-content: space-between; gap: 8px; }
figcaption b { color: var(--ink); font-weight: 620; }
svg { display: block; }
svg.view { width: 100%; height: auto; }
.close-ups figcaption { padding-bottom: 9px; }
.view text { font-size: 20px; fill: var(--ink); }
.close-ups .view text { font-size: 22px; }
.view .number { font-size: 18px; font-weight: 700; fill: var(--badge-ink); text-anchor: middle; }
.view .small { fill: var(--soft); }
.view .bar { fill: none; stroke: var(--ink); stroke-width: 2; }
.view .axis { fill: none; stroke: var(--soft); stroke-width: 2; stroke-linecap: round; }
.view .leader { fill: none; stroke: var(--badge); stroke-width: 2; }
.view .halo { fill: none; stroke: var(--halo); stroke-width: 5; stroke-opacity: .75; }
.view .dot { fill: var(--badge); stroke: var(--halo); stroke-width: 1.5; }
.view .badge { fill: var(--badge); stroke: var(--halo); stroke-width: 2; }
.chart, .legend { width: 100%; height: auto; }
.chart text, .legend text { font-size: 12px; fill: var(--soft); }
.chart .strong, .legend .strong { fill: var(--ink); font-weight: 640; }
.grid { stroke: var(--rule); } .frame { stroke: var(--soft); }
.limit { stroke: var(--ink); stroke-width: 1.5; fill: none; } 
.gauss { fill: none; stroke: var(--ink); stroke-width: 2; } .gauss.all { stroke: var(--soft); stroke-width: 1.8; stroke-dasharray: 6 4; }
.pair { display: grid; grid-template-columns: 1fr 1fr; gap: 14px; margin-top: 14px; }
.panel { padding: 16px 20px 18px; break-inside: avoid; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
th, td { text-align: left; padding: 7px 10px; border-top: 1px solid var(--rule); vertical-align: top; }
thead th { border-top: 0; color: var(--soft); font-weight: 560; font-size: 12.5px; vertical-align: bottom; }
tbody th { font-weight: 500; color: var(--soft); white-space: nowrap; }
tbody tr:first-child th, tbody tr:first-child td { border-top: 0; }
thead + tbody tr:first-child td { border-top: 1px solid var(--rule); }
td.n, th.n { text-align: right; white-space: nowrap; }
td.text { overflow-wrap: anywhere; }
tr { break-inside: avoid; }
.defects { margin-top: 14px; padding: 10px 8px; overflow-x: auto; }
.defects .no { font-weight: 700; }
.chip { display: inline-block; padding: 0 9px; border-radius: 99px; font-size: 12.5px; font-weight: 620; border: 1px solid; white-space: nowrap; }
.chip.yes { color: var(--fail); } .chip.no { color: var(--undecided); }
.none { padding: 18px 20px; margin-top: 14px; color: var(--soft); }
.notes { padding: 18px 24px 8px; margin-top: 14px; columns: 2; column-gap: 40px; font-size: 14px; }
.notes p { break-inside: avoid; } .notes b { font-weight: 640; }
footer { margin-top: 34px; color: var(--soft); font-size: 12.5px; }
@media screen and (max-width: 820px) {
  .views, .pair { grid-template-columns: 1fr; } .close-ups { grid-template-columns: 1fr 1fr; } .notes { columns: 1; }
  .figures { grid-template-columns: 1fr 1fr; } .verdict, header { flex-direction: column; align-items: stretch; }
  .date { text-align: left; }
}
@media print {
  @page { size: A4; margin: 13mm 12mm; }
  :root { --ground: #fff; }
  body { font-size: 10.5px; } main { max-width: none; padding: 0; }
  h1 { font-size: 25px; } h2 { font-size: 14.5px; margin-top: 18px; break-after: avoid; }
  .lead { break-after: avoid; break-inside: avoid; } .pair, .notes { break-inside: avoid; }
  .verdict .badge-box { font-size: 24px; padding: 14px 22px; } .verdict svg { width: 26px; height: 26px; }
  .verdict .reason { font-size: 13px; padding: 10px 18px; }
  .figures { grid-template-columns: repeat(5, 1fr); } .figures b { font-size: 16px; } .figures div { padding: 8px 12px; }
  .figures dt, .figures span, .kicker, .keys, figcaption, thead th, footer { font-size: 9.5px; }
  .views, .pair { grid-template-columns: 1fr 1fr; gap: 9px; } .close-ups { grid-template-columns: repeat(4, 1fr); gap: 9px; }
  .card { border-radius: 6px; } .scale { margin: 9px 0; padding: 8px; break-inside: avoid; } .scale .legend { width: 420px; }
  .chart { max-height: 160px; } .keys { max-width: 240px; } table { font-size: 10px; } th, td { padding: 3px 7px; } .chip { font-size: 9px; padding: 0 6px; }
  .notes { font-size: 9.5px; columns: 2; padding: 11px 15px 3px; } .notes p { margin-bottom: 7px; } footer { margin-top: 12px; } .panel { padding: 10px 13px; } h3 { font-size: 11px; }
}
)css";

}  // namespace gantry::report
