"""Colours of drones, told apart by everybody, on a white page as on a dark one.

They are Okabe and Ito's, moved until each has a contrast of at least 3 to the page, and any two of
them differ by at least 20 in CIELAB, also as seen with each kind of colour blindness.
"""

from collections.abc import Sequence

import numpy as np

from orchid_uav.experiments.planning.model import Station

ON_WHITE = ("#03548E", "#CE8500", "#15A875", "#BB81AE", "#818EE2", "#AA3A00")
ON_DARK = ("#7373C9", "#FFAB00", "#299A62", "#AD79A1", "#71D5FF", "#D15B00")
MAST, UNSERVED, ZONE, HOME = "#5A6169", "#000000", "#B3261E", "#000000"
"""Of everything that is no drone, in files for other programs."""


def colour_numbers(stations: Sequence[Station]) -> list[int]:
    """For each station an index into the colours.

    As long as they suffice each drone has its own. Beyond, a station takes the colour whose
    nearest station is farthest away, so that neighbours look different.
    """
    places_m = np.array([(station.east_m, station.north_m) for station in stations])
    numbers: list[int] = []
    for index, place_m in enumerate(places_m.reshape(-1, 2)):
        if index < len(ON_WHITE):
            numbers.append(index)
            continue
        distances_m = np.hypot(*(places_m[:index] - place_m).T)
        taken = np.array(numbers)
        nearest_m = [distances_m[taken == colour].min() for colour in range(len(ON_WHITE))]
        numbers.append(int(np.argmax(nearest_m)))
    return numbers


def colours_on_white(stations: Sequence[Station]) -> list[str]:
    """The colour of each station on a white page, as #RRGGBB."""
    return [ON_WHITE[number] for number in colour_numbers(stations)]
