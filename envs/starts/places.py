"""The area and the masts of ground base stations, as configurations write them (M44, M45)."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag

from orchid_uav.envs.keys import Form, within

Side = Annotated[float, within(1.0, 1e6)]
"""In m, up to a thousand kilometres."""


def _kind(value: Any) -> str:
    return "several" if isinstance(value, list | tuple) else "one"


_BY_KIND = Discriminator(_kind)
"""So that an error is about what was meant, a value or a list of them."""
Area = Annotated[
    Annotated[Side, Tag("one")] | Annotated[tuple[Side, Side], Tag("several")], _BY_KIND
]
"""Side of a square, or the sides of a rectangle to the east and to the north, in m."""

_FARTHEST_M = 1e6
_LEAST_HEIGHT_M, _GREATEST_HEIGHT_M = 0.01, 1e5


def _are_masts(value: Any) -> Any:
    """Whether what is given has the form of places, before its numbers are read."""
    is_middle = isinstance(value, str) and value == "middle"
    masts = value if isinstance(value, list | tuple) else [value]
    if not is_middle and not all(
        isinstance(mast, list | tuple) and len(mast) in (2, 3) for mast in masts
    ):
        raise ValueError(
            "masts are written [[500, 800]] for one at 500 m east and 800 m north, "
            "[[500, 800], [1500, 800, 45]] for two, of which one has a height of its own, [] for "
            "none, or middle"
        )
    return value


def _are_near(masts: Any) -> Any:
    for index, mast in enumerate(masts if masts != "middle" else ()):
        if max(abs(mast[0]), abs(mast[1])) > _FARTHEST_M:
            raise ValueError(f"mast {index} is farther than {_FARTHEST_M:g} m to a side")
        if len(mast) == 3 and not _LEAST_HEIGHT_M <= mast[2] <= _GREATEST_HEIGHT_M:
            raise ValueError(
                f"the height of mast {index} is not within {_LEAST_HEIGHT_M:g}.."
                f"{_GREATEST_HEIGHT_M:g} m"
            )
    return masts


Masts = Annotated[
    Annotated[Literal["middle"], Tag("one")]
    | Annotated[tuple[tuple[float, ...], ...], Tag("several")],
    _BY_KIND,
    BeforeValidator(_are_masts),
    AfterValidator(_are_near),
    Form("middle or [[east, north(, height)], ...]"),
]
"""Places of masts in m, in the area or beyond it."""
