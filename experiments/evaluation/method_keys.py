"""Keys and groups of methods, apart from the methods, which take a second to import."""

ALL, RULES, LEARNED = "all", "rules", "learned"
"""Groups of methods, for ``--methods``."""
ZERO = "-zero"
"""Suffix of the key of a learned policy's zero-action twin."""
SENSED = "-sensed"
"""Suffix of the key of a rule on stations that begins where Phase I sees the users."""

RELEASED = {
    "orchid": "MAPPO and Reset-and-Finetune: the paper's proposal",
    "orchid-no-rf": "MAPPO without Reset-and-Finetune",
    "orchid-pf": "proportional fairness in reward and shares, repeated resets",
    "orchid-random-init": "trained and flown from random starts",
    "orchid-informed": "the paper's method on stations, told what a UAV on board knows",
    "orchid-distilled": "imitates best response, and knows when it is told wrong or late",
    "orchid-tuned": "orchid with the best recipe of its search",
    "maddpg-pf": "Baseline 1: MADDPG, proportional fairness, best recipe of its search",
    "maddpg-mmf": "Baseline 2: MADDPG, max-min fairness, best recipe of its search",
    "maddpg-pf-paper": "maddpg-pf with the paper's numbers",
    "maddpg-mmf-paper": "maddpg-mmf with the paper's numbers",
}
"""The policies that come with the package, in ``orchid_uav.reference``."""

RULE_IDEAS = {
    "static-pf": "Baseline 3: hover at the K-Means centroids",
    "static-mmf": "hover at the centroids, max-min shares",
    "static-pf-full-power": "static-pf at full power",
    "static-mmf-full-power": "static-mmf at full power",
    "loiter-pf": "circle the centroids, equal shares",
    "loiter-mmf": "circle the centroids, max-min shares",
    "balanced-loiter": "circle the most balanced of 31 K-Means results",
    "track": "K-Means again every 10 s, then circle",
    "planner": "CMA-ES over positions and powers, then circle",
    "track-120": "track at 120 m",
    "balanced-loiter-120": "balanced-loiter at 120 m: the twin of policies on stations",
    "balanced-loiter-120-sensed": "the same, from where Phase I sees the users",
    "forces": "stations pulled by users and neighbours; six numbers",
    "forces-sensed": "the same, from where Phase I sees the users",
    "best-response": "each UAV improves its neighbourhood's utility",
    "best-response-sensed": "the same, from where Phase I sees the users",
    "receding-horizon": "all stations searched anew every 5 s, centrally",
    "receding-horizon-sensed": "the same, from where Phase I sees the users",
    "balanced-loiter-retargeted": "balanced-loiter that also chooses whom to serve; not in all",
    "planner-retargeted": "planner that also chooses whom to serve; not in all",
}
"""The methods that need no training."""


def known_methods() -> list[str]:
    """Keys that ``--methods`` accepts, besides the groups."""
    learned = [key + suffix for key in RELEASED for suffix in ("", ZERO)]
    return [*learned, *RULE_IDEAS]
