"""What the rooms may import, how large they are, and that everything is shipped."""

import ast
import sys
import tomllib
from pathlib import Path

import pytest

from tests.mutants import MUTANTS, faulty

ROOT = Path(__file__).parent.parent

PLACES = {
    "": "src/orchid_uav",
    "envs": "envs",
    "agents": "agents",
    "callbacks": "callbacks",
    "experiments": "experiments",
    "cli": "orchid_cli",
}
"""Folders of the rooms, top to bottom: a room may import those before it, and itself. The first is
the ground, which all may import; its ``__main__``, which starts the command, stands on top."""

LIBRARIES = {
    "": {"gymnasium", "numpy", "pydantic", "safetensors"},
    "envs": {
        "annotated_types",
        "gymnasium",
        "numba",
        "numpy",
        "pettingzoo",
        "pydantic",
        "scipy",
        "sklearn",
    }
    | {"stable_baselines3", "supersuit", "threadpoolctl"},
    "agents": {"cma", "gymnasium", "numba", "numpy", "pydantic", "safetensors", "scipy"}
    | {"stable_baselines3", "torch"},
    "callbacks": {"stable_baselines3", "torch"},
    "experiments": {"filelock", "matplotlib", "mlflow", "numpy", "pyarrow", "pydantic", "scipy"}
    | {"safetensors", "stable_baselines3", "tensorboard", "threadpoolctl", "torch", "trackio"}
    | {"PIL", "defusedxml", "onnxruntime", "pymap3d", "pyogrio", "shapely"},
    "cli": {"rich", "typer"},  # no logic of its own, hence neither numpy nor torch
}
"""What each room may import of other people's."""

STOREYS = (
    {"configuration", "configuration_files", "errors", "interruption", "markup", "metrics"}
    | {"output", "pages", "presets", "provenance"},
    {"jobs", "statistics"},
    {"figures", "runs"},
    {"evaluation", "training"},
    {"ablation", "exporting", "planning"},
    {"replay", "reproduction"},
)
"""Of ``experiments/``: flat files first, then rooms. Each may import what stands before its own."""

MOST_FILES = 25
"""In one folder; more than that is no room but a heap."""


def imports_of(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
            if node.module in ("orchid_uav", "orchid_uav.experiments"):
                found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def modules_of(folder: str) -> list[Path]:
    found = sorted((ROOT / folder).rglob("*.py"))
    return [path for path in found if path.name != "__main__.py"]


@pytest.mark.parametrize("room", PLACES)
def test_imports_go_one_way(room):
    rooms = list(PLACES)
    below = set(rooms[rooms.index(room) + 1 :])
    for path in modules_of(PLACES[room]):
        for module in imports_of(path):
            root, _, rest = module.partition(".")
            if root == "orchid_uav":
                assert rest.split(".")[0] not in below, f"{path} imports {module}"


@pytest.mark.parametrize("room", PLACES)
def test_every_room_keeps_to_its_libraries(room):
    allowed = {*sys.stdlib_module_names, *LIBRARIES[room], "orchid_uav"}
    for path in modules_of(PLACES[room]):
        foreign = {module.split(".")[0] for module in imports_of(path)} - allowed
        # The folders' bare names, such as envs, are other people's packages.
        assert not foreign, f"{path} imports {foreign}"


def test_libraries_of_learning_stay_out_of_the_simulator():
    for path in modules_of("envs"):
        if "interfaces" not in path.parts:
            roots = {module.split(".")[0] for module in imports_of(path)}
            assert not roots & {"stable_baselines3", "supersuit", "torch"}, path


def test_studies_are_built_in_storeys():
    storeys = {name: level for level, names in enumerate(STOREYS) for name in names}
    for path in modules_of("experiments"):
        own = path.relative_to(ROOT / "experiments").parts[0].removesuffix(".py")
        if own == "__init__":
            continue
        for module in imports_of(path):
            parts = module.split(".")
            if parts[:2] == ["orchid_uav", "experiments"] and len(parts) > 2 and parts[2] != own:
                assert storeys[parts[2]] <= storeys[own], f"{path} imports {module}"
                if storeys[own]:  # flat files may use each other
                    assert storeys[parts[2]] < storeys[own], f"{path} imports {module}"


def test_nothing_is_unpickled():
    for folder in PLACES.values():
        for path in modules_of(folder):
            roots = {module.split(".")[0] for module in imports_of(path)}
            assert not roots & {"pickle", "cloudpickle", "joblib", "dill"}, path


def test_every_folder_of_code_is_packaged():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    settings = project["tool"]["setuptools"]
    tops = {folder: name for name, folder in settings["package-dir"].items()}
    expected = set()
    for folder, name in tops.items():
        for path in (ROOT / folder).rglob("__init__.py"):
            inner = path.parent.relative_to(ROOT / folder).parts
            expected.add(".".join((name, *inner)))
    assert set(settings["packages"]) == expected
    for folder in PLACES.values():
        for path in modules_of(folder):
            assert (path.parent / "__init__.py").is_file(), f"{path} lies in no package"


def test_no_room_is_a_heap():
    for folder in (*PLACES.values(), "benchmarks", "studies", "tests"):
        for path in (ROOT / folder, *(ROOT / folder).rglob("*")):
            if path.is_dir():
                count = len(list(path.glob("*.py")))
                assert count <= MOST_FILES, f"{path} holds {count} files"


def test_tests_lie_in_the_rooms_of_what_they_test():
    rooms = {*PLACES, "browser", "storage", "studies", "helpers", "data"}
    folders = {path.name for path in (ROOT / "tests").iterdir() if path.is_dir()}
    assert folders - {"__pycache__"} <= rooms


def test_files_are_short_enough_to_hold_in_the_head():
    for folder in PLACES.values():
        for path in modules_of(folder):
            lines = len(path.read_text(encoding="utf-8").splitlines())
            assert lines <= 500, f"{path} has {lines} lines"


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_faults_to_plant_fit_the_code(mutant):
    assert faulty(mutant, (ROOT / mutant.file).read_text(encoding="utf-8")).count(mutant.new)
