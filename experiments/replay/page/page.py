"""Puts a document into the page that shows it.

The scripts in ``bundle/`` are made from ``source/`` and three.js by ``build/build.mjs``
(``make replay-page``). What draws in three dimensions is compressed, and unpacked by the browser
only where it can draw that.
"""

import base64
import hashlib
import html
import re
import zlib
from functools import cache
from importlib.resources import files

from orchid_uav.experiments.markup import harmless
from orchid_uav.experiments.planning.maps.colours import ON_DARK, ON_WHITE

_UNSAFE_IN_SCRIPT = re.compile("[<>&\u2028\u2029\ud800-\udfff]")
_LONGEST_TITLE = 300


def page_html(document_json: str, title: str) -> str:
    """The page of a replay.

    Args:
        document_json: a ``ReplayDocument`` as JSON.
        title: of the browser's window until the document is unpacked.

    Returns:
        HTML that can be written as UTF-8. Its policy lets the browser load nothing, and run no
        script but the page's own, whatever the document holds.
    """
    script, scene = _part("bundle/page.js"), _part("bundle/scene.js")
    style = _part("style.css").replace("{{drones}}", _drone_colours())
    policy = (
        f"default-src 'none'; script-src {_allowed(script)} {_allowed(scene)}; "
        f"style-src {_allowed(style)}; base-uri 'none'; form-action 'none'"
    )
    parts = {
        "policy": policy,
        "title": html.escape(harmless(title, _LONGEST_TITLE)),
        "style": style,
        "licences": html.escape(_part("bundle/THIRD_PARTY_LICENSES.txt")),
        "document": _UNSAFE_IN_SCRIPT.sub(_escaped, document_json),
        "scene": _compressed(scene),
        "script": script,
    }
    # In one pass, so that braces in a title or a document stay what they are.
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _part("template.html"))


@cache
def _part(name: str) -> str:
    return (
        files("orchid_uav.experiments.replay.page")
        .joinpath(*name.split("/"))
        .read_text(encoding="utf-8")
    )


@cache
def _compressed(text: str) -> str:
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode("ascii")


def _allowed(content: str) -> str:
    """What a policy calls a script or style sheet that may take effect."""
    digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode("ascii")
    return f"'sha256-{digest}'"


def _escaped(found: re.Match[str]) -> str:
    """A character inside a string of JSON, as an escape that no parser of HTML notices."""
    return f"\\u{ord(found[0]):04x}"


def _drone_colours() -> str:
    """Colours of drones, those of a plan's map."""
    lines = []
    for theme, colours in (("light", ON_WHITE), ("dark", ON_DARK)):
        named = " ".join(f"--drone-{number}: {colour};" for number, colour in enumerate(colours))
        lines.append(f':root[data-theme="{theme}"] {{ {named} }}')
    return "\n".join(lines)
