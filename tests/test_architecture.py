"""What the folders may import, and that everything is shipped."""

import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ["envs", "agents", "callbacks", "experiments", "orchid_cli"]
"""Top to bottom: a room may import from those before it, and from itself."""
PACKAGES = {"orchid_cli": "cli"}


def imports_of(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
            if node.module == "orchid_uav":
                found |= {f"orchid_uav.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_imports_go_one_way(room):
    allowed = {PACKAGES.get(name, name) for name in ROOMS[: ROOMS.index(room) + 1]}
    for path in (ROOT / room).rglob("*.py"):
        for module in imports_of(path):
            root, _, rest = module.partition(".")
            if root == "orchid_uav" and rest and rest != "__version__":
                assert rest.split(".")[0] in allowed, f"{path} imports {module}"
            assert root not in ROOMS, f"{path} imports {module} by its folder's name"


def test_the_command_has_no_logic_of_its_own():
    for path in (ROOT / "orchid_cli").rglob("*.py"):
        roots = {module.split(".")[0] for module in imports_of(path)}
        assert not roots & {"torch", "numpy", "stable_baselines3"}, path


def test_nothing_is_unpickled():
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            roots = {module.split(".")[0] for module in imports_of(path)}
            assert not roots & {"pickle", "cloudpickle", "joblib", "dill"}, path


def test_every_folder_of_code_is_packaged():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    shipped = set(project["package-dir"].values())
    folders = {
        str(path.parent.relative_to(ROOT))
        for room in [*ROOMS, "src", "runs/reference"]
        for path in (ROOT / room).rglob("__init__.py")
    }
    assert folders == shipped
    assert set(project["packages"]) == set(project["package-dir"])


def test_files_are_short_enough_to_hold_in_the_head():
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            lines = len(path.read_text().splitlines())
            assert lines <= 500, f"{path} has {lines} lines"
