"""The documents of evaluations, as they are written and read back."""

from typing import Annotated

from pydantic import Field, JsonValue

from orchid_uav.envs.keys import CURRENT_KEYS
from orchid_uav.experiments.metrics import label_of
from orchid_uav.experiments.provenance import Status
from orchid_uav.experiments.statistics.intervals import MetricSummary
from orchid_uav.storage.documents import Document


class ResultHeader(Document):
    """The entries with which every document of results begins."""

    schema_version: int = Field(alias="schema")
    status: Status
    date: str
    command: list[str]
    versions: dict[str, str | None]
    host: dict[str, JsonValue]


class MethodSettings(Document):
    """A method of an evaluation."""

    method: str
    run: str | None
    sha256: str | None
    """Checksum of the policy's weights."""
    deterministic: bool
    overrides: Annotated[dict[str, JsonValue], CURRENT_KEYS]
    """Parameters that belong to the method, by ``"section.key"``."""


class EvaluationSettings(Document):
    """All that defines an evaluation: two with equal settings give equal metrics."""

    methods: list[MethodSettings]
    distributions: list[str]
    uavs: list[int]
    users: list[int]
    speeds_mps: list[float]
    heading_hold_s: list[float]
    episodes: int
    """Number of topologies per setting."""
    seed: int
    planner_evaluations: int
    world: Annotated[dict[str, dict[str, JsonValue]], CURRENT_KEYS]
    training_progress: float
    ci95: str
    headroom: str


class EvaluationResult(Document):
    """The result of a method in a setting. In JSON its metrics stand beside the other keys."""

    __pydantic_extra__: dict[str, MetricSummary] = Field(init=False)
    method: str
    run: str | None
    """Id of the run in which the method was learned; None for a rule."""
    objective: str
    distribution: str
    uavs: int
    users: int
    speed_mps: float
    heading_hold_s: float
    deterministic: bool
    episodes: int
    comparable: bool
    """Whether the method has the same task as the others."""

    @property
    def label(self) -> str:
        """The method's name, marked if its actions are sampled."""
        return label_of(self.method, self.deterministic)

    @property
    def metrics(self) -> dict[str, MetricSummary]:
        """The metrics by their names."""
        return self.__pydantic_extra__


class EvaluationSummary(ResultHeader):
    """The content of ``summary.json``."""

    settings: EvaluationSettings
    results: list[EvaluationResult]
