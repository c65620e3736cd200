"""One flight for the picture of a deployment: ``python -m studies.deployment``.

It is the first topology that every evaluation flies, half-way through the episode, with drones
that circle the places where Phase I put them (``loiter-mmf``).
"""

import argparse
from typing import Any

from orchid_uav.agents.controllers.heuristics import Loiter
from orchid_uav.envs import evaluation_seeds, parallel_env
from orchid_uav.experiments.provenance import describe_versions
from studies.recording import RESULTS, add_recording_options, require_commit, write_result

RESULT = RESULTS / "deployment.json"


def fly() -> dict[str, Any]:
    """Positions half-way through the episode, who serves whom, and at which rate."""
    env = parallel_env(uavs=6, users=100, distribution="tcp", objective="mmf")
    seed = evaluation_seeds(0, 1)[0]
    env.reset(seed=seed)
    method = Loiter()
    method.begin(env.world)
    for _ in range(env.parameters.network.episode_slots // 2):
        env.step(dict(zip(env.agents, method.act(env.world)[0], strict=True)))
    seen = env.snapshot()
    return {
        "seed": seed,
        "slot": seen["slot"],
        "area_m": env.parameters.network.area_m,
        "gbs_position_m": seen["gbs_position_m"].tolist(),
        "circle_radius_m": method.circle_m,
        "uavs": [
            {"position_m": position_m.tolist(), "centre_m": centre_m.tolist()}
            for position_m, centre_m in zip(
                seen["uav_positions_m"], method.centres_m[0], strict=True
            )
        ],
        "users": [
            {
                "position_m": position_m.tolist(),
                "is_target": bool(is_target),
                "uav": int(uav),
                "rate_bps": float(rate_bps),
            }
            for position_m, is_target, uav, rate_bps in zip(
                *(seen[name] for name in ("users_m", "target_users", "association", "rates_bps")),
                strict=True,
            )
        ],
    }


def main() -> None:
    """Fly the episode and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_recording_options(parser, RESULT)
    options = parser.parse_args()
    path = options.json
    require_commit(parser, options, path)
    write_result(path, {"schema": 1, "versions": describe_versions(), **fly()}, ('{"position_m"',))
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
