"""Documents as models: written as they were read, refused where they are something else."""

import json

import pytest

from orchid_uav.experiments.provenance import describe_versions
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.records import read_config, read_record
from orchid_uav.storage.documents import Document
from tests.helpers.damage import reseal
from tests.helpers.processes import record_of
from tests.helpers.run_directories import make_run


class Inner(Document):
    value: float | None


class Outer(Document):
    name: str
    inner: list[Inner]
    note: str | None = None


class TestDocument:
    @pytest.mark.parametrize(
        "content",
        [
            {"name": "a", "inner": []},
            {"name": "a", "inner": [], "note": None},
            {"name": "a", "inner": [{"value": 0.1 + 0.2}, {"value": None}], "note": "b"},
            {"name": "a", "inner": [{"value": 5e-324, "of a later version": [1]}], "later": {}},
        ],
    )
    def test_is_written_as_it_was_read(self, content):
        written = json.dumps(Outer.from_json(json.loads(json.dumps(content))).to_json())
        assert written == json.dumps(content)

    @pytest.mark.parametrize(
        ("content", "told"),
        [
            ({"inner": []}, "it has no name"),
            ({"name": 1, "inner": []}, "name is 1: "),
            ({"name": "a", "inner": [{"value": "0.5"}]}, "inner.0.value is '0.5': "),
            ({"name": "a", "inner": [{"value": True}]}, "inner.0.value is True: "),
            ({"name": "a\n" * 1000, "inner": "b\n" * 1000}, "inner is 'b"),
            ([], ""),
        ],
    )
    def test_of_another_kind_is_refused_in_one_short_line(self, content, told):
        with pytest.raises(ValueError) as error:
            Outer.from_json(content)
        message = str(error.value)
        assert message.startswith(told)
        assert len(message.splitlines()) == 1 and len(message) < 200


class TestRecord:
    def test_what_a_later_version_knows_survives_a_resume(self, tmp_path):
        path = make_run(tmp_path, status="interrupted")
        before = record_of(path)
        reseal(path / "run.json", later={"a": [1, 2.5]}, final=before["final"] | {"later": 0.5})
        run = RunDirectory.reopen(path, read_config(path, read_record(path)), ["orchid"])
        run.give_up("interrupted", None)
        after = record_of(path)
        assert after["later"] == {"a": [1, 2.5]}
        assert after["final"]["later"] == 0.5
        assert after["resumed"][0]["versions"] == describe_versions()
        assert list(after)[: list(before).index("seal")] == list(before)[:-1]
