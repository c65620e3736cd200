"""The style sheet of the report of a reproduction."""

from orchid_uav.experiments.pages import style_sheet

_LIGHT = "--holds: #146c43; --partly: #8a5a00; --fails: #a3201a; --open: #3d5a80;"
_DARK = "--holds: #6fcf97; --partly: #f0b45a; --fails: #ff9a91; --open: #9cc2f0;"

_RULES = """
body { max-width: 80rem; }
a { color: var(--accent); }
.headline { font-size: 1.15rem; max-width: 50rem; }
.banner { border: 3px solid var(--fails); border-radius: 8px; padding: 0.75rem 1rem;
  max-width: none; background: var(--panel); }
.banner strong { display: block; color: var(--fails); font-size: 1.5rem; letter-spacing: 0.05em; }
.badge { display: inline-block; border: 1.5px solid currentcolor; border-radius: 1rem;
  padding: 0 0.55rem; font-size: 0.85rem; font-weight: 650; line-height: 1.5; white-space: nowrap; }
.badge.holds { color: var(--holds); } .badge.partly { color: var(--partly); }
.badge.fails { color: var(--fails); } .badge.open { color: var(--open); border-style: dashed; }
.badge.untestable { color: var(--quiet); border-style: dotted; }
.tiles { display: flex; flex-wrap: wrap; gap: 0.75rem; margin: 1rem 0; max-width: none; }
.tiles div { background: var(--panel); border-radius: 8px; padding: 0.7rem 0.9rem; display: flex;
  flex-direction: column-reverse; gap: 0.3rem; }
.tiles dd { margin: 0; font-size: 1.7rem; font-weight: 650; line-height: 1.1; }
td small, th small { color: var(--quiet); font-size: 0.86em; }
.claims td, .claims th { white-space: normal; }
.claims td:nth-child(2) { min-width: 15rem; } .claims td:nth-child(4) { min-width: 13rem; }
.claims td > span, .claims td > small { display: block; }
.claims td > .badge { display: inline-block; }
.claims td:nth-child(3) small { margin-top: 0.25rem; }
.claims td:nth-child(3) { white-space: nowrap; }
.claims td:nth-child(5), .claims td:nth-child(6), .claims td:nth-child(7) { white-space: nowrap; }
.claim { border-top: 1px solid var(--line); margin: 0; padding: 0.45rem 0; }
.claim > summary { font-weight: 400; } .claim[open] { padding-bottom: 1rem; }
.claim .badge { margin: 0 0.3rem; }
.claim caption { position: absolute; clip-path: inset(50%); }
.wrapped { white-space: normal; min-width: 14rem; overflow-wrap: anywhere; }
.dense table { font-size: 0.8rem; } .dense th, .dense td { padding-right: 0.7rem; }
tr.first > * { border-top: 2px solid var(--line); }
.picture { background: #fff; border: 1px solid var(--line); border-radius: 8px; padding: 0.5rem;
  overflow-x: auto; max-width: 62rem; }
.picture img { display: block; width: 100%; min-width: 40rem; height: auto; }
figure { margin: 1.5rem 0 2.5rem; } figure > p, figcaption, figure details { max-width: 62rem; }
:target { scroll-margin-top: 1rem; }
nav ul { columns: 18rem; list-style: none; padding: 0; }
nav li { margin: 0; padding: 0.15rem 0; break-inside: avoid; }
@media screen and (max-width: 48rem) {
  .claims .wide { overflow: visible; }
  .claims table, .claims tbody, .claims tr, .claims td, .claims caption { display: block; }
  .claims thead { position: absolute; clip-path: inset(50%); width: 1px; overflow: hidden; }
  .claims tr { border-top: 2px solid var(--line); padding: 0.5rem 0; }
  .claims th, .claims td { border: 0; padding: 0.15rem 0; min-width: 0 !important; }
  .claims td::before { content: attr(data-label) ": "; color: var(--quiet); font-size: 0.86em; }
  .claims td:nth-child(2)::before, .claims td:nth-child(3)::before { content: none; }
}
"""

_PRINT = """
@page { size: A4; margin: 12mm 11mm; }
@media print {
  body { max-width: none; padding: 0; font-size: 8.5pt; line-height: 1.3; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  h1 { font-size: 15pt; } h3 { font-size: 9.5pt; break-after: avoid; }
  h2 { font-size: 11.5pt; margin: 5mm 0 1mm; padding-top: 1mm; border-top-width: 1px;
    break-after: avoid; }
  p, ul, dl, figcaption, figure > p, figure details { max-width: none; margin: 1mm 0; }
  nav { display: none; } a { color: inherit; text-decoration: none; }
  .quiet, figcaption, table, .glossary { font-size: 7.2pt; }
  tr, .tiles div, .banner, .glossary dd, .claim, .claim .wide { break-inside: avoid; }
  thead { display: table-header-group; break-after: avoid; } caption { break-after: avoid; }
  figure { break-inside: avoid; margin: 3mm 0; } .badge { font-size: 1em; padding: 0 0.4em; }
  .picture { border: 0; padding: 0; max-width: 178mm; overflow: visible; }
  .picture img { min-width: 0; max-height: 200mm; width: auto; max-width: 100%; margin: 0 auto; }
  .wide { overflow: visible; margin: 1mm 0; }
  th, td { padding: 0.4mm 1.6mm 0.4mm 0; white-space: normal; } tbody th { position: static; }
  .claims td, .wrapped { min-width: 0 !important; }
  .claims td:nth-child(2) { width: 26%; } .claims td:nth-child(4) { width: 26%; }
  .dense table { font-size: 6.2pt; } .dense th, .dense td { padding-right: 1mm; }
  .tiles { gap: 2mm; } .tiles div { padding: 1mm 2mm; } .tiles dd { font-size: 12pt; }
  details::details-content { content-visibility: visible; display: block; height: auto; }
  .claim table { width: 100%; } summary { list-style: none; }
  .claim > summary { break-after: avoid; }
  code { font-size: 0.92em; padding: 0 0.2em; }
}
"""


def report_style() -> str:
    """The style sheet of the page."""
    return style_sheet(_RULES + _PRINT, _LIGHT, _DARK)
