"""Command lines, ranges and files that nobody would write by hand: none may do harm.

Every case is a command in a process of its own. It may accept (exit code 0) or refuse (2); a
refusal is one line that begins with ``error:``, never a traceback, and leaves everything as it was.
"""

import gc
import io
import json
import re
import tempfile
import time
import zipfile
from collections.abc import Callable
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import hypothesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from orchid_uav.cli.main import main
from orchid_uav.cli.ranges import MOST_VALUES, parse_numbers
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from studies.torture.cases import Bench, Tally
from studies.torture.command_lines import RUN, command_lines, ranges
from studies.torture.files import (
    changed_archive,
    changed_json,
    changed_toml,
    positions_csv,
    positions_geojson,
    positions_kml,
)
from studies.torture.subjects import positions_file

CASES = 2000
"""Of each surface, at scale 1."""
_PLANNED_RANGES = 40
"""Ranges that are flown as well, of those that are right: each takes seconds."""

Try = Callable[[Any], None]


def run(scale: float, seed: int) -> dict[str, Any]:
    """Try ``CASES`` times ``scale`` cases on every surface."""
    cases = max(10, round(CASES * scale))
    with tempfile.TemporaryDirectory() as place:
        template = Path(place) / "template"
        template.mkdir()
        _prepare(template)
        bench = Bench(Path(place), template)
        surfaces = [
            _surface(name, strategy, attempt(bench, tally), tally, cases, seed)
            for name, (strategy, attempt) in _surfaces(template).items()
            for tally in [Tally()]
        ]
    return {
        "cases": sum(surface["cases"] for surface in surfaces),
        "surfaces": surfaces,
        "failures": [
            f"{surface['name']}: {surface['failure']}" for surface in surfaces if surface["failure"]
        ],
    }


