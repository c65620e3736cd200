"""Plans as GeoJSON, judged by geojson-pydantic, shapely, GDAL and geodesics."""

import json
import math

import numpy as np
import pyogrio
import pytest
import shapely
import shapely.geometry
from geojson_pydantic import FeatureCollection
from hypothesis import given, settings
from hypothesis import strategies as st
from pymap3d.vincenty import vdist

from orchid_uav.experiments.planning.maps.geojson import people_geojson, stations_geojson
from orchid_uav.experiments.planning.maps.on_earth import lines_on_earth, polygons_on_earth
from orchid_uav.experiments.planning.site import Place, Site
from tests.helpers.plans import UTUADO, make_plan

FIJI = Place(-16.8, 179.999)
"""In the middle of a site that the antimeridian crosses."""
WRITERS = (stations_geojson, people_geojson)


def features_of(collection, kind):
    return [one for one in collection["features"] if one["properties"]["kind"] == kind]


def coordinates_of(geometry):
    """All positions of a geometry."""
    nested = [geometry["coordinates"]]
    while nested:
        part = nested.pop()
        if isinstance(part[0], float):
            yield part
        else:
            nested += part


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("center", [UTUADO, FIJI])
class TestTheStandard:
    def test_it_is_a_collection_of_features(self, write, center):
        written = json.loads(json.dumps(write(make_plan(center=center)), allow_nan=False))
        FeatureCollection.model_validate(written)
        assert set(written) == {"type", "features"}  # no crs

    def test_positions_are_longitude_and_latitude_with_seven_decimals(self, write, center):
        for feature in write(make_plan(center=center))["features"]:
            for longitude, latitude in coordinates_of(feature["geometry"]):
                across_deg = (longitude - center.longitude_deg + 180.0) % 360.0 - 180.0
                assert abs(across_deg) < 0.05
                assert abs(latitude - center.latitude_deg) < 0.05
                assert -180.0 <= longitude <= 180.0
                assert longitude == round(longitude, 7)
                assert latitude == round(latitude, 7)

    def test_polygons_are_valid_and_run_counter_clockwise(self, write, center):
        for feature in write(make_plan(center=center))["features"]:
            shape = shapely.geometry.shape(feature["geometry"])
            assert shape.is_valid
            for part in shapely.get_parts(shape):
                if part.geom_type == "Polygon":
                    assert part.exterior.is_ccw
                    assert part.exterior.is_closed

    def test_gdal_reads_the_same(self, write, center, tmp_path):
        collection = write(make_plan(center=center))
        path = tmp_path / "plan.geojson"
        path.write_text(json.dumps(collection))
        _, _, shapes, _ = pyogrio.raw.read(path)
        assert len(shapes) == len(collection["features"])
        for read, feature in zip(shapely.from_wkb(shapes), collection["features"], strict=True):
            assert read.equals(shapely.geometry.shape(feature["geometry"]))


