"""The paper's claims, in our own short words; ``docs/claims.md`` says how they are decided."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.reproduction import checks, question_checks
from orchid_uav.experiments.reproduction.verdicts import Check


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, or a question that it leaves open."""

    key: str
    says: str
    """In our own words, short."""
    where: str
    """Section or figure of the paper."""
    figure: str
    """Our figure that shows it; empty if none does."""
    checks: Callable[[Distribution], Iterable[Check]]
    """The comparisons that decide it, for one distribution of users."""
    by_distribution: bool = False
    """Whether it is judged for uniform users as well; the verdict is that of TCP."""
    note: str = ""
    """What has to be known to read the verdict."""


_NOT_DISCRIMINATING = "Tells nothing apart: a fleet that does nothing covers as much."
_RELATIVE = "Relative to the mean, where the paper draws standard deviations."
_SLIGHTLY = "A difference within the margin counts as no, though the paper says slightly."
_TUNED = "MADDPG has the recipe of its search here, and ORCHID the paper's numbers."
_ALIKE = f"{_TUNED} Q7 and Q8 compare like with like."
_THREE_RESETS = "Both with up to three resets."
_NO_SEEDS = "Hovering has no training seed: there the unit is the topology."

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "c1",
        "Hovering at the centroids has the highest training reward and the highest "
        "fairness of rates and loads.",
        "VI-C, Fig. 3",
        "fig3",
        checks.c1,
        note="Rewards are compared within one objective alone, on the very topologies of the "
        "training and at its progress τ.",
    ),
    Claim(
        "c2",
        "ORCHID's energy efficiency is competitive with hovering's.",
        "VI-C, Fig. 3",
        "fig3",
        checks.c2,
        note="In training, noise moves the UAVs, and flying takes less power than hovering. The "
        "paper's figure is of training; the comparison without noise is ours.",
    ),
    Claim(
        "c3",
        "MAPPO learns more steadily than MADDPG in the early episodes.",
        "VI-C, Fig. 3",
        "fig3",
        checks.c3,
        note="Beside MADDPG with max-min shares, tuned and with the paper's numbers, which ORCHID "
        "has; the other baseline's rewards measure something else.",
    ),
    Claim(
        "c4",
        "Without Reset-and-Finetune, energy efficiency and load fairness fall after "
        "some 200 episodes; with it they do not, and end higher.",
        "VI-C, Fig. 3",
        "fig3",
        checks.c4,
    ),
    Claim(
        "c5",
        "Coverage stays near 1 for 50 to 200 users.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c5,
        by_distribution=True,
        note=_NOT_DISCRIMINATING,
    ),
    Claim(
        "c6",
        "Energy efficiency grows with the number of users.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c6,
        by_distribution=True,
        note="By the paper's own formula for rates the users of a UAV share its band: with more of "
        "them the shares are smaller, and the UAV's sum is no greater.",
    ),
    Claim(
        "c7",
        "MADDPG with max-min shares has a higher energy efficiency than with proportional ones.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c7,
        by_distribution=True,
    ),
    Claim(
        "c8",
        "Hovering has the lowest energy efficiency.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c8,
        by_distribution=True,
    ),
    Claim(
        "c9",
        "Of the methods that move, ORCHID's energy efficiency spreads least.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c9,
        by_distribution=True,
        note=f"{_RELATIVE} {_ALIKE}",
    ),
    Claim(
        "c10",
        "ORCHID is fairer than both MADDPG baselines.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c10,
        by_distribution=True,
        note=_ALIKE,
    ),
    Claim(
        "c11",
        "For 4 to 10 UAVs, too, MADDPG has the higher energy efficiency with max-min shares, and "
        "hovering the lowest.",
        "VI-D2, Fig. 5",
        "fig5",
        checks.c11,
        by_distribution=True,
        note="The paper says the first of numbers of UAVs, the second of numbers of users alone.",
    ),
    Claim(
        "c12",
        "ORCHID's energy efficiency spreads least for 4 to 10 UAVs.",
        "VI-D2, Fig. 5",
        "fig5",
        checks.c12,
        by_distribution=True,
        note=f"{_RELATIVE} {_TUNED}",
    ),
    Claim(
        "c13",
        "ORCHID is fairer than both MADDPG baselines for 4 to 10 UAVs.",
        "VI-D2, Fig. 5",
        "fig5",
        checks.c13,
        by_distribution=True,
        note=_TUNED,
    ),
    Claim(
        "c14",
        "Coverage stays 1 with users of up to 15 m/s.",
        "VI-E, Fig. 6",
        "fig6",
        checks.c14,
        by_distribution=True,
        note=_NOT_DISCRIMINATING,
    ),
    Claim(
        "c15",
        "Hovering's fairness falls and spreads as users walk faster; ORCHID's does not.",
        "VI-E, Fig. 6",
        "fig6",
        checks.c15,
        by_distribution=True,
        note=_NO_SEEDS,
    ),
    Claim(
        "c16",
        "From random starts the reward is higher, energy efficiency and load fairness "
        "are lower, and both spread more.",
        "VI-F, Fig. 7",
        "fig7",
        checks.c16,
    ),
    Claim(
        "c17",
        "Over 1,000 episodes max-min and proportional shares reach comparable mean "
        "fairness of rates.",
        "VI-G, Fig. 8",
        "fig8",
        checks.c17,
        note=_THREE_RESETS,
    ),
    Claim(
        "c18",
        "Max-min shares give the higher energy efficiency.",
        "VI-G, Fig. 8",
        "fig8",
        checks.c18,
        note=_THREE_RESETS,
    ),
    Claim(
        "c19",
        "Max-min shares raise the floor under the worst user's rate.",
        "VI-G, Fig. 8",
        "fig8",
        checks.c19,
        note=f"{_THREE_RESETS} Shares alone do it: hovering's floor rises with them as well.",
    ),
    Claim(
        "c20",
        "Training drives the association towards a stable one: fewer blocking pairs.",
        "V-B, Theorem 1",
        "",
        checks.c20,
        by_distribution=True,
        note="A blocking pair is a user and a UAV that would both gain if the user changed over. "
        "The paper's definition also asks that nobody else loses, and then nearly every "
        "association is stable; here the usual one counts, beside the twin, which was not trained.",
    ),
    Claim(
        "c21",
        "Max-min shares spread the UAVs more than proportional ones.",
        "VI-G",
        "fig8",
        checks.c21,
        note="The paper's central thesis, measured as the distance to the nearest other UAV.",
    ),
    Claim(
        "c22",
        "With proportional shares users in hotspots sit at a higher SNR.",
        "VI-G, Remark 3",
        "fig8",
        checks.c22,
        note="Measured as the mean over all users that UAVs serve.",
    ),
    Claim(
        "c23",
        "MADDPG's mean energy efficiency is slightly above ORCHID's.",
        "VI-D, VI-E",
        "fig4",
        checks.c23,
        by_distribution=True,
        note=f"VI-E says it of means, VI-D of peaks. {_SLIGHTLY} {_TUNED}",
    ),
    Claim(
        "c24",
        "Hovering's energy efficiency falls as users walk faster.",
        "VI-E, Fig. 6",
        "fig6",
        checks.c24,
        by_distribution=True,
        note=_NO_SEEDS,
    ),
    Claim(
        "c25",
        "Over 4 to 10 UAVs hovering is the fairest in the mean, and spreads most.",
        "VI-D2, Fig. 5",
        "fig5",
        checks.c25,
        by_distribution=True,
    ),
    Claim(
        "c26",
        "The fairness of MADDPG with max-min shares spreads slightly less than ORCHID's.",
        "VI-D1, Fig. 4",
        "fig4",
        checks.c26,
        by_distribution=True,
        note=f"{_SLIGHTLY} {_TUNED}",
    ),
    Claim(
        "c27",
        "Scaling learning rates by κ scales the variance of updates by about κ².",
        "IV-D",
        "",
        checks.c27,
        note="The first comparison lowers the rates alone; the others also clear the optimizer.",
    ),
    Claim(
        "c28",
        "Phase II mitigates errors of localisation in Phase I.",
        "IV-B",
        "",
        checks.c28,
        by_distribution=True,
        note="The twin starts at the same wrong places and stays there. The policy is below it "
        "without any error, too (Q1): what an error costs each of them is told by *loses less*.",
    ),
    Claim(
        "c29",
        "Proportional shares congest the backhaul.",
        "VI-G",
        "",
        checks.c29,
        note="Nothing in the model limits what a backhaul carries.",
    ),
    Claim(
        "c30",
        "Where users walk fast, ORCHID is as fair as hovering, or fairer.",
        "VI-E, Fig. 6",
        "fig6",
        checks.c30,
        by_distribution=True,
        note="Beside hovering with either rule of sharing.",
    ),
    Claim(
        "c31",
        "Where users walk, too, ORCHID's energy efficiency spreads less than MADDPG's.",
        "VI-E, Fig. 6",
        "fig6",
        checks.c31,
        by_distribution=True,
        note=f"{_RELATIVE} {_TUNED}",
    ),
)
"""The paper's, in its order."""

