"""The documents of evaluations, as they are written and read back."""

from typing import Annotated, Literal

from pydantic import Field, JsonValue

from orchid_uav.envs.parameters import CURRENT_KEYS
from orchid_uav.experiments.metrics import label_of
from orchid_uav.experiments.statistics.intervals import MetricSummary
from orchid_uav.storage.documents import Document

Status = Literal["running", "completed", "failed", "interrupted"]


class ResultHeader(Document):
    """What every document of results begins with."""

    schema_version: int = Field(alias="schema")
    status: Status
    date: str
    command: list[str]
    versions: dict[str, str | None]
    host: dict[str, JsonValue]


class MethodSettings(Document):
    """What was flown in an evaluation."""

    method: str
    run: str | None
    sha256: str | None
    """Checksum of the policy's weights."""
    deterministic: bool
    overrides: Annotated[dict[str, JsonValue], CURRENT_KEYS]
    """Parameters that belong to the method, by ``"section.key"``."""


class EvaluationSettings(Document):
    """What defines an evaluation: two with equal settings give equal metrics."""

    methods: list[MethodSettings]
    distributions: list[str]
    uavs: list[int]
    users: list[int]
    speeds_mps: list[float]
    heading_hold_s: list[float]
    episodes: int
    """Topologies per setting."""
    seed: int
    planner_evaluations: int
    world: Annotated[dict[str, dict[str, JsonValue]], CURRENT_KEYS]
    training_progress: float
    ci95: str
    headroom: str


class EvaluationResult(Document):
    """A method in a setting. In JSON its metrics stand beside the other keys."""

    __pydantic_extra__: dict[str, MetricSummary] = Field(init=False)
    method: str
    run: str | None
    """The id of the run that it was learned in; None for a rule."""
    objective: str
    distribution: str
    uavs: int
    users: int
    speed_mps: float
    heading_hold_s: float
    deterministic: bool
    episodes: int
    comparable: bool
    """Whether it has the same task as the others."""

    @property
    def label(self) -> str:
        """The method, and whether its actions are sampled."""
        return label_of(self.method, self.deterministic)

    @property
    def metrics(self) -> dict[str, MetricSummary]:
        """By the metrics' names."""
        return self.__pydantic_extra__


class EvaluationSummary(ResultHeader):
    """The content of ``summary.json``."""

    settings: EvaluationSettings
    results: list[EvaluationResult]
