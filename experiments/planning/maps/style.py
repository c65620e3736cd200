"""The style sheet of the report: light and dark, telephone, laptop and print."""

from orchid_uav.experiments.pages import style_sheet
from orchid_uav.experiments.planning.maps.colours import ON_DARK, ON_WHITE

_PAGE = """
.headline { font-size: 1.2rem; line-height: 1.4; max-width: 50rem; }
.verdict { border-left: 4px solid var(--bad); padding: 0.1rem 0 0.1rem 0.75rem; }
.verdict.met { border-color: var(--good); }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(8.2rem, 1fr)); gap: 0.75rem;
  margin: 1rem 0; max-width: none; }
.tiles div { background: var(--panel); border-radius: 8px; padding: 0.7rem 0.9rem; }
.tiles dt { color: var(--quiet); font-size: 0.86rem; line-height: 1.35; }
.tiles dd { margin: 0 0 0.15rem; font-size: 1.4rem; font-weight: 650; line-height: 1.25;
  white-space: nowrap; }
.tiles div { display: flex; flex-direction: column-reverse; justify-content: flex-end; }
.share { display: flex; height: 1.5rem; border-radius: 6px; overflow: hidden; gap: 2px;
  background: var(--page); }
.share i { min-width: 4px; } .share .by-drones { background: var(--accent); }
.share .by-masts { background: var(--mast); } .share .unserved { background: var(--ink); }
.keys { display: flex; flex-wrap: wrap; gap: 0.25rem 1.1rem; list-style: none; padding: 0;
  margin: 0.5rem 0; max-width: none; font-size: 0.9rem; }
.keys li { display: flex; align-items: center; gap: 0.4rem; margin: 0; }
.keys svg { flex: none; width: 1.4rem; height: 1.4rem; overflow: visible; }
.swatch { flex: none; width: 0.9rem; height: 0.9rem; border-radius: 3px; }
.swatch.by-drones { background: var(--accent); } .swatch.by-masts { background: var(--mast); }
.swatch.unserved { background: var(--ink); }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr));
  gap: 0.5rem 2rem; align-items: start; }
.beside { display: grid; grid-template-columns: minmax(0, 1fr); gap: 0.5rem 2.5rem;
  align-items: start; }
.beside table { font-size: 0.84rem; } .beside th, .beside td { padding-right: 0.7rem; }
.beside tbody th { white-space: normal; min-width: 8.5rem; }
.map-figure { display: grid; grid-template-columns: minmax(0, 1fr); gap: 0.25rem 1.25rem; }
@media (min-width: 60rem) {
  .beside { grid-template-columns: minmax(0, 1fr) minmax(0, 2fr); }
  .map-figure { grid-template-columns: minmax(0, 1fr) 12rem; }
  .map-figure .keys { flex-direction: column; flex-wrap: nowrap; margin-top: 2.8rem; }
  .map-figure figcaption { grid-column: 1 / -1; } }
tr.chosen > * { background: var(--panel); font-weight: 600; }
td small { color: var(--quiet); font-size: 1em; }
.mark { width: 1.1em; height: 1.1em; vertical-align: -0.18em; margin-right: 0.4em;
  overflow: visible; }
@media (max-width: 34rem) { .headline { font-size: 1.08rem; } }
"""

