"""What is told about a name that is not known."""

from pathlib import Path

import pytest

from orchid_uav.suggestions import nearest, unknown
from tests.test_architecture import PLACES, ROOT, imports_of, modules_of


@pytest.mark.parametrize(
    ("name", "near", "told"),
    [
        ("kapa", (), "unknown key 'kapa': did you mean 'kappa'?"),
        ("kapa", ("a.b", "c.b"), "unknown key 'kapa': did you mean 'a.b' or 'c.b'?"),
        ("zzz", (), "unknown key 'zzz': known are kappa, window"),
    ],
)
def test_the_nearest_is_named_or_else_what_there_is(name, near, told):
    assert unknown("key", name, ["kappa", "window"], near=near) == told


def test_of_very_many_only_some_are_listed():
    told = unknown("key", "zzz", [f"key_{number}" for number in range(1000)])
    assert told.startswith("unknown key 'zzz': known are key_0, key_1, ")
    assert told.endswith("key_11, ...")


def test_what_is_not_alike_enough_is_not_near():
    assert nearest("kapa", ["kappa"], cutoff=0.8) == "kappa"
    assert nearest("kapa", ["kappa"], cutoff=0.95) is None


def test_there_is_one_place_that_makes_such_messages():
    paths = {path for folder in PLACES.values() for path in modules_of(folder)}
    making = {path for path in paths if "did you mean" in path.read_text(encoding="utf-8")}
    making |= {path for path in paths if "difflib" in imports_of(path)}
    assert making == {Path(ROOT / "src/orchid_uav/suggestions.py")}
