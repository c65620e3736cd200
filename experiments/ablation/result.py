"""The document of an ablation, as it is written and read back."""

from typing import Annotated, Literal

from pydantic import JsonValue

from orchid_uav.envs.keys import CURRENT_KEYS
from orchid_uav.experiments.runs.records import SeenStatus
from orchid_uav.experiments.statistics.comparison import Comparison, SeedSummary
from orchid_uav.experiments.statistics.curves import CurveTable
from orchid_uav.experiments.statistics.results import EvaluationResult, ResultHeader
from orchid_uav.storage.documents import Document


class AblationSettings(Document):
    """The settings of an ablation."""

    base: Annotated[dict[str, dict[str, JsonValue]], CURRENT_KEYS]
    """The base's configuration."""
    variants: dict[str, Annotated[dict[str, JsonValue], CURRENT_KEYS]]
    """The values that differ from the base's, by the variant's name and ``"section.key"``."""
    seeds: list[int]
    topologies: int
    evaluation_seed: int
    margin: float
    """Margin of the tests of equivalence, as a share of the base's mean."""
    ci95: str
    family: str


class AblationRun(Document):
    """A run and its metrics, one number each; None for a missing number."""

    variant: str
    seed: int
    run: str | None
    """The run's id; None if it has not begun."""
    status: SeenStatus | Literal["not begun"]
    episodes: int
    seconds: float | None
    reset_episodes: list[int]
    error: str | None
    evaluation: dict[str, float | None]
    sampled: dict[str, float | None]
    training: dict[str, float | None]


class TriggerReplay(Document):
    """In how many runs the trigger of Reset-and-Finetune would have fired."""

    window: int
    tolerance: float
    runs: int
    fired: int
    median_episode: int | float | None


class AblationHeader(ResultHeader):
    """The content of ``ablation.json`` before anything was compared."""

    settings: AblationSettings
    updated: str


class AblationResult(AblationHeader):
    """The content of ``ablation.json``.

    The first keys of ``values`` and ``comparisons`` are "evaluation", "sampled" and "training".
    """

    runs: list[AblationRun]
    values: dict[str, dict[str, dict[str, SeedSummary]]]
    """Values over seeds, by variant and metric."""
    comparisons: dict[str, dict[str, dict[str, Comparison]]]
    """By variant, each compared with the base, and by metric."""
    others: list[EvaluationResult]
    """Rules and zero-action twins on the same topologies."""
    late_changes: dict[str, dict[str, SeedSummary]] | None
    """Late changes by variant and metric; None if runs are too short."""
    replayed_trigger: dict[str, list[TriggerReplay]]
    """Replays of the trigger, by variant; only variants without Reset-and-Finetune."""
    learning_curves: dict[str, dict[str, CurveTable]]
    """Learning curves by variant and metric."""
