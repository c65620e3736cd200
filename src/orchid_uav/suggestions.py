"""Messages about names that are not known: what may have been meant."""

import difflib
from collections.abc import Iterable, Sequence

_MOST_SHOWN = 40


def nearest(name: str, known: Iterable[str], cutoff: float = 0.5) -> str | None:
    """The known name that is most like a given one, None if none is."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return near[0] if near else None


def did_you_mean(names: Sequence[str]) -> str:
    """The question whether one of these names was meant."""
    quoted = [f"'{name}'" for name in names]
    return f"did you mean {' or '.join(quoted)}?"


def unknown(
    kind: str, name: str, known: Iterable[str], cutoff: float = 0.5, near: Sequence[str] = ()
) -> str:
    """A message that names the nearest of what is known, or all of it where nothing is near.

    Args:
        kind: what the name was to be one of.
        name: what was given.
        known: what could have been given.
        cutoff: how alike names must be to be near, from 0 to 1.
        near: names that are nearer than any that is only spelt alike.
    """
    names = list(known)
    found = nearest(name, names, cutoff)
    near = near or ([found] if found else [])
    shown = [*names[:12], "..."] if len(names) > _MOST_SHOWN else names
    return f"unknown {kind} '{name}': " + (
        did_you_mean(near) if near else f"known are {', '.join(shown)}"
    )