QUESTIONS: tuple[Claim, ...] = (
    Claim(
        "q1",
        "The trained policy of the paper is better than doing nothing.",
        "not asked",
        "",
        question_checks.q1,
        by_distribution=True,
    ),
    Claim(
        "q2",
        "Reset-and-Finetune makes the paper's policy better.",
        "IV-D",
        "",
        question_checks.q2,
    ),
    Claim(
        "q3",
        "What Reset-and-Finetune gains, none of its controls gains.",
        "not asked",
        "",
        question_checks.q3,
        note="Clearing the optimizer alone; lowering the rates alone; both at a random time; "
        "a linear decay to the same rates.",
    ),
    Claim(
        "q4",
        "Where learning moves something, the trained policy is better than doing nothing.",
        "not asked",
        "fig6",
        question_checks.q4,
        note="On stations, among users that walk.",
    ),
    Claim(
        "q5",
        "Where learning moves something, Reset-and-Finetune makes the policy better.",
        "IV-D",
        "",
        question_checks.q5,
    ),
    Claim(
        "q6",
        "There, none of its controls gains what it gains.",
        "not asked",
        "",
        question_checks.q6,
    ),
    Claim(
        "q7",
        "With the paper's numbers on both sides, ORCHID is fairer than MADDPG, and its energy "
        "efficiency spreads less.",
        "VI-D1",
        "fig4",
        question_checks.q7,
        note=f"C9 and C10 beside an untuned baseline. {_RELATIVE}",
    ),
    Claim(
        "q8",
        "With the recipes of searches of equal effort, ORCHID is fairer than MADDPG, and its "
        "energy efficiency spreads less.",
        "not asked",
        "fig4",
        question_checks.q8,
        note=f"C9 and C10 with orchid-tuned. {_RELATIVE}",
    ),
)
"""What the paper does not ask, or not where an answer can be had, by the same rules."""
