"""The result of ``studies/pendulum.py``, for docs/reset_and_finetune.md."""

from pathlib import Path

from orchid_uav.experiments.statistics.curves import smoothed
from studies.pages.markdown import FIGURES, ROOT, recorded
from studies.recording import read

NAME = "pendulum"
PICTURE = FIGURES / f"{NAME}.png"
_TRAILING = 20
_LAST = 100


def pendulum_block() -> str:
    """The figure, and what it shows."""
    document = read(NAME)
    means = {
        name: sum(document[name]["returns"][-_LAST:]) / _LAST for name in ("with_reset", "without")
    }
    episodes = ", ".join(map(str, document["reset_episodes"]))
    return (
        f"![Returns of PPO on the pendulum, and its learning rate](figures/{PICTURE.name})\n\n"
        f"Trailing means of {_TRAILING} episodes. The plateau was seen after episode {episodes}; "
        f"until then\nboth trainings are the same. Mean return of the last {_LAST} episodes: "
        f"{means['with_reset']:.0f} with the reset,\n{means['without']:.0f} without. One seed: "
        "this shows what the callback does, not whether it helps.\n\n"
        f"{recorded(document)}, `{document['command']}` → `studies/results/{NAME}.json`."
    )


def draw_pendulum() -> Path:
    """Returns and learning rates of both trainings over their episodes."""
    from matplotlib import style
    from matplotlib.figure import Figure

    from orchid_uav.experiments.figures.style import PAGE_IN, STYLE, line_styles

    document = read(NAME)
    looks = line_styles(["base", "no-rf"])
    labels = {"with_reset": ("base", "with Reset-and-Finetune"), "without": ("no-rf", "without")}
    with style.context(["default", STYLE]):
        figure = Figure((PAGE_IN, 3.6), layout="constrained")
        figure.suptitle("PPO of Stable-Baselines3 on Pendulum-v1")
        returns, rates = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        for turn, (name, (look, label)) in enumerate(labels.items()):
            rows = document[name]
            episodes = range(1, len(rows["returns"]) + 1)
            drawn = {**looks[look], "markevery": (20 * turn, 40)}
            returns.plot(episodes, smoothed(rows["returns"], _TRAILING), label=label, **drawn)
            rates.plot(episodes, rows["learning_rates"], **drawn)
        for axes in (returns, rates):
            for episode in document["reset_episodes"]:
                axes.axvline(episode, color="black", lw=0.8, ls=":")
        returns.set_ylabel("return")
        returns.legend(loc="lower right")
        rates.set_ylabel("learning rate")
        rates.set_ylim(0.0, 1.15 * max(document["without"]["learning_rates"]))
        rates.set_xlabel("training episode (dotted: plateau seen)")
        figure.savefig(PICTURE)
    return PICTURE


PENDULUM_BLOCKS = {"pendulum": (ROOT / "docs" / "reset_and_finetune.md", pendulum_block)}
