"""Gains of the rule ``forces``, searched by CMA-ES: ``python -m studies.forces``.

Half the topologies have users that stand still and half users that walk, none of which is used for
anything else. What is printed belongs into ``agents/controllers/forces.py``.
"""

import argparse
import warnings

import numpy as np
from cma import CMAEvolutionStrategy

from orchid_uav.agents.controllers.forces import Forces, Gains
from orchid_uav.envs import Parameters
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import STATIONS, Contender

SEED, TOPOLOGIES = 5, 40
SPEEDS_MPS = (0.0, 15.0)
BEGIN = Gains(0.05, 2.0, 4.0, 4.0, 200.0, 5.0)
SCALES = np.array([0.1, 8.0, 8.0, 16.0, 200.0, 5.0])


def utility(gains: Gains) -> float:
    """Mean over topologies and speeds."""
    contender = Contender("forces", "", STATIONS, lambda _: Forces(gains))
    settings = [Setting(speed_mps=speed, heading_hold_s=20.0) for speed in SPEEDS_MPS]
    flown, _ = evaluate(EvaluationPlan([contender], settings, TOPOLOGIES, SEED, Parameters()))
    return float(np.mean([metrics["utility"] for metrics in flown.values()]))


def main() -> None:
    """Search, and print the best gains."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--evaluations", type=int, default=200)
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = CMAEvolutionStrategy(
            np.array(BEGIN) / SCALES,
            0.3,
            {"bounds": [[0.0, -2.0, -2.0, 0.0, 0.1, 0.0], 3.0], "seed": SEED + 1, "verbose": -9},
        )
        while search.result.evaluations < options.evaluations:
            tried = search.ask()
            scores = [-utility(Gains(*(one * SCALES).tolist())) for one in tried]
            search.tell(tried, scores)
            best = Gains(*(search.result.xbest * SCALES).tolist())
            print(search.result.evaluations, -search.result.fbest, best, flush=True)


if __name__ == "__main__":
    main()
