"""Files as they come: good ones, and good ones with a mistake, a bit, or a malice more."""

import copy
import io
import json
import struct
import warnings
import zipfile
from typing import Any

from hypothesis import strategies as st

_ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 0.5, -0.0, 1e300, -1e300, 10**30, 2**63, 2**31),
    *("", " ", "nan", "x" * 5000, "\x00", "\u202e", "ä", "1", "NaN", [], {}, [[]], [1], {"": 1}),
    *([None] * 3, [1e308, 1e308], "1e400", "-Infinity", 90.0, 180.0, 181.0, -91.0),
)


@st.composite
def changed_json(draw: st.DrawFn, document: Any) -> bytes:
    """A JSON document of which some places were replaced, removed, repeated or moved."""
    changed = json.loads(json.dumps(document))
    for _ in range(draw(st.sampled_from((0, 0, 1, 1, 2, 3)))):
        _change(draw, changed)
    text = json.dumps(changed, ensure_ascii=draw(st.booleans()))
    form = draw(st.integers(0, 40))
    if form == 0:
        text = text.replace(":", ":NaN,", 1)
    elif form == 1:
        text = text[: draw(st.integers(0, len(text)))]
    elif form == 2:
        depth = draw(st.sampled_from((10, 1000, 100_000)))
        text = "[" * depth + "]" * depth
    elif form == 3:
        text = text.replace("{", '{"a":1,"a":2,', 1)
    encoding = draw(st.sampled_from(("utf-8",) * 30 + ("utf-16", "utf-8-sig", "latin-1")))
    return draw(scarcely_damaged(text.encode(encoding, errors="replace")))


def _change(draw: st.DrawFn, document: Any) -> None:
    places: list[tuple[Any, Any]] = []
    _collect(document, places)
    if not places:
        return
    holder, key = draw(st.sampled_from(places))
    form = draw(st.integers(0, 4))
    if form == 0:
        del holder[key]
    elif form == 1 and isinstance(holder, list):
        holder.insert(key, holder[key])
    elif form == 2 and isinstance(holder[key], int | float):
        holder[key] = holder[key] * draw(st.sampled_from((-1, 0, 1.001, 10, 1e6, 1e-6)))
    elif form == 3:
        other_holder, other_key = draw(st.sampled_from(places))
        holder[key] = json.loads(json.dumps(other_holder[other_key]))
    else:
        holder[key] = copy.deepcopy(draw(st.sampled_from(_ODD_VALUES)))


def _collect(document: Any, places: list[tuple[Any, Any]]) -> None:
    keys = document if isinstance(document, dict) else range(len(document))
    for key in keys:
        places.append((document, key))
        if isinstance(document[key], dict | list):
            _collect(document[key], places)