def _prepare(directory: Path) -> None:
    """Make what commands are given; it compiles and imports what they need as well."""
    positions_file(directory)
    square = [[-30.0, 0.0], [-29.99, 0.0], [-29.99, 0.01], [-30.0, 0.01], [-30.0, 0.0]]
    area = {"type": "Polygon", "coordinates": [square]}
    (directory / "area.geojson").write_text(json.dumps(area), encoding="utf-8")
    (directory / "config.toml").write_text("network.uav_count = 2\n", encoding="utf-8")
    (directory / "config.json").write_text('{"reset": {"kappa": 0.3}}', encoding="utf-8")
    small = ["--uavs=2", "--users=10", "--set=network.episode_slots=2", "--quiet"]
    runs = directory / "runs"
    _must(["train", *small, "--set=ppo.hidden_sizes=[8]", "--episodes=2", f"--runs-dir={runs}"])
    [made] = runs.iterdir()
    made.rename(runs / RUN)
    zipped = directory / "run.zip"
    _must(["runs", "export", RUN, f"--runs-dir={runs}", f"--out={zipped}"])
    people, plan = directory / "people.csv", directory / "plan"
    _must(["plan", str(people), "--drones=1", "--budget=20", f"--out={plan}", "--quiet"])
    mission = next((plan / "missions" / "px4").glob("*.plan"))
    (directory / "mission.plan").write_bytes(mission.read_bytes())
    for path in sorted(plan.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    plan.rmdir()
    gc.collect()
    gc.freeze()  # or every forked process would copy what it only looks through


def _must(arguments: list[str]) -> None:
    if code := main(arguments):
        raise SystemExit(f"orchid {' '.join(arguments)} ends with {code}")


def _surfaces(template: Path) -> dict[str, tuple[Any, Callable[..., Try]]]:
    """By name: what is drawn, and what is done with it."""
    mission = json.loads((template / "mission.plan").read_text(encoding="utf-8"))
    config = RunConfig().model_dump(mode="json")
    archive = (template / "run.zip").read_bytes()
    documents = st.one_of(
        changed_json(config).map(lambda content: ("json", content)),
        changed_json({"network": {"uav_count": 3}, "reset": {"kappa": 0.2}}).map(
            lambda content: ("json", content)
        ),
        changed_toml().map(lambda content: ("toml", content)),
    )
    positions = st.one_of(
        positions_csv().map(lambda content: ("csv", content)),
        positions_geojson().map(lambda content: ("geojson", content)),
        positions_kml().map(lambda content: ("kml", content)),
        positions_kml().map(_zipped).map(lambda content: ("kmz", content)),
    )
    return {
        "command lines": (command_lines(), _try_command_line),
        "ranges": (ranges(), _try_range),
        "configurations": (documents, _try_configuration),
        "position files": (positions, _try_positions),
        "mission files": (changed_json(mission), _try_mission),
        "archives of runs": (changed_archive(archive), _try_archive),
    }


def _zipped(content: bytes) -> bytes:
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as made:
        made.writestr("doc.kml", content)
    return written.getvalue()


def _try_command_line(bench: Bench, tally: Tally) -> Try:
    return lambda arguments: bench.try_one(arguments, {}, tally)


def _try_configuration(bench: Bench, tally: Tally) -> Try:
    def attempt(drawn: tuple[str, bytes]) -> None:
        kind, content = drawn
        name = f"drawn.{kind}"
        bench.try_one(["config", "show", f"--config={name}", "--json"], {name: content}, tally)

    return attempt


def _try_positions(bench: Bench, tally: Tally) -> Try:
    def attempt(drawn: tuple[str, bytes]) -> None:
        kind, content = drawn
        name = f"drawn.{kind}"
        command = ["plan", name, "--drones=1", "--budget=3", "--out=made", "--quiet"]
        bench.try_one(command, {name: content}, tally)

    return attempt


def _try_mission(bench: Bench, tally: Tally) -> Try:
    return lambda content: bench.try_one(
        ["plan", "--check", "drawn.plan"], {"drawn.plan": content}, tally
    )


def _try_archive(bench: Bench, tally: Tally) -> Try:
    return lambda content: bench.try_one(
        ["runs", "import", "drawn.zip", "--runs-dir=elsewhere"], {"drawn.zip": content}, tally
    )


def _try_range(bench: Bench, tally: Tally) -> Try:
    """Ranges are compared with a reading of their own; some are given to a command as well."""
    flown = 0

    def attempt(text: str) -> None:
        nonlocal flown
        try:
            values: list[float] | None = parse_numbers(text, "--uavs")
        except InputError:
            values = None
        expected = read_range(text)
        assert values == expected, f"{text!r} is read as {values}, not as {expected}"
        if values is not None:
            tally.codes["0"] += 1
            flown += 1
            few = len(values) <= 3 and all(value in (1.0, 2.0, 3.0) for value in values)
            if not few or flown > _PLANNED_RANGES or text.startswith("-"):
                return
        else:
            tally.codes["2"] += 1
        if values is None and text.startswith("-"):
            return  # as a word of its own it would be an option
        command = ["eval", f"--uavs={text}", "--users=10", "--set=network.episode_slots=2"]
        own = Tally()
        bench.try_one([*command, "--episodes=1", "--methods=static-mmf"], {}, own)
        tally.seconds += own.seconds
        tally.messages |= own.messages
        assert own.codes["2" if values is None else "0"] == 1, f"--uavs={text!r}: {own.codes}"

    return attempt


_PLAIN = re.compile(r"[+-]?(\d+(\.\d+)?|\.\d+)([eE][+-]?\d+)?")  # digits of all scripts


def read_range(text: str) -> list[float] | None:
    """What a list of numbers means, after the documentation; None if it means nothing.

    Written apart from the program's own reading: by the sizes of steps, not by adding them up.
    """
    values: list[float] = []
    for part in text.split(","):
        first_text, dots, rest = part.strip().partition("..")
        last_text, colon, step_text = rest.partition(":")
        texts = [first_text, *([last_text] if dots else []), *([step_text] if colon else [])]
        try:
            numbers = [Decimal(one) for one in texts if _PLAIN.fullmatch(one)]
        except InvalidOperation:
            return None
        if len(numbers) < len(texts) or any(abs(one) > Decimal("1e9") for one in numbers):
            return None
        first = numbers[0]
        last = numbers[1] if dots else first
        step = numbers[2] if colon else Decimal(1)
        if dots and (step < Decimal("1e-9") or last < first):
            return None
        count = int((last - first) // step) + 1 if dots else 1
        values += [float(first + number * step) for number in range(min(count, MOST_VALUES + 1))]
    distinct = list(dict.fromkeys(values))
    return distinct if len(distinct) <= MOST_VALUES else None


def _surface(
    name: str, strategy: Any, attempt: Try, tally: Tally, cases: int, seed: int
) -> dict[str, Any]:
    """Draw the cases of one surface; the first broken promise ends it, made as small as can be."""
    began_s = time.monotonic()

    @hypothesis.seed(seed)
    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )
    @given(strategy)
    def try_all(drawn: Any) -> None:
        attempt(drawn)
        if not tally.cases % 200:
            print(f"{name}: {tally.cases} cases, {dict(tally.codes)}", flush=True)

    failure = ""
    try:
        try_all()
    except BaseException as error:  # of hypothesis as well
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise
        failure = str(error)
    done = dict(sorted(tally.codes.items()))
    print(
        f"{name}: {tally.cases} cases, {done}{f'; FAILED: {failure}' * bool(failure)}", flush=True
    )
    return {
        "name": name,
        "cases": tally.cases,
        "ended": done,
        "kinds_of_refusal": len(tally.messages),
        "seconds": round(time.monotonic() - began_s, 1),
        "failure": failure,
    }
