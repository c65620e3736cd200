"""Bounds of dependencies, what says that one is missing, and the Pythons that are supported."""

import ast
import json
import re
import runpy
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from orchid_uav import extras, python_version
from studies.pages.dependencies import WHY
from studies.recording import read
from studies.supply_chain.licences import BUNDLED, unaccepted

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
REQUIREMENTS = [
    requirement
    for line in [
        *PROJECT["project"]["dependencies"],
        *(line for lines in PROJECT["project"]["optional-dependencies"].values() for line in lines),
    ]
    if (requirement := Requirement(line)).name != "orchid-uav"
]
"""What this project asks for itself, extras included."""


def pins_of(name: str) -> dict[str, Version]:
    """The versions in a file of constraints, which holds nothing else."""
    lines = (ROOT / name).read_text().splitlines()
    pins = [line.split("==") for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+", part) for pin in pins for part in pin), "an address?"
    return {canonicalize_name(package): Version(version) for package, version in pins}


class TestDependencies:
    @pytest.mark.parametrize("requirement", REQUIREMENTS, ids=lambda requirement: requirement.name)
    def test_its_bound_is_the_version_that_make_test_lowest_takes(self, requirement):
        lowest = pins_of("constraints-lowest.txt")[canonicalize_name(requirement.name)]
        assert requirement.specifier == SpecifierSet(f">={lowest}")

    @pytest.mark.parametrize("requirement", REQUIREMENTS, ids=lambda requirement: requirement.name)
    def test_it_is_pinned_and_the_pin_will_do(self, requirement):
        assert pins_of("constraints.txt")[canonicalize_name(requirement.name)] in (
            requirement.specifier
        )

    def test_the_extras_are_installed_by_what_their_hint_names(self, monkeypatch):
        # In pyproject.toml's words, which pip understands wherever the project itself came from.
        monkeypatch.setattr(sys, "executable", "/home/a b/.venv/bin/python")
        for extra, packages in PROJECT["project"]["optional-dependencies"].items():
            if extra != "dev":
                assert extras.extra_requirements(extra) == packages
        monkeypatch.setattr(sys, "platform", "linux")
        command = "'/home/a b/.venv/bin/python' -m pip install 'mlflow>=3.0'"
        assert extras.install_command("mlflow") == command
        monkeypatch.setattr(sys, "platform", "win32")
        assert extras.install_command("mlflow") == command.replace("'", '"')

    def test_where_pip_is_missing_the_hint_is_for_uv(self, monkeypatch):
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(sys, "executable", "/venv/bin/python")
        monkeypatch.setattr(extras.PathFinder, "find_spec", lambda name: None)
        monkeypatch.setattr(extras.shutil, "which", lambda name: f"/usr/bin/{name}")
        assert extras.install_command("supersuit") == (
            "uv pip install --python /venv/bin/python 'supersuit>=3.10'"
        )


class TestLicences:
    ROWS = {row["name"]: row for row in read("licences")["packages"]}

    @pytest.mark.parametrize("requirement", REQUIREMENTS, ids=lambda requirement: requirement.name)
    def test_its_purpose_and_an_accepted_licence_are_told(self, requirement):
        name = canonicalize_name(requirement.name)
        assert name in self.ROWS, "run: make licences docs-data"
        assert self.ROWS[name]["direct"]
        assert unaccepted(self.ROWS[name]["licence"]) == []
        assert WHY[name]

    def test_the_table_has_the_pinned_versions_and_no_others(self):
        listed = {name: Version(row["version"]) for name, row in self.ROWS.items()}
        assert listed == pins_of("constraints.txt"), "run: make licences docs-data"
        assert not [name for name, row in self.ROWS.items() if unaccepted(row["licence"])]

    def test_nothing_is_explained_that_is_no_dependency(self):
        assert set(WHY) == {canonicalize_name(requirement.name) for requirement in REQUIREMENTS}

    def test_bundled_code_has_its_licence_beside_it(self):
        built_with = json.loads((ROOT / "experiments/replay/page/build/package.json").read_text())[
            "dependencies"
        ]
        rows = {row["name"]: row for row in read("licences")["bundled"]}
        assert set(rows) == set(BUNDLED) == set(built_with) - {"esbuild"}  # which only builds
        for name, row in rows.items():
            text = (ROOT / row["text"]).read_text(encoding="utf-8")
            assert row["version"] == built_with[name]
            assert f"{name}.js {row['version']}" in text
            assert "Permission is hereby granted, free of charge" in text  # MIT


class TestPythonVersion:
    def test_one_is_the_oldest_everywhere(self):
        oldest = ".".join(map(str, python_version.OLDEST))
        assert PROJECT["project"]["requires-python"] == f">={oldest}"
        assert PROJECT["tool"]["ruff"]["target-version"] == f"py{oldest.replace('.', '')}"
        listed = [
            line.rpartition(" ")[2]
            for line in PROJECT["project"]["classifiers"]
            if line.startswith("Programming Language :: Python :: 3.")
        ]
        assert listed[0] == oldest
        for page in ("README.md", "CONTRIBUTING.md"):
            assert f"Python {oldest} to {listed[-1]}" in (ROOT / page).read_text(), page

    @pytest.mark.parametrize("path", ["setup.py", "src/orchid_uav/python_version.py"])
    def test_an_old_one_is_told_in_a_line(self, path, monkeypatch, capsys):
        monkeypatch.chdir(ROOT)
        monkeypatch.setattr(sys, "version_info", (3, 10, 13))
        with pytest.raises(SystemExit) as stop:
            runpy.run_path(path, run_name="__main__")
        assert re.fullmatch(r"ORCHID needs Python 3\.11 or newer, and .*\.", stop.value.code)

    def test_an_old_one_cannot_import_it(self, monkeypatch):
        monkeypatch.setattr(sys, "version_info", (3, 10, 13))
        with pytest.raises(ImportError, match=r"needs Python 3\.11 or newer") as refusal:
            runpy.run_path(str(ROOT / "src" / "orchid_uav" / "__init__.py"), run_name="orchid_uav")
        assert refusal.value.name == "orchid_uav"  # what runpy shows without a traceback

    @pytest.mark.parametrize("path", ["setup.py", *(ROOT / "src" / "orchid_uav").glob("*.py")])
    def test_old_ones_can_read_what_tells_them(self, path):
        ast.parse((ROOT / path).read_text(), feature_version=(3, 7))