@st.composite
def scarcely_damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Mostly the same bytes; sometimes cut, flipped, doubled or with others between."""
    if draw(st.integers(0, 7)):
        return content
    return draw(damaged(content))


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """The bytes, with one to three places changed."""
    changed = bytearray(content)
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, max(len(changed) - 1, 0)))
        form = draw(st.integers(0, 4))
        if form == 0 and changed:
            changed[at] ^= 1 << draw(st.integers(0, 7))
        elif form == 1:
            del changed[at:]
        elif form == 2:
            changed[at:at] = draw(st.binary(min_size=1, max_size=8))
        elif form == 3:
            del changed[at : at + draw(st.integers(1, 40))]
        else:
            changed[at:at] = changed[at : at + draw(st.integers(1, 200))]
    return bytes(changed)


_coordinates = st.one_of(
    st.floats(-0.01, 0.01).map(lambda value: f"{value:.6f}"),
    st.sampled_from(("", "nan", "inf", "91", "-181", "1e400", "0,004", "x", "0°", "-0.0", "1e-7")),
)
_column_names = st.sampled_from(
    (
        *("lat", "lon", "latitude", "longitude", "x_m", "y_m", "weight", "Lat", "LON", "id", ""),
        *("people", "name", "altitude", "lat ", "breite", "\ufefflat"),
    )
)


@st.composite
def positions_csv(draw: st.DrawFn) -> bytes:
    """Positions of people as a table: right or with odd cells, separators and encodings."""
    is_right = draw(st.integers(0, 2)) > 0
    good = st.floats(-0.01, 0.01).map(lambda value: f"{value:.6f}")
    header = ["lat", "lon"] if is_right else draw(st.lists(_column_names, max_size=4))
    cells = good if is_right else _coordinates
    rows = draw(
        st.lists(
            st.lists(cells, min_size=len(header), max_size=len(header))
            if is_right
            else st.lists(cells, max_size=5),
            min_size=int(is_right),
            max_size=12,
        )
    )
    separator = draw(st.sampled_from((",", ",", ";", "\t", "|")))
    end = draw(st.sampled_from(("\n", "\n", "\r\n", "\r", "\n\n")))
    text = end.join(separator.join(row) for row in [header, *rows])
    encoding = draw(st.sampled_from(("utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1")))
    return draw(scarcely_damaged(text.encode(encoding, errors="replace")))


@st.composite
def positions_geojson(draw: st.DrawFn) -> bytes:
    """Points of people, whose documents were changed."""
    points = draw(
        st.lists(st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)), min_size=1, max_size=6)
    )
    features = [
        {
            "type": "Feature",
            "properties": {"weight": 1 + number},
            "geometry": {"type": "Point", "coordinates": [round(x, 6), round(y, 6)]},
        }
        for number, (x, y) in enumerate(points)
    ]
    return draw(changed_json({"type": "FeatureCollection", "features": features}))


@st.composite
def positions_kml(draw: st.DrawFn) -> bytes:
    """Placemarks of people: right, with odd coordinates, with entities, or damaged."""
    places = draw(st.lists(st.tuples(_coordinates, _coordinates), max_size=6))
    marks = "".join(
        f"<Placemark><name>{number}</name><Point><coordinates>{x},{y}</coordinates></Point>"
        "</Placemark>"
        for number, (x, y) in enumerate(places)
    )
    head = draw(
        st.sampled_from(
            (
                *('<?xml version="1.0" encoding="UTF-8"?>',) * 4,
                '<!DOCTYPE kml [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>',
                '<!DOCTYPE kml [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
                "",
            )
        )
    )
    text = f'{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{marks}</Document></kml>'
    return draw(scarcely_damaged(text.encode()))


_member_names = st.sampled_from(
    (
        *(
            "../outside",
            "/absolute",
            "a/../../b",
            "run.json",
            "C:\\x",
            "a\\b",
            "",
            ".",
            "..",
            "a//b",
        ),
        *("ä", "x" * 300, "nul", "policy.safetensors/x", "a\x00b", ".lock"),
    )
)


@st.composite
def changed_archive(draw: st.DrawFn, archive: bytes) -> bytes:
    """A zip of runs with members changed, added, removed, renamed or declared otherwise."""
    members: list[tuple[zipfile.ZipInfo, bytes]] = []
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        members = [(info, opened.read(info)) for info in opened.infolist()]
    for _ in range(draw(st.integers(0, 2))):
        if not members:
            break
        at = draw(st.integers(0, len(members) - 1))
        info, content = members[at]
        form = draw(st.integers(0, 6))
        if form == 0:
            members[at] = info, draw(damaged(content))
        elif form == 1:
            del members[at]
        elif form == 2:
            members.append((info, content))
        elif form == 3:
            members[at] = zipfile.ZipInfo(draw(_member_names)), content
        elif form == 4:
            members.append((zipfile.ZipInfo(draw(_member_names)), draw(st.binary(max_size=20))))
        elif form == 5:
            link = zipfile.ZipInfo(info.filename)
            link.external_attr = 0o120777 << 16
            members[at] = link, b"/etc/passwd"
        else:
            members[at] = info, bytes(draw(st.sampled_from((0, 1, 10**7))))
    written = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as made:
        warnings.simplefilter("ignore")  # of names that are there twice, which is the point
        for info, content in members:
            copy = zipfile.ZipInfo(info.filename or "x")
            copy.filename = info.filename
            copy.external_attr = info.external_attr
            copy.compress_type = draw(st.sampled_from((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED)))
            made.writestr(copy, content)
    content = written.getvalue()
    form = draw(st.integers(0, 9))
    if form == 0:
        content = _declaring_another_size(content, draw(st.integers(0, 2**32 - 1)))
    return draw(scarcely_damaged(content)) if form > 5 else content


def _declaring_another_size(content: bytes, size: int) -> bytes:
    """The first member of the directory gets another uncompressed size."""
    at = content.find(b"PK\x01\x02")
    if at < 0:
        return content
    return content[: at + 24] + struct.pack("<I", size) + content[at + 28 :]


@st.composite
def changed_toml(draw: st.DrawFn) -> bytes:
    """A configuration as TOML: right, with values of other types, or damaged."""
    keys = st.sampled_from(
        (
            *("network.uav_count", "network.user_count", "network.area_m", "reset.kappa"),
            *("network.distribution", "ppo.hidden_sizes", "training.episodes", "uav.flight"),
            *("gbs.positions_m", "maddpg.buffer_size", "reward.weight_rate", "nothing.at_all"),
            *("network", "reset.enabled", "deployment.init", "checkpoint.keep"),
        )
    )
    values = st.sampled_from(
        (
            *("6", "0", "-1", "0.3", "nan", "inf", "1e400", '"tcp"', '"pf"', "[64, 64]", "[]"),
            *(
                "true",
                "[[0, 0]]",
                "[500, 900]",
                '""',
                "1979-05-27",
                "{a = 1}",
                "9" * 40,
                '"station"',
            ),
        )
    )
    lines = [
        f"{key} = {value}" for key, value in draw(st.lists(st.tuples(keys, values), max_size=4))
    ]
    text = "\n".join(lines) + "\n"
    return draw(scarcely_damaged(text.encode()))
