"""HTML and SVG, put together so that no text from outside can become part of them."""

import html
import unicodedata
from collections.abc import Iterable, Sequence

_VOID = {"meta", "input", "br", "img"}
_LONGEST_SHOWN, _LONGEST = 200, 2_000


class Markup(str):
    """Text that is HTML already. Every other text is escaped where it is put into an element."""

    __slots__ = ()


def element(name: str, /, *content: str, **attributes: str | float | None) -> Markup:
    """An element with its content, of which all that is not ``Markup`` is escaped.

    Args:
        name: the element's name.
        content: texts and elements.
        attributes: its attributes. Underscores stand for hyphens, one at the end is dropped;
            an attribute that is None is left out.
    """
    told = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_plain(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in _VOID:
        return Markup(f"<{name}{told}>")
    return Markup(f"<{name}{told}>{joined(content)}</{name}>")


def joined(parts: Iterable[str], separator: str = "") -> Markup:
    """Parts one after the other; those that are not ``Markup`` are escaped."""
    texts = (part if isinstance(part, Markup) else _escaped(part) for part in parts)
    return Markup(separator.join(texts))


def table(
    caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]], classes: Sequence[str] = ()
) -> Markup:
    """A table that scrolls sideways where it is too wide; the first cell of a row is its head.

    Args:
        caption: what the table shows.
        heads: the heads of the columns.
        rows: texts, or ``element("td", …)``, of each row.
        classes: a class for each row, or an empty text.
    """
    head = element("tr", *(element("th", text, scope="col") for text in heads))
    lines = [
        element(
            "tr",
            element("th", first, scope="row"),
            *(cell if _is_cell(cell) else element("td", cell) for cell in rest),
            class_=(classes[place] or None) if classes else None,
        )
        for place, (first, *rest) in enumerate(rows)
    ]
    whole = element(
        "table",
        element("caption", caption),
        element("thead", head),
        element("tbody", *lines),
    )
    return element("div", whole, class_="wide", role="region", aria_label=caption, tabindex=0)


def _is_cell(text: str) -> bool:
    return isinstance(text, Markup) and text.startswith("<td")


def _plain(value: str | float) -> str:
    if isinstance(value, Markup):
        return value
    return _escaped(value) if isinstance(value, str) else f"{value:.10g}"


def _escaped(text: str) -> str:
    return html.escape(harmless(text, _LONGEST))


def harmless(text: str, longest: int = _LONGEST_SHOWN) -> str:
    """A text from outside, on one line: shortened, and without characters that cannot be seen.

    Those are control characters, halves of characters, what turns the direction of the text that
    follows, and whatever XML may not contain. Each is replaced by �.
    """
    if len(text) > longest:
        text = f"{text[:longest]}… ({len(text):,} characters)"
    return "".join("�" if _is_unseen(character) else character for character in text)


def _is_unseen(character: str) -> bool:
    if character == "\N{ZERO WIDTH JOINER}":  # part of many emoji
        return False
    is_no_character = ord(character) & 0xFFFE == 0xFFFE
    return is_no_character or unicodedata.category(character) in ("Cc", "Cs", "Cf", "Zl", "Zp")
