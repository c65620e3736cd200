"""What a plan can be told beside the people: the network's keys, and ``plan.*``."""

from collections.abc import Iterable
from typing import Annotated, Literal

from orchid_uav.envs.keys import Section, within
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.configuration import Layer, merge_into
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Want
from orchid_uav.suggestions import unknown

Environment = Literal["suburban", "urban", "dense-urban", "high-rise"]
ENVIRONMENTS: dict[str, tuple[float, float, float, float]] = {
    "suburban": (4.88, 0.43, 0.1, 21.0),
    "urban": (9.61, 0.16, 1.0, 20.0),
    "dense-urban": (12.08, 0.11, 1.6, 23.0),
    "high-rise": (27.23, 0.08, 2.3, 34.0),
}
"""a and b of the S-curve, and mean excess losses in dB with and without a line of sight, at 2 GHz:
A. Al-Hourani, S. Kandeepan and S. Lardner, "Optimal LAP altitude for maximum coverage", IEEE
Wireless Communications Letters 3(6), 2014; "urban" is Table I of the paper."""
_ENVIRONMENT_KEYS = (
    *("channel.s_curve_a", "channel.s_curve_b"),
    *("channel.excess_loss_los_db", "channel.excess_loss_nlos_db"),
)


class PlanSettings(Section):
    """What `orchid plan` plans, and for which drones; no other command has these keys."""

    drones: Annotated[int, within(1, 1000)] | None = 6
    """Number of drones; none finds the least that meets what is wanted."""
    environment: Environment = "urban"
    """What stands around: sets the constants of the air-to-ground channel."""
    want_rate_bps: Annotated[float, within(1.0, 1e12)] | None = None
    """Rate that people are to have."""
    want_share: Annotated[float, within(1e-9, 1.0)] = 0.95
    """Share of all people who are to have it."""
    hover: bool = False
    """Whether drones stand still, tethered for example, instead of circling."""
    clearance_m: Annotated[float, within(0.0, 1e4)] = 50.0
    """Least distance between the circles of two drones."""
    area_margin_m: Annotated[float, within(1.0, 2e4)] = 300.0
    """By which the area is wider than where people are, if no area is given."""
    battery_wh: Annotated[float, within(1.0, 1e6)] = 800.0
    """Energy of a full battery in Wh."""
    reserve: Annotated[float, within(0.0, 0.95)] = 0.2
    """Share of the battery that is left on landing."""
    swap_minutes: Annotated[float, within(0.0, 1440.0)] = 10.0
    """Time in which a drone that has landed gets another battery, in minutes."""
    seed: Annotated[int, within(0, 2**32 - 1)] = 0
    """Seed of the search and of all draws."""

    @property
    def want(self) -> Want | None:
        """What is wanted, if anything is."""
        return None if self.want_rate_bps is None else Want(self.want_rate_bps, self.want_share)


class PlanConfig(Parameters):
    """Everything that a plan is made with, but people and places."""

    plan: PlanSettings = PlanSettings()
    """Plans of real places; only `orchid plan` has these keys."""

    @property
    def network_parameters(self) -> Parameters:
        """The part that the network's equations need."""
        return Parameters.model_validate(self.model_dump(include=set(Parameters.model_fields)))


def plan_configuration(layers: Iterable[Layer]) -> tuple[PlanConfig, dict[str, str]]:
    """Merge layers, of which later ones win; also the source of every value by its key.

    The channel's constants are those of the environment where no layer gives them.

    Raises:
        InputError: a key is unknown or a value does not fit.
    """
    given = list(layers)
    named = [
        layer.values["plan.environment"] for layer in given if "plan.environment" in layer.values
    ]
    first = []
    if named:
        if named[-1] not in ENVIRONMENTS:
            raise InputError(unknown("environment", str(named[-1]), ENVIRONMENTS))
        constants = zip(_ENVIRONMENT_KEYS, ENVIRONMENTS[named[-1]], strict=True)
        first = [Layer(f"environment {named[-1]}", dict(constants))]
    return merge_into(PlanConfig, [*first, *given])
