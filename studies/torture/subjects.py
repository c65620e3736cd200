"""Commands that are tortured, what a user types then, and what must be the same in the end."""

import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet

ORCHID = (sys.executable, "-P", "-m", "orchid_uav")
"""The command ``orchid`` of this environment."""
SMALL = {
    "network.uav_count": 2,
    "network.user_count": 20,
    "network.episode_slots": 10,
    "ppo.hidden_sizes": "[16,16]",
    "checkpoint.every_episodes": 1,
}
"""An episode takes milliseconds, and every one is followed by a checkpoint."""
RESETS = {
    "reset.window": 5,
    "reset.tolerance_jfi": 1e9,
    "reset.tolerance_reward": 1e9,
    "reset.max_resets": 1000,
}
"""Reset-and-Finetune acts as soon as its windows are full, so every tenth episode."""
SMALL_MADDPG = {
    "maddpg.hidden_sizes": "[16,16]",
    "maddpg.batch_size": 32,
    "maddpg.buffer_size": 400,
}
PEOPLE_FILE = "people.csv"
NOTES = ("stdout", "stderr", PEOPLE_FILE)
"""Files of a working directory that are no command's."""
START = "in the start"
"""Before the command has written anything."""
SEARCH = "in the start, in reading or in searching"
"""A plan writes nothing until its files."""
_PHASES_OF_RUNS = (
    *("in an episode or an update", "in a checkpoint", "while another file is written"),
    "after the last episode",
)
LOCK_FILE, RESERVE_FILE = ".lock", ".reserve"
"""Hidden files of a run: the lock stays, the reserve is there as long as the run goes on."""
_RUNS = "runs"
_RUN_ID = re.compile(r"\d{8}T\d{6}Z-|-[a-z]{4}(?=-zero$|$)")
_EVENTS = re.compile(r"tfevents\..*?(\.hparams)?$")
_LEARNED = ("status", "episodes", "reset_episodes", "final", "config_sha256")
_COMPARED = (
    *("status", "values", "comparisons", "late_changes", "replayed_trigger"),
    "learning_curves",
)
"""Keys of ``ablation.json`` besides ``runs`` and ``others``; left are times, versions, machines."""

Outcome = dict[str, str]
"""Checksums of all that must be the same, by name."""
Command = tuple[str, ...]
"""Arguments of ``orchid``."""


@dataclass(frozen=True)
class Subject:
    """A command that is tortured. It runs in a working directory of its own."""

    name: str
    command: Command
    going_on: Callable[[Path], Command | None]
    """What is typed after a kill, given the working directory; None if all was done before it."""
    outcome: Callable[[Path], Outcome]
    """What the command has made."""
    phase: Callable[[Path], str]
    """Where in its work something has hit the command, by what it left."""
    phases: tuple[str, ...]
    """All of these."""


