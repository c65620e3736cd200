"""What one seed of a method has given: a small JSON file, so that nothing is trained twice."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

from pydantic import Field, JsonValue

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.storage.documents import Document, rounded
from orchid_uav.storage.files import read_document, write_atomically

SCHEMA = 1
_LARGEST_ROW = 2**24
_DIGITS = 5
_NAME = re.compile(r"seed-\d+|rule")


class FlownCase(Document):
    """A policy in a case: every metric over the topologies."""

    distribution: str
    uavs: int
    users: int
    speed_mps: float
    heading_hold_s: float
    sensing_error_m: float
    deterministic: bool
    is_zero: bool
    """Whether this is the zero-action twin."""
    metrics: dict[str, list[float | None]]
    """[mean, standard deviation] over topologies by metric; None for what is not a number."""
    topologies: dict[str, list[float]] = Field(default_factory=dict)
    """Every topology's value, for the few metrics and cases of which figures show them."""

    def matches(self, case: Case) -> bool:
        """Whether this is that case."""
        own = (self.distribution, self.uavs, self.users, self.speed_mps, self.heading_hold_s)
        return own == tuple(case.setting) and self.sensing_error_m == case.sensing_error_m


class TrainingCurve(Document):
    """Means and standard deviations over blocks of successive episodes, by column."""

    block: int
    """Episodes in a block."""
    mean: dict[str, list[float]]
    std: dict[str, list[float]]


class Firing(Document):
    """When the trigger of Reset-and-Finetune would first have fired on a run."""

    window: int
    tolerance: float
    episode: int | None


class Row(Document):
    """One seed of a method, or a rule, which has no seed."""

    schema_version: int = Field(alias="schema")
    method: str
    seed: int | None
    date: str
    command: list[str]
    host: dict[str, JsonValue]
    versions: dict[str, str | None]
    is_quick: bool = False
    episodes: int = 0
    seconds_trained: float | None = None
    seconds_flown: float | None = None
    reset_episodes: list[int] = Field(default_factory=list)
    curve: TrainingCurve | None = None
    evaluations: dict[str, dict[str, float]] = Field(default_factory=dict)
    """The deterministic policy on the way, on topologies of its own, at the training progress of
    the moment: means by metric, by the number of episodes."""
    update_variances: list[float] = Field(default_factory=list)
    """Var(Δθ) of the actor, by update; see :class:`UpdateVariance`."""
    firings: list[Firing] = Field(default_factory=list)
    actor_latency_us: float | None = None
    """Median time of one UAV's decision on one core of ``host``."""
    flights: list[FlownCase] = Field(default_factory=list)

    def find(self, case: Case, deterministic: bool = True, is_zero: bool = False) -> FlownCase:
        """What was flown in a case.

        Raises:
            LookupError: nothing was.
        """
        for flight in self.flights:
            kind = flight.deterministic, flight.is_zero
            if kind == (deterministic, is_zero) and flight.matches(case):
                return flight
        raise LookupError(f"{self.method} was not flown in {case}")


def row_path(folder: Path, method: str, seed: int | None) -> Path:
    """The file of a row."""
    return folder / method / ("rule.json" if seed is None else f"seed-{seed}.json")


def write_row(folder: Path, row: Row) -> None:
    """Write a row in one step, with numbers of five digits and a line for each flight."""
    path = row_path(folder, row.method, row.seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(rounded(row.to_json(), _DIGITS), ensure_ascii=False, separators=(",", ":"))
    for beginning in ('{"distribution":', '"curve":', '"evaluations":', '"update_variances":'):
        text = text.replace(beginning, f"\n{beginning}")
    write_atomically(path, (text + "\n").encode())


def read_row(path: Path) -> Row:
    """Read a row.

    Raises:
        InputError: the file cannot be read, or is no row.
    """
    try:
        row = Row.from_json(read_document(path, _LARGEST_ROW))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is no row of orchid reproduce: {error}") from error
    if row.schema_version != SCHEMA or path != row_path(path.parents[1], row.method, row.seed):
        raise InputError(f"{path} holds a row of schema {row.schema_version}, {row.method}")
    return row


def read_rows(folder: Path) -> Iterator[Row]:
    """All rows in a folder, by method and seed; none where there is no folder.

    Raises:
        InputError: a file cannot be read, or is no row.
    """
    for path in sorted(folder.glob("*/*.json")):
        if _NAME.fullmatch(path.stem):
            yield read_row(path)