_MAP = """
.map-box { position: relative; }
.map { display: block; width: 100%; height: auto; border: 1px solid var(--line);
  border-radius: 8px; --k: 30; --size: 1; }
@media (min-width: 30rem) { .map { --k: 21; } }
@media (min-width: 40rem) { .map { --k: 16; } }
@media (min-width: 60rem) { .map { --k: 13; } }
.map .scaled { transform: scale(calc(var(--k) * var(--size))); }
.map path { fill: none; stroke-linejoin: round; }
.ground { fill: var(--page); }
.map .area { stroke: var(--quiet); stroke-width: calc(var(--k) * 1.4px);
  stroke-dasharray: calc(var(--k) * 7px) calc(var(--k) * 4px); }
.map .no-fly path { fill: url(#hatch); }
.map .no-fly-border { stroke: var(--zone); stroke-width: calc(var(--k) * 1.8px); }
.hatch path { stroke: var(--zone); stroke-width: 1.6px; opacity: 0.75; }
.map .drone { --c: var(--ink); }
.cells path { fill: var(--c) !important; fill-opacity: 0.09; stroke: var(--c);
  stroke-opacity: 0.55; stroke-width: calc(var(--k) * 1px); }
.circles path { fill: var(--c) !important; fill-opacity: 0.2; stroke: var(--c);
  stroke-width: calc(var(--k) * 1.6px); }
.ways path { stroke: var(--c); stroke-width: calc(var(--k) * 1.1px);
  stroke-dasharray: calc(var(--k) * 2px) calc(var(--k) * 3px); }
.dots path { stroke: var(--c); stroke-linecap: round; }
.dots.by-mast path { stroke: var(--mast); stroke-linecap: square; }
.dots .core, .dots.by-mast .core { stroke: var(--page); }
.cross { overflow: visible; }
.cross path { fill: none; stroke: var(--ink); stroke-width: 2.4px; stroke-linecap: round; }
.cross .halo { stroke: var(--page); stroke-width: 5px; }
.map .mast path, .map .home path { fill: var(--ink); }
.map .halo { stroke: var(--page); stroke-width: 4px; fill: var(--page); }
.map .pin { fill: var(--c); stroke: var(--page); stroke-width: 2px; }
.map text { font: 700 11px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
  text-anchor: middle; fill: var(--ink); unicode-bidi: isolate; }
.station text { fill: var(--on-c) !important; }
.scale-bar > path { stroke: var(--ink); stroke-width: calc(var(--k) * 2px); }
.scale-bar > path.halo { stroke: var(--page); stroke-width: calc(var(--k) * 5px); fill: none; }
.map .scale-bar text { text-anchor: start; }
.map .north path { fill: var(--ink); }
.toggle { position: absolute; opacity: 0; }
.toggle + label { display: inline-block; border: 1px solid var(--line); border-radius: 1rem;
  padding: 0.15rem 0.75rem; margin: 0 0.35rem 0.5rem 0; font-size: 0.88rem; cursor: pointer;
  color: var(--quiet); text-decoration: line-through; }
.toggle:checked + label { background: var(--panel); color: var(--ink); text-decoration: none; }
.toggle:focus-visible + label { outline: 2px solid var(--accent); outline-offset: 2px; }
"""

_CHARTS = """
.chart { display: block; width: 100%; max-width: 27rem; height: auto; }
.chart text { font: 12.5px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
  fill: var(--quiet); }
.chart .value { fill: var(--ink); font-weight: 600; }
.chart .name { fill: var(--ink); }
.chart .halo { stroke: var(--page); stroke-width: 4px; }
.c-drone { fill: var(--accent); } .c-mast { fill: var(--mast); } .c-unserved { fill: var(--ink); }
.chart .axis { stroke: var(--quiet); } .chart .grid { stroke: var(--grid); }
.chart .want { stroke: var(--ink); stroke-dasharray: 4 3; }
.chart .range { stroke: var(--accent); stroke-width: 2; }
.chart .band { stroke: var(--panel); stroke-width: 34; }
.chart path.line-served, .chart path.line-want { fill: none; stroke-width: 2.2; }
.chart path.line-served { stroke: var(--accent); }
.chart circle.line-served { fill: var(--accent); }
.chart path.line-want { stroke: var(--warm); stroke-dasharray: 6 3; }
.chart circle.line-want { fill: var(--page); stroke: var(--warm); stroke-width: 2; }
.chart text.line-served { fill: var(--accent); } .chart text.line-want { fill: var(--warm); }
"""