def positions_file(working: Path) -> None:
    """Write the positions that the plan is made for: 60 people, in the middle of an ocean."""
    places = ((0.008 * (37 * k % 101) / 101, 0.008 * (53 * k % 97) / 97) for k in range(60))
    lines = ["lat,lon", *(f"{north:.6f},{-30.0 + east:.6f}" for north, east in places)]
    (working / PEOPLE_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")


def subjects() -> list[Subject]:
    """All subjects."""
    return [
        _training("train, MAPPO", {**SMALL, **RESETS}, "--episodes=80"),
        _training("train, MAPPO, 3 worlds", {**SMALL, **RESETS}, "--episodes=120", "--worlds=3"),
        _training(
            "train, MADDPG", {**SMALL, **SMALL_MADDPG}, "--episodes=60", "--algorithm=maddpg"
        ),
        _ablation(),
        _evaluation(),
        _plan(),
    ]


def assignments(values: Mapping[str, Any], option: str = "--set") -> list[str]:
    """Options that set values of the configuration."""
    return [f"{option}={key}={value}" for key, value in values.items()]


def _training(name: str, values: Mapping[str, Any], *flags: str) -> Subject:
    command = ("train", *assignments(values), *flags, f"--runs-dir={_RUNS}", "--quiet")

    def going_on(working: Path) -> Command | None:
        records = _records(working / _RUNS)
        if not records:
            return command
        [(run, record)] = records.items()
        if record["status"] == "completed":
            return None
        return ("train", "--resume", run.name, f"--runs-dir={_RUNS}", "--quiet")

    def phase(working: Path) -> str:
        return _phase_of_runs(working / _RUNS) or "before the run has a record"

    def outcome(working: Path) -> Outcome:
        return outcome_of_runs(working / _RUNS)

    phases = (START, "before the run has a record", *_PHASES_OF_RUNS)
    return Subject(name, command, going_on, outcome, phase, phases)


def _ablation() -> Subject:
    base = assignments({**SMALL, **RESETS, "training.episodes": 40}, "--base")
    study: Command = ("ablate", "--no-rf", "--seeds=0", "--jobs=2", *base)
    study = (*study, "--topologies=2", "--out=study", "--quiet")

    def outcome(working: Path) -> Outcome:
        document = _document(working / "study" / "ablation.json")
        for run in document["runs"]:
            del run["run"], run["seconds"]
        made = {f"ablation.json: {name}": _checksum(document[name]) for name in _COMPARED}
        made["ablation.json: others"] = _unnamed(document["others"])
        made["ablation.json: runs"] = _checksum(document["runs"])
        made["files"] = _checksum(sorted(path.name for path in (working / "study").iterdir()))
        made |= outcome_of_runs(working / "study" / "runs")
        return made | _of_flights(working / "study" / "evaluation")

    def phase(working: Path) -> str:
        directory = working / "study"
        if not (directory / "ablation.json").exists():
            return "before the study is there"
        flights = directory / "evaluation"
        if (flights / "summary.json").exists() and (
            _document(flights / "summary.json")["status"] == "completed"
        ):
            return "while results are compared and drawn"
        if flights.exists():
            return "in flights"
        return _phase_of_runs(directory / "runs") or "before a run has a record"

    phases = (
        *(START, "before the study is there", "before a run has a record", *_PHASES_OF_RUNS),
        *("in flights", "while results are compared and drawn"),
    )
    return Subject("ablate", study, lambda _: study, outcome, phase, phases)


def _evaluation() -> Subject:
    command = ("eval", "--methods=orchid,static-mmf,loiter-mmf", "--users=20,40")
    command = (*command, "--episodes=6", "--out=evaluation", "--quiet")
    directory = "evaluation"

    def going_on(working: Path) -> Command | None:
        path = working / directory / "summary.json"
        is_complete = path.exists() and _document(path)["status"] == "completed"
        return None if is_complete else command

    def outcome(working: Path) -> Outcome:
        return {"files": _checksum(files_in(working / directory))} | _of_flights(
            working / directory
        )

    def phase(working: Path) -> str:
        place = working / directory
        if not (place / "summary.json").exists():
            return "before anything is kept"
        if going_on(working) is None:
            return "after its end"
        if any(path.name.startswith(".drawing") for path in place.iterdir()):
            return "while figures are drawn"
        return "while a file is written" if unfinished(place) else "in flights"

    phases = (
        *(START, "before anything is kept", "in flights", "while a file is written"),
        *("while figures are drawn", "after its end"),
    )
    return Subject("eval", command, going_on, outcome, phase, phases)


def _plan() -> Subject:
    command = ("plan", PEOPLE_FILE, "--drones=3", "--budget=20000", "--out=plan", "--quiet")

    def going_on(working: Path) -> Command | None:
        return None if (working / "plan").exists() else command

    def outcome(working: Path) -> Outcome:
        plan = working / "plan"
        made = {name: _bytes_of(plan / name) for name in files_in(plan) if name != "plan.json"}
        document = _document(plan / "plan.json")
        for key in ("date", "seconds"):
            document.pop(key, None)
        return made | {"plan.json": _checksum(document)}

    def phase(working: Path) -> str:
        if (working / "plan").exists():
            return "after the plan is there"
        return "while its files are written" if unfinished(working) else SEARCH

    phases = (SEARCH, "while its files are written", "after the plan is there")
    return Subject("plan", command, going_on, outcome, phase, phases)


def _records(runs: Path) -> dict[Path, dict[str, Any]]:
    return {path.parent: _document(path) for path in sorted(runs.glob("*/run.json"))}


def episodes_done(working: Path) -> int:
    """Rows that all runs of a working directory have in their logs."""
    logs = [path for path in paths_below(working) if path.name == "episodes.csv"]
    return sum(max(0, log.read_bytes().count(b"\n") - 1) for log in logs)


def outcome_of_runs(runs: Path) -> Outcome:
    """What is learned by each run, by its name and seed; and which files there are."""
    outcome: Outcome = {}
    for run, record in _records(runs).items():
        key = _RUN_ID.sub("", run.name)
        made = {
            "record": _checksum({name: record[name] for name in _LEARNED}),
            "files": _checksum(
                sorted({_EVENTS.sub(r"tfevents\1", name) for name in files_in(run)})
            ),
        }
        for name in ("episodes.csv", "policy.safetensors"):
            made[name] = _bytes_of(run / name)
        for path in sorted(run.glob("checkpoints/*/*.safetensors")):
            made[str(path.relative_to(run))] = _bytes_of(path)
        outcome |= {f"{key}: {name}": checksum for name, checksum in made.items()}
    return outcome


def _of_flights(directory: Path) -> Outcome:
    """Every flight, and what is told of them."""
    flights = pyarrow.parquet.read_table(directory / "episodes.parquet")
    summary = _document(directory / "summary.json")
    return {
        "episodes.parquet": _unnamed(flights.to_pylist()),
        "summary.json: status": _checksum(summary["status"]),
        "summary.json: results": _unnamed(summary["results"]),
    }


def _unnamed(results: Sequence[Mapping[str, Any]]) -> str:
    """Of results in any order; the id of a run holds its time and random letters."""

    def without_id(name: str | None) -> str | None:
        return None if name is None else _RUN_ID.sub("", name)

    named = ("method", "run")
    return _checksum(
        sorted(
            _checksum({**result, **{key: without_id(result.get(key)) for key in named}})
            for result in results
        )
    )


def _phase_of_runs(runs: Path) -> str:
    """Where runs are; an empty text if none has a record."""
    records = _records(runs)
    if not records:
        return ""
    if all(record["status"] == "completed" for record in records.values()):
        return "after the last episode"
    places = [path.parent.name for path in unfinished(runs)]
    if "checkpoints" in places:
        return "in a checkpoint"
    return "while another file is written" if places else "in an episode or an update"


def unfinished(directory: Path) -> list[Path]:
    """Temporary files and folders that a command has at this moment, or that it left."""
    return [path for path in _hidden(directory) if path.name not in {LOCK_FILE, RESERVE_FILE}]


def unborn(directory: Path) -> list[Path]:
    """Directories of runs that were killed before they had a record; no command takes them for any.

    Nobody removes them, since a record may also be missing because it is not copied yet.
    """
    runs = [path.parent for path in directory.rglob(LOCK_FILE)]
    return [run for run in runs if not (run / "run.json").exists()]


def litter(directory: Path) -> list[Path]:
    """What should not be there at the end: hidden files, but for locks."""
    nobodys = unborn(directory)
    return [
        path for path in _hidden(directory) if path.name != LOCK_FILE and path.parent not in nobodys
    ]


def paths_below(directory: Path) -> Iterator[Path]:
    """All files and folders, also while some of them come and go, for which ``rglob`` fails."""
    for folder, folders, files in os.walk(directory):
        for name in (*folders, *files):
            yield Path(folder) / name


def _hidden(directory: Path) -> list[Path]:
    """Hidden files and folders that do not lie in one another."""
    found = sorted(path for path in paths_below(directory) if path.name.startswith("."))
    return [path for path in found if not set(path.parents).intersection(found)]


def differences(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """Names of what is not the same in both outcomes."""
    return sorted(name for name in {*one, *other} if one.get(name) != other.get(name))


def files_in(directory: Path) -> list[str]:
    """Paths of all files below a directory."""
    found = (path for path in directory.rglob("*") if path.is_file())
    return sorted(str(path.relative_to(directory)) for path in found)


def _document(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def _bytes_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _checksum(content: object) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