class TestStations:
    def test_a_station_tells_what_the_document_tells(self):
        plan = make_plan()
        features = features_of(stations_geojson(plan), "station")
        assert len(features) == 6
        for feature, drone in zip(features, plan.document.drones, strict=True):
            told = feature["properties"]
            longitude, latitude = feature["geometry"]["coordinates"]
            assert (latitude, longitude) == pytest.approx((drone.lat, drone.lon), abs=1e-7)
            assert told["id"] == drone.id
            assert told["altitude_above_home_m"] == drone.altitude_m
            assert told["transmit_power_w"] == drone.transmit_power_w
            assert told["people"] == drone.people
            assert told["endurance_minutes"] == drone.endurance_minutes

    def test_a_circle_has_its_radius_on_the_ground(self):
        plan = make_plan()
        for feature, drone in zip(
            features_of(stations_geojson(plan), "circle"), plan.document.drones, strict=True
        ):
            ring = np.array(feature["geometry"]["coordinates"][0])
            radii_m, _ = vdist(drone.lat, drone.lon, ring[:, 1], ring[:, 0])
            assert radii_m == pytest.approx(drone.circle_radius_m, abs=0.05)
            assert feature["properties"]["id"] == drone.id

    def test_colours_are_simplestyle(self):
        collection = stations_geojson(make_plan())
        for kind, keys in {
            "station": {"marker-color"},
            "circle": {"stroke", "fill", "fill-opacity"},
            "way": {"stroke"},
            "mast": {"marker-color"},
            "home": {"marker-color"},
        }.items():
            assert features_of(collection, kind)
            for feature in features_of(collection, kind):
                assert keys <= set(feature["properties"])

    def test_colours_of_neighbours_differ(self):
        features = features_of(stations_geojson(make_plan(20, 400)), "station")
        for one in features:
            place = one["geometry"]["coordinates"]
            others = [other for other in features if other is not one]
            nearest = min(
                others, key=lambda other: math.dist(place, other["geometry"]["coordinates"])
            )
            colours = {feature["properties"]["marker-color"] for feature in (one, nearest)}
            assert len(colours) == 2

    def test_a_drone_that_hovers_has_no_circle(self):
        assert not features_of(stations_geojson(make_plan(hover=True)), "circle")

    def test_a_way_straight_up_is_no_line(self):
        plan = make_plan(drones=1)
        plan.ways_m[0][:, :2] = plan.surroundings.home_m
        assert not features_of(stations_geojson(plan), "way")

    def test_without_masts_and_ways_there_are_none(self):
        collection = stations_geojson(make_plan(masts=0, ways=False))
        assert not features_of(collection, "mast")
        assert not features_of(collection, "way")

    def test_a_site_without_a_place_on_earth_is_refused(self):
        for write in WRITERS:
            with pytest.raises(ValueError, match="no place on earth"):
                write(make_plan(center=None))


class TestPeople:
    def test_each_position_tells_who_serves_it(self):
        plan = make_plan(masts=2)
        features = people_geojson(plan)["features"]
        assert len(features) == len(plan.people.weights)
        counted = {None: 0, "drone": 0, "mast": 0}
        for place, feature in enumerate(features):
            told = feature["properties"]
            counted[told["served_by_kind"]] += told["people"]
            server = int(plan.server[place])
            expected = [f"uav_{drone}" for drone in range(6)] + ["mast_0", "mast_1", None]
            assert told["served_by"] == expected[server]
            assert told["rate_bps"] == pytest.approx(plan.rates_bps[place], abs=0.5)
        people = plan.document.people
        assert counted == {
            None: people.unserved,
            "drone": people.served_by_drones,
            "mast": people.served_by_masts,
        }
        assert all(counted.values())


class TestTheAntimeridian:
    def test_polygons_and_lines_are_cut_there(self):
        collection = stations_geojson(make_plan(center=FIJI, seed=3))
        cut = [one for one in collection["features"] if one["geometry"]["type"].startswith("Multi")]
        assert {one["geometry"]["type"] for one in cut} == {"MultiLineString"}
        square = shapely.box(-400.0, -400.0, 400.0, 400.0)
        polygons = polygons_on_earth(Site(Place(0.0, 180.0)), square)
        rings = sorted([{longitude for longitude, _ in ring} for (ring,) in polygons], key=min)
        for longitudes, side in zip(rings, (-180.0, 180.0), strict=True):
            assert side in longitudes
            assert max(longitudes) - min(longitudes) == pytest.approx(400.0 / 111_319.5, rel=1e-3)

    def test_a_line_is_cut_where_it_crosses(self):
        west, east = lines_on_earth(Site(Place(0.0, 180.0)), [[-300.0, 0.0], [100.0, 40.0]])
        assert west[-1][0] == 180.0
        assert east[0][0] == -180.0
        assert west[-1][1] == east[0][1] == pytest.approx(30.0 / 110_574.0, rel=1e-3)

    def test_altitudes_go_with_a_cut_line(self):
        points_m = [[-300.0, 0.0, 60.0], [100.0, 0.0, 100.0]]
        west, east = lines_on_earth(Site(Place(0.0, 180.0)), points_m)
        assert west[-1][2] == east[0][2] == pytest.approx(90.0, abs=1e-3)


