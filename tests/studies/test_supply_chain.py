"""Licences, audits, distributions and records of tests: what the commands conclude."""

import gzip
import io
import json
import tarfile
from types import SimpleNamespace

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from studies.supply_chain import audit, licences
from studies.supply_chain.distribution_check import NEEDED, WrongError, check_contents
from studies.supply_chain.distributions import normalised
from studies.supply_chain.tested import counts, differences, pins

SECONDS = 1_700_000_000


class TestLicences:
    @pytest.mark.parametrize(
        ("metadata", "licence", "where"),
        [
            ({"license_expression": "Apache-2.0 OR MIT"}, "Apache-2.0 OR MIT", "expression"),
            ({"license": "BSD 3-Clause License\n\nCopyright (c)"}, "BSD-3-Clause", "field"),
            (
                {"license": "Copyright", "classifier": ["License :: OSI Approved :: MIT License"]},
                "MIT",
                "classifier",
            ),
            ({"license": "GPL-3.0-only"}, "GPL-3.0-only", "field"),
        ],
    )
    def test_it_is_found_where_the_package_states_it(self, metadata, licence, where):
        assert licences.stated_licence({"name": "any", **metadata}) == (licence, where)

    def test_none_is_not_taken_for_one(self):
        metadata = {"name": "any", "license": "", "classifier": ["License :: OSI Approved"]}
        assert licences.stated_licence(metadata) is None

    @pytest.mark.parametrize(
        "expression",
        [
            "GPL-3.0-only",
            "MIT AND AGPL-3.0-or-later",
            "MIT OR GPL-2.0-only",
            "Apache-2.0 WITH another-exception",
            "LicenseRef-NVIDIA-Proprietary",
            "",
        ],
    )
    def test_what_restricts_is_refused(self, expression):
        assert licences.unaccepted(expression)

    def test_every_part_of_an_expression_counts(self):
        assert licences.unaccepted("MPL-2.0 AND (Apache-2.0 OR MIT)") == []
        assert licences.unaccepted("MIT AND (X OR ISC)") == ["X"]

    def test_what_is_pulled_in_follows_markers_and_extras(self):
        packages = {
            "a": {"requires_dist": ["b[fast]", "w; sys_platform == 'win32'", "t; extra == 'test'"]},
            "b": {"requires_dist": ["c>=1; extra == 'fast'", "d; python_version < '3.11'"]},
            **{name: {} for name in ("c", "d", "t", "w")},
        }
        assert licences.pulled_in([Requirement("A>=2")], packages) == {"a", "b", "c"}


class TestAudit:
    PAGE = {"info": {"version": "2.0"}, "vulnerabilities": []}

    def ask(self, pinned):
        asked = []

        def get(url, **options):
            asked.append(url)
            return SimpleNamespace(ok=True, status_code=200, json=lambda: self.PAGE)

        page = audit.ProjectPage(SimpleNamespace(get=get), Version(pinned))
        return page.get(url="index/some-package/2.0/json").status_code, asked

    def test_the_page_of_a_project_answers_for_its_newest_release_alone(self):
        assert self.ask("2.0") == (200, ["index/some-package/json"])
        assert self.ask("1.9")[0] == 404

    def test_a_finding_is_explained_by_any_of_its_names(self, monkeypatch):
        monkeypatch.setattr(audit, "EXPLAINED", {"CVE-1": "not used here"})
        found = SimpleNamespace(id="GHSA-1", aliases={"CVE-1"}, fix_versions=[Version("2")])
        other = SimpleNamespace(id="GHSA-2", aliases=set(), fix_versions=[])
        assert [one["explained"] for one in audit.findings("p==1", [found, other])] == [
            "not used here",
            None,
        ]

    def test_all_pins_are_asked_about(self):
        asked = dict(audit.pinned_everywhere())
        for name in audit.PINS:
            assert pins(audit.ROOT / name).items() <= asked.items()


class TestDistributions:
    def sdist(self, names, seconds, mode, owner):
        content = io.BytesIO()
        with tarfile.open(fileobj=content, mode="w:gz") as archive:
            for name in names:
                member = tarfile.TarInfo(name)
                member.mtime, member.mode, member.uname, member.uid = seconds, mode, owner, 7
                member.size = len(name)
                archive.addfile(member, io.BytesIO(name.encode()))
        return content.getvalue()

    def test_neither_time_nor_order_nor_owner_nor_rights_are_left(self):
        first = normalised(self.sdist(["p/a", "p/b"], 1, 0o600, "ann"), SECONDS)
        second = normalised(self.sdist(["p/b", "p/a"], 2, 0o664, "ben"), SECONDS)
        assert first == second
        with tarfile.open(fileobj=io.BytesIO(first)) as archive:
            [one, other] = archive.getmembers()
            assert archive.extractfile(other).read() == b"p/b"
        assert (one.name, one.mtime, one.mode, one.uid) == ("p/a", SECONDS, 0o644, 0)
        with gzip.open(io.BytesIO(first)) as packed:
            packed.read(1)
            assert packed.mtime == SECONDS

    def test_lacking_and_unwanted_files_are_named(self):
        whole = [end.replace("\\", "").replace("[^/]*", "0.1") for end in NEEDED["wheel"]]
        check_contents("wheel", whole)
        with pytest.raises(WrongError, match=r"lacks \['orchid_uav/py"):
            check_contents("wheel", [name for name in whole if not name.endswith("py.typed")])
        with pytest.raises(WrongError, match=r"not have \['tests/test_a\.py'\]"):
            check_contents("wheel", [*whole, "tests/test_a.py"])


class TestTested:
    def test_builds_of_a_pinned_version_are_that_version(self):
        found = {"torch": "2.13.0+cpu", "numpy": "2.5.5", "new": "1"}
        pinned = {"torch": "2.13.0", "numpy": "2.4.6"}
        assert differences(found, pinned) == ["numpy 2.5.5, pinned 2.4.6"]

    def test_tests_are_counted(self, tmp_path):
        report = tmp_path / "report.xml"
        report.write_text(
            '<testsuites><testsuite tests="5" failures="1" errors="0" skipped="2"/></testsuites>'
        )
        assert counts(report) == {"tests": 5, "failures": 1, "errors": 0, "skipped": 2}


def test_records_name_versions_and_no_machine():
    document = json.loads((licences.RESULT).read_text())
    assert "name" not in document["host"]
    assert document["command"] == "python -m studies.supply_chain.licences"
