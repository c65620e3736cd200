"""The last parts of the report: what the plan does not know, its terms, and how it was made."""

import json
import shlex
from typing import Any

from orchid_uav.experiments.markup import Markup, element, harmless, table
from orchid_uav.experiments.planning.maps.drawing import MappedPlan

_UNKNOWN = {
    "Terrain": "The ground is taken to be flat and as high as home. Hills stop radio waves and "
    "drones: look at every station and every way on a map with heights before anybody flies.",
    "Buildings and trees": "How much they weaken the radio signal is an average for the kind of "
    "place, not what stands in this street. Their heights are not known either.",
    "Weather": "Wind, rain, heat and cold change how long a battery lasts and whether a drone may "
    "fly at all.",
    "Other networks": "Each drone is taken to have radio frequencies of its own. Interference from "
    "neighbouring networks, and between drones that share frequencies, is not modelled.",
    "Rules": "Whether the drones may fly here, and may use these frequencies, has to be asked of "
    "the authorities. The no-fly zones are those that were given, and there may be others.",
    "People": "People are where the file says. Those who are not in it are not in the plan.",
}

_TERMS = {
    "base station": "What telephones connect to: part of a mast on the ground, or carried by a "
    "drone.",
    "backhaul": "The link of a drone to a mast, and by it to the rest of the world.",
    "circle": "A drone flies round its station, since flying takes it less energy than hovering.",
    "dB": "Decibel, a measure of ratios: 10 dB more is ten times as strong, 3 dB more twice.",
    "home": "Where the drones start and land. All altitudes are above it.",
    "kbit/s, Mbit/s": "A thousand and a million bits each second, 8 bits being one letter.",
    "median": "Half of all people get less, half get more. Those not served count as 0.",
    "seed": "The number that the planner’s random choices start from.",
    "shadowing": "What obstacles do to a radio signal beyond its weakening with distance.",
    "signal-to-noise ratio": "How much stronger the signal is than the noise at the receiver.",
    "utility": "The one number that the planner makes as large as it can: people served, data for "
    "the energy spent, and how evenly people and drones are treated.",
    "worst-off person": "The one with the lowest rate; 0 as long as anybody is not served.",
}


def what_is_unknown(plan: MappedPlan) -> list[Markup]:
    """The section of limits, and of the decisions that were made for this plan."""
    listed = [
        element("li", element("strong", f"{name}. "), told) for name, told in _UNKNOWN.items()
    ]
    parts = [element("ul", *listed, class_="columns")]
    if plan.document.notes:
        notes = [element("li", note) for note in plan.document.notes]
        parts += [element("h3", "Notes on this plan"), element("ul", *notes)]
    return parts


def terms() -> list[Markup]:
    """The glossary."""
    listed = []
    for term, meaning in _TERMS.items():
        listed += [element("dt", term), Markup(" "), element("dd", meaning)]
    return [element("dl", *listed, class_="glossary")]


def how_it_was_made(plan: MappedPlan) -> list[Markup]:
    """The command, the effort, and all settings."""
    document = plan.document
    command = " ".join(shlex.quote(harmless(word)) for word in document.command)
    settings = _flat("", document.settings | (document.model_extra or {}))
    seeds = [told for name, told in settings if name.rpartition(".")[2] == "seed"]
    return [
        element("h3", "How this plan was made"),
        element("p", "Command: ", element("code", element("bdi", command))),
        element(
            "p",
            f"The planner tried {document.evaluations:,} arrangements of the drones"
            f"{f', beginning with seed {seeds[0]}' if seeds else ''}. "
            f"The best has a utility of {document.utility:.3f}. "
            "The file plan.json beside this page holds all numbers of it.",
        ),
        element(
            "details",
            element("summary", "All settings"),
            table("Settings of the plan", ["Setting", "Value"], settings),
            class_="on-screen",
        ),
    ]


def _flat(name: str, value: Any) -> list[tuple[str, str]]:
    """Settings by "section.key"."""
    if isinstance(value, dict) and value:
        return [
            line
            for key, inner in value.items()
            for line in _flat(f"{name}.{key}" if name else key, inner)
        ]
    return [(name, value if isinstance(value, str) else json.dumps(value))] if name else []
