"""Read an evaluation with pandas: ``python examples/read_evaluation.py orchid-eval/TIME``.

The directory is one that ``orchid eval`` has written.
"""

import sys
from pathlib import Path

import pandas as pd

METRICS = ["utility", "energy_efficiency_bit_per_joule", "rate_jfi", "worst_rate_bps"]
SETTING = ["distribution", "uavs", "users", "speed_mps", "heading_hold_s"]
TOPOLOGY = [*SETTING, "seed", "deterministic"]

episodes = pd.read_parquet(Path(sys.argv[1]) / "episodes.parquet")

# A policy has the same method with and without sampled actions, hence "deterministic".
by_method = episodes.groupby([*SETTING, "method", "deterministic"])[METRICS]
print("Means over topologies", by_method.mean().to_string(), sep="\n", end="\n\n")
print("Standard deviations", by_method.std().to_string(), sep="\n", end="\n\n")  # ddof = 1

# All methods fly the same topologies, so they can be compared pair by pair.
utility = episodes.pivot(index=TOPOLOGY, columns="method", values="utility")
for method in utility.columns:
    twin = f"{method}-zero"
    if twin in utility:
        gain = (utility[method] - utility[twin]).dropna()
        print(
            f"{method} - {twin}: {gain.mean():+.4f} in utility, "
            f"better on {(gain > 0).mean():.0%} of {len(gain)} topologies"
        )