_PRINT = """
@page { size: A4; margin: 9mm 11mm; }
@media print {
  body { max-width: none; padding: 0; font-size: 7.7pt; line-height: 1.25; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  h1 { font-size: 13pt; } .headline { font-size: 9pt; }
  h2 { font-size: 10pt; margin: 2mm 0 0.5mm; padding-top: 1mm; border-top-width: 1px;
    break-after: avoid; }
  h3 { font-size: 8.5pt; margin: 1.5mm 0 0.5mm; break-after: avoid; }
  p, ul, dl { margin: 0.7mm 0; max-width: none; } li { margin: 0.3mm 0; }
  .quiet, figcaption, .keys, table, .glossary, .columns { font-size: 6.8pt; max-width: none; }
  figure, tr, .tiles div { break-inside: avoid; } figure { margin: 1mm 0; }
  .tiles { grid-template-columns: repeat(4, 1fr); gap: 2mm; margin: 1mm 0; }
  .tiles div { padding: 0.8mm 2mm; } .tiles dd { font-size: 10.5pt; }
  .tiles dt { font-size: 6.8pt; }
  .share { height: 3mm; } .keys { margin: 0.7mm 0; gap: 0.5mm 4mm; }
  .map { --k: 21; }
  .map-figure { grid-template-columns: 108mm 1fr; gap: 0.5mm 4mm; }
  .map-figure .keys { flex-direction: column; flex-wrap: nowrap; margin: 0; }
  .map-figure figcaption { grid-column: 1 / -1; }
  .toggle, .toggle + label, .on-screen { display: none; }
  .pair { grid-template-columns: 60mm 1fr; gap: 0 5mm; }
  .beside { grid-template-columns: 58mm 1fr; gap: 0 4mm; }
  .chart { max-width: 60mm; }
  .wide { overflow: visible; margin: 0.7mm 0; } th, td { padding: 0.2mm 1.6mm 0.2mm 0; }
  caption { padding-bottom: 0.3mm; } tbody th { position: static; }
  .columns, .glossary { columns: 3; column-gap: 5mm; }
  .columns { padding-left: 4mm; } .columns li { break-inside: avoid; }
  .beside tbody th { white-space: nowrap; min-width: 0; }
  .beside table { font-size: 6.8pt; } .beside th, .beside td { padding-right: 1.6mm; }
  .glossary { display: block; } .glossary dt, .glossary dd { display: inline; }
  .glossary dd::after { content: ""; display: block; }
}
"""


def report_style(drones: int) -> str:
    """The style sheet of the page of a plan for some drones."""
    used = "".join(
        f".k{number} {{ --c: var(--c{number}) !important; --on-c: var(--on-c{number}); }}\n"
        for number in range(len(ON_WHITE))
    )
    rules = _PAGE + _MAP + used + _CHARTS + _hiding() + _hovering(drones) + _PRINT
    return style_sheet(rules, _drone_colours(ON_WHITE), _drone_colours(ON_DARK))


LAYERS = {
    "people": "People",
    "cells": "Who belongs to which drone",
    "circles": "Circles",
    "ways": "Ways",
}
"""Parts of the map that can be hidden, by their classes."""


def _hiding() -> str:
    return "".join(
        f"#show-{layer}:not(:checked) ~ .map .{layer} {{ display: none; }}\n" for layer in LAYERS
    )


def _hovering(drones: int) -> str:
    """A drone that is pointed at, on the map or in the table, stands out."""
    return "".join(
        f"body:has(.point.h{index}:hover) .map .drone:not(.h{index}) {{ opacity: 0.15; }}\n"
        for index in range(drones)
    )


def _drone_colours(colours: tuple[str, ...]) -> str:
    return " ".join(
        f"--c{number}: {colour}; --on-c{number}: {_readable_on(colour)};"
        for number, colour in enumerate(colours)
    )


def _readable_on(colour: str) -> str:
    """Black or white, whichever has more contrast (WCAG 2.2)."""
    channels = [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]
    linear = [
        value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
        for value in channels
    ]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#000000" if luminance > 0.179 else "#ffffff"
