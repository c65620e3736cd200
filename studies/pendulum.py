"""The example of docs/reset_and_finetune.md, recorded: ``python -m studies.pendulum``.

Stock PPO on Gymnasium's pendulum with Reset-and-Finetune and without, from the same seed.
"""

import argparse
from typing import Any

import torch
from examples.reset_any_model import Returns, train

from orchid_uav.callbacks import ResetAndFinetune
from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result

RESULT = RESULTS / "pendulum.json"
SETTINGS = {"window": 60, "tolerances": {"r": 0.1}, "kappa": 0.5}
"""As the example has them."""


def measure() -> dict[str, Any]:
    """Both trainings."""
    callback = ResetAndFinetune(**SETTINGS)
    with_reset, without = train(reset=callback), train()
    return {
        "reset_episodes": callback.reset_episodes,
        "with_reset": _rows(with_reset),
        "without": _rows(without),
    }


def _rows(seen: Returns) -> dict[str, list[float]]:
    return {"returns": seen.returns, "learning_rates": seen.learning_rates}


def main() -> None:
    """Train and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_recording_options(parser, RESULT)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    torch.set_num_threads(1)
    write_result(options.json, record(SETTINGS, **measure()), ('"with_reset"', '"without"'))
    print(f"wrote {options.json}")


if __name__ == "__main__":
    main()
