"""Licences, audit, and versions that were tested: parts of docs/dependencies.md."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from packaging.utils import canonicalize_name

from studies.pages.markdown import ROOT, recorded, table
from studies.recording import RESULTS, read
from studies.supply_chain.licences import WEAK_COPYLEFT, direct_requirements

PAGE = ROOT / "docs" / "dependencies.md"
_INTERRUPTED = 2
"""How pytest exits after ctrl-C."""

WHY = {
    "cma": "CMA-ES, the search of the planner",
    "defusedxml": "KML of strangers, without the attacks that XML allows",
    "fastkml": "reads our KML as others do",
    "filelock": "the lock of a run, which the system releases when its process ends",
    "geojson-pydantic": "reads our GeoJSON by its standard",
    "gymnasium": "the interface of environments",
    "hypothesis": "tests of properties",
    "latex2mathml": "formulas of this site",
    "lxml": "with it fastkml checks KML against the schema",
    "matplotlib": "figures",
    "mavsdk": "reads our mission files as a ground station does",
    "mkdocs-material": "this site",
    "mlflow": "training runs in MLflow",
    "mobile-env": "another simulator, whose speed ours is compared with",
    "mpe2": "environments on which our learners stand beside public ones",
    "mpmath": "independent numbers in tests",
    "mypy": "checks types",
    "numba": "the compiled step of the simulator",
    "numpy": "arrays",
    "onnx": "policies as ONNX files",
    "onnxruntime": "runs them, to compare what they answer",
    "pandas": "the example that reads an evaluation",
    "pettingzoo": "the interface of environments with many agents",
    "pillow": "replays as GIF, WebP and PNG",
    "playwright": "drives a browser in tests of the page of replays",
    "pyarrow": "a row per episode, as Parquet",
    "pydantic": "configuration and documents with types, ranges and messages",
    "pymap3d": "degrees to metres and back",
    "pymavlink": "the vehicle of tests that takes our missions",
    "pyogrio": "GeoPackage, Shapefile and GPX",
    "pytest": "tests",
    "pytest-xdist": "tests on several cores",
    "ray": "runs on several machines",
    "rich": "tables and progress on a terminal",
    "ruff": "checks and formats code",
    "safetensors": "policies and checkpoints as files that cannot run code",
    "sb3-contrib": "more algorithms that Reset-and-Finetune is tested with",
    "scikit-learn": "K-Means++",
    "scipy": "constants, statistics, one minimum",
    "shapely": "zones, and distances to them",
    "stable-baselines3": "PPO, which `MAPPO` extends",
    "supersuit": "its path from PettingZoo to Stable-Baselines3",
    "tensorboard": "training curves while they grow",
    "threadpoolctl": "keeps linear algebra to one thread",
    "torch": "networks and their gradients",
    "trackio": "training runs in trackio",
    "typer": "the command line",
    "wandb": "training runs in W&B",
    "ziamath": "the font of these formulas",
}
"""What each direct dependency is for; a test asks for all of them."""


def direct_block() -> str:
    """What this project asks for itself, in the order of ``pyproject.toml``."""
    found = {row["name"]: row for row in read("licences")["packages"]}
    lines = []
    for group, requirements in direct_requirements().items():
        for requirement in requirements:
            name = canonicalize_name(requirement.name)
            row = found[name]
            asks = "–" if group == "base" else f"`{group}`"
            words = [f"`{name}`", asks, WHY[name], row["licence"]]
            lines.append([*words, str(requirement.specifier), row["version"]])
    return table(["package", "extra", "what for", "licence", "bound", "pinned"], lines, words=4)


def licences_block() -> str:
    """How many packages have which licence, and the few that ask for more than their notice."""
    document = read("licences")
    packages = document["packages"]
    counted = Counter(row["licence"] for row in packages)
    weak = [row for row in packages if any(name in row["licence"] for name in WEAK_COPYLEFT)]
    in_base = [row["name"] for row in packages if "base" in row["for"]]
    copyleft_in_base = sorted({row["name"] for row in weak} & set(in_base))
    return "\n".join(
        [
            f"The base installation has {len(in_base)} packages, with all extras it is "
            f"{len(packages)}, and every one has an accepted licence.",
            "",
            table(
                ["licence", "packages"],
                [[name, str(count)] for name, count in counted.most_common()],
            ),
            "",
            "Those under a weak copyleft licence, "
            f"{_words(copyleft_in_base)} of which are in the base installation:",
            "",
            table(
                ["package", "licence", "wanted by"],
                [[f"`{row['name']}`", row["licence"], _users(row)] for row in weak],
                words=3,
            ),
            "",
            f"{recorded(document)}, `make licences` → `studies/results/licences.json`.",
        ]
    )


def all_block() -> str:
    """Every package, and where its licence is stated."""
    return table(
        ["package", "version", "licence", "stated in its", "wanted by"],
        [
            [f"`{row['name']}`", row["version"], row["licence"], row["stated"], _users(row)]
            for row in read("licences")["packages"]
        ],
        words=5,
    )


def bundled_block() -> str:
    """Other people's code in our own files."""
    return table(
        ["code", "version", "licence", "where", "its text"],
        [
            [row["name"], row["version"], row["licence"], f"`{row['in']}`", f"`{row['text']}`"]
            for row in read("licences")["bundled"]
        ],
        words=5,
    )


