"""Errors that a user can mend, told in one or two lines."""

import difflib
from collections.abc import Iterable


class InputError(Exception):
    """Wrong usage or input: what is wrong, with the offending value, and what would be right."""


class RunFailedError(Exception):
    """Something that had begun could not go on; perhaps later, as a second line may say."""


def nearest(name: str, known: Iterable[str], cutoff: float) -> str | None:
    """What is most like a name, None if nothing is."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return near[0] if near else None


def unknown(kind: str, name: str, known: Iterable[str], cutoff: float) -> str:
    """A message that names the nearest of what is known, or all of it where nothing is near."""
    names = list(known)
    near = nearest(name, names, cutoff)
    hint = f"did you mean '{near}'?" if near else f"known are {', '.join(names)}"
    return f"unknown {kind} '{name}': {hint}"
