"""Pages for a browser that need no network and no program: their frame, and the style all share."""

from orchid_uav.experiments.markup import Markup, element

WHITE_PAGE, DARK_PAGE = "#FFFFFF", "#15181C"
"""The grounds on which everything has to be readable."""
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
"""Should anything slip in, the browser loads and runs it no more than a picture in a book."""

_LIGHT = f"""--ink: #1b1e22; --quiet: #575e66; --page: {WHITE_PAGE}; --panel: #f4f5f7;
  --line: #d5d9de; --accent: #03548e; --mast: #5a6169; --zone: #b3261e; --grid: #e3e6ea;
  --good: #146c43; --bad: #a3201a; --warm: #a05a00; color-scheme: light;"""
_DARK = f"""--ink: #e9ebee; --quiet: #aab1ba; --page: {DARK_PAGE}; --panel: #1e2329;
  --line: #3b424b; --accent: #6db3f2; --mast: #9aa3ad; --zone: #ff8a80; --grid: #2c323a;
  --good: #6fcf97; --bad: #ff9a91; --warm: #f0a93b; color-scheme: dark;"""

_COMMON = """
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0 auto; max-width: 72rem; padding: 1.25rem clamp(0.9rem, 3vw, 2.5rem) 3rem;
  background: var(--page); color: var(--ink); font: 1rem/1.5 system-ui, "Segoe UI", Roboto,
  "Helvetica Neue", "DejaVu Sans", sans-serif; overflow-wrap: anywhere; }
h1 { font-size: clamp(1.5rem, 4.5vw, 2.1rem); line-height: 1.2; margin: 0 0 0.35rem; }
h2 { font-size: 1.3rem; line-height: 1.25; margin: 2.6rem 0 0.5rem; padding-top: 0.9rem;
  border-top: 2px solid var(--line); }
h3 { font-size: 1.02rem; margin: 1.5rem 0 0.25rem; }
p, ul, dl { margin: 0.5rem 0; max-width: 46rem; }
ul { padding-left: 1.2rem; } li { margin: 0.3rem 0; }
dfn { font-style: normal; font-weight: 600; }
.quiet, figcaption { color: var(--quiet); font-size: 0.9rem; }
figure { margin: 1rem 0; } figcaption { max-width: 46rem; }
.wide { overflow-x: auto; margin: 0.75rem 0; }
.wide:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
table { border-collapse: collapse; font-size: 0.9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: 0.35rem; }
th, td { text-align: left; padding: 0.32rem 0.9rem 0.32rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; overflow-wrap: normal; white-space: nowrap; }
thead th { font-weight: 600; color: var(--quiet); line-height: 1.3; vertical-align: bottom;
  white-space: normal; }
tbody th { font-weight: 600; background: var(--page); position: sticky; left: 0; }
.glossary { display: grid; grid-template-columns: minmax(8rem, max-content) 1fr; gap: 0.3rem 1rem;
  max-width: 54rem; }
.glossary dt { font-weight: 600; } .glossary dd { margin: 0; }
code { font: 0.88em/1.4 ui-monospace, "DejaVu Sans Mono", monospace; background: var(--panel);
  padding: 0.1em 0.3em; border-radius: 4px; }
details { margin: 0.5rem 0; } summary { cursor: pointer; font-weight: 600; }
@media (max-width: 34rem) { .glossary { grid-template-columns: 1fr; gap: 0; }
  .glossary dd { margin-bottom: 0.5rem; } }
"""


def html_page(title: str, style: str, *body: str, with_images: bool = False) -> str:
    """A whole page.

    Args:
        title: its title.
        style: its style sheet; see :func:`style_sheet`.
        body: what stands in its body.
        with_images: whether it holds images, which are parts of the page itself (data URLs).
    """
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element(
            "meta",
            http_equiv="Content-Security-Policy",
            content=_POLICY + ("; img-src data:" if with_images else ""),
        ),
        element("title", title),
        element("style", Markup(style)),
    )
    return f"<!DOCTYPE html>\n{element('html', head, element('body', *body), lang='en')}\n"


def style_sheet(rules: str, light: str = "", dark: str = "") -> str:
    """What all pages share, and a page's own rules after it.

    Args:
        rules: its own rules.
        light: declarations of its own variables on a light page, and in print.
        dark: the same on a dark page.
    """
    return (
        f":root {{ {_LIGHT} {light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {_DARK} {dark} }} }}\n"
        f"{_COMMON}{rules}"
    )