def test_long_edges_stay_where_they_are_between_their_ends():
    # 40 km of a parallel at 60° N: straight in degrees it would bow by some 50 m.
    site = Site(Place(60.0, 10.0))
    ((outline,),) = polygons_on_earth(site, shapely.box(-20_000.0, -100.0, 20_000.0, 100.0))
    ends = np.array(outline)
    middles = (ends[1:] + ends[:-1]) / 2.0
    places_m = site.to_local_m(middles[:, ::-1])
    on_long_edges = np.abs(places_m[:, 0]) < 19_999.0
    assert on_long_edges.sum() >= 40
    assert np.abs(places_m[on_long_edges, 1]) == pytest.approx(100.0, abs=0.5)


@given(
    latitude_deg=st.floats(-80.0, 80.0),
    longitude_deg=st.floats(-180.0, 180.0) | st.floats(179.9, 180.0) | st.floats(-180.0, -179.9),
    corners=st.lists(
        st.tuples(st.integers(-20_000, 20_000), st.integers(-20_000, 20_000)),
        min_size=3,
        max_size=7,
    ),
)
@settings(max_examples=60, deadline=None)
def test_any_outline_stays_valid_and_keeps_its_area(latitude_deg, longitude_deg, corners):
    hull = shapely.MultiPoint(corners).convex_hull.buffer(50.0)
    hole = hull.centroid.buffer(20.0)
    site = Site(Place(latitude_deg, longitude_deg))
    area_m2 = 0.0
    for outline, *holes in polygons_on_earth(site, hull.difference(hole)):
        polygon = shapely.Polygon(outline, holes)
        assert polygon.is_valid
        assert polygon.exterior.is_ccw
        assert not any(ring.is_ccw for ring in polygon.interiors)
        west, south, east, north = polygon.bounds
        assert -180.0 <= west < east <= 180.0
        assert -90.0 <= south < north <= 90.0
        # WGS 84's radii of curvature, at the middle of the polygon.
        middle = math.radians((south + north) / 2.0)
        flattened = 1.0 - 0.00669437999 * math.sin(middle) ** 2
        meridian_m = 6_378_137.0 * (1.0 - 0.00669437999) / flattened**1.5
        normal_m = 6_378_137.0 / math.sqrt(flattened)
        scale = math.radians(1.0) ** 2 * meridian_m * normal_m * math.cos(middle)
        area_m2 += polygon.area * scale
    assert area_m2 == pytest.approx(hull.difference(hole).area, rel=0.02)


@given(
    points=st.lists(
        st.tuples(st.integers(-9_000, 9_000), st.integers(-9_000, 9_000)), min_size=2, max_size=6
    ),
    longitude_deg=st.sampled_from([12.0, 179.99, -179.99, 180.0]),
)
@settings(max_examples=60, deadline=None)
def test_the_pieces_of_a_line_are_as_long_as_the_line(points, longitude_deg):
    site = Site(Place(10.0, longitude_deg))
    pieces = lines_on_earth(site, points)
    length_m = 0.0
    for piece in pieces:
        assert len(piece) >= 2
        assert all(-180.0 <= longitude <= 180.0 for longitude, _ in piece)
        local_m = site.to_local_m([(latitude, longitude) for longitude, latitude in piece])
        length_m += np.hypot(*np.diff(local_m, axis=0).T).sum()
    expected_m = np.hypot(*np.diff(np.array(points, float), axis=0).T).sum()
    assert length_m == pytest.approx(expected_m, rel=1e-3, abs=0.1)