def audit_block() -> str:
    """What the last audit looked up, what it found, and what it could not look up."""
    document = read("audit")
    unknown = document["not_looked_up"]
    asked = document["pins"] - len(unknown)
    lines = [
        f"{recorded(document)}, pip-audit {document['pip_audit']}, `make audit` → "
        "`studies/results/audit.json`:",
        "",
        f"* looked up: {asked} of {document['pins']} pins, with {len(document['findings'])} "
        "known vulnerabilities;",
        f"* not looked up: {len(unknown)}.",
    ]
    if unknown:
        lines += ["", "Without an answer: " + ", ".join(f"`{pin}`" for pin in unknown) + "."]
    if document["findings"]:
        rows = [
            [one["name"], one["id"], ", ".join(one["fixed_in"]), one["explained"] or "open"]
            for one in document["findings"]
        ]
        lines += ["", table(["pin", "finding", "fixed in", "why it stays"], rows, words=4)]
    return "\n".join(lines)


def tested_block() -> str:
    """With which versions the tests were run, and how that went."""
    rows, notes = [], []
    for which in ("lowest", "newest"):
        path = RESULTS / f"tested_{which}.json"
        if not path.is_file():
            continue
        document = read(path.stem)
        tests = document["tests"]
        failed = tests["failures"] + tests["errors"]
        passed = tests["tests"] - failed - tests["skipped"]
        numbers = [passed, failed, tests["skipped"]]
        rows.append([which, document["python"], *map(str, numbers)])
        what = " ".join(document["settings"]["pytest"])
        stopped = "; stopped before the end" if document["status"] == _INTERRUPTED else ""
        notes.append(f"* {which}: {recorded(document)}, `pytest {what}`{stopped}.")
    header = ["versions", "Python", "passed", "failed", "skipped"]
    return "\n".join([table(header, rows), "", *notes])


def versions_block() -> str:
    """Versions of direct dependencies that were tested: lowest, pinned, newest."""
    tested = {
        which: read(f"tested_{which}")["installed"]
        for which in ("lowest", "newest")
        if (RESULTS / f"tested_{which}.json").is_file()
    }
    packages = read("licences")["packages"]
    tested["pinned"] = {row["name"]: row["version"] for row in packages}
    direct = [row["name"] for row in packages if row["direct"]]
    columns = [which for which in ("lowest", "pinned", "newest") if which in tested]
    return table(
        ["package", *columns],
        [
            [f"`{name}`", *(_public(tested[which].get(name, "–")) for which in columns)]
            for name in direct
        ],
    )


def _public(version: str) -> str:
    return version.partition("+")[0]


def _users(row: Mapping[str, Any]) -> str:
    return ", ".join("all" if group == "base" else f"`{group}`" for group in row["for"])


def _words(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "none"


DEPENDENCY_BLOCKS = {
    "dependencies-direct": (PAGE, direct_block),
    "dependencies-licences": (PAGE, licences_block),
    "dependencies-bundled": (PAGE, bundled_block),
    "dependencies-audit": (PAGE, audit_block),
    "dependencies-tested": (PAGE, tested_block),
    "dependencies-versions": (PAGE, versions_block),
    "dependencies-all": (PAGE, all_block),
}
