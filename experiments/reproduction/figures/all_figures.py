"""Every figure of a reproduction, as far as there are rows for it."""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.figures.convergence import Convergence, draw_convergence
from orchid_uav.experiments.reproduction.figures.drawn import DISTRIBUTION_WORDS, DrawnFigure
from orchid_uav.experiments.reproduction.figures.scaling import FAMILIES, Axis, draw_scaling
from orchid_uav.experiments.reproduction.figures.strategy import NAMES, draw_strategy
from orchid_uav.experiments.reproduction.needs import FIGURES
from orchid_uav.experiments.reproduction.rows import Row
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.experiments.reproduction.trainings import QUICK_SEEDS, SEEDS

TRAINED = (
    Convergence(
        "fig3_tcp",
        "Fig. 3: training, users in hotspots",
        ("orchid", "orchid-no-rf", "maddpg-pf", "maddpg-mmf", "static-pf", "static-mmf"),
    ),
    Convergence(
        "fig3_uniform",
        "Fig. 3: training, users spread evenly",
        ("orchid-uniform", "orchid-no-rf-uniform", "static-mmf-uniform"),
    ),
    Convergence(
        "fig7",
        "Fig. 7: training from random starts and from K-Means, users in hotspots",
        ("orchid", "orchid-random-init", "static-mmf", "static-pf"),
    ),
)
"""Fig. 3 and Fig. 7."""


def draw_figures(
    rows: Sequence[Row], folder: Path, wanted: Collection[str] = tuple(FIGURES)
) -> list[DrawnFigure]:
    """Draw all figures for which there are rows, in the order of the paper.

    Args:
        rows: of methods and rules, in any number.
        folder: for the SVG files; it is made if it is missing.
        wanted: the paper's figures that are drawn, such as "fig4".

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    seeds = len(QUICK_SEEDS if any(row.is_quick for row in rows) else SEEDS)
    drawn = [
        *(
            draw_convergence(one, rows, seeds, folder)
            for one in TRAINED
            if figure_of(one.key) in wanted
        ),
        *(draw_scaling(one, rows, seeds, folder) for one in axes() if figure_of(one.key) in wanted),
        *([draw_strategy(rows, seeds, folder)] if "fig8" in wanted else []),
    ]
    return sorted(
        (figure for figure in drawn if figure is not None), key=lambda one: figure_of(one.key)
    )


def drawn_methods(figure: str) -> list[str]:
    """All methods and rules of which one of the paper's figures, such as "fig4", shows rows."""
    if figure == "fig8":
        return [*NAMES]
    if figure in {figure_of(axis.key) for axis in axes()}:
        families = [label for family in FAMILIES.values() for label in family]
        return list(dict.fromkeys(label.removesuffix("-zero") for label in families))
    trained = [one.methods for one in TRAINED if figure_of(one.key) == figure]
    return list(dict.fromkeys(method for methods in trained for method in methods))


def figure_of(key: str) -> str:
    """The paper's figure, such as "fig4", that one of ours belongs to, such as "fig4_tcp"."""
    return key.partition("_")[0]


def axes() -> Iterator[Axis]:
    """Figures 4, 5 and 6, for both distributions of users."""
    for number, name, field, cases in (
        (4, "users", "users", settings.users),
        (5, "UAVs", "uavs", settings.uavs),
    ):
        for distribution, words in DISTRIBUTION_WORDS.items():
            yield Axis(
                f"fig{number}_{distribution}",
                f"Fig. {number}: number of {name}, {words}",
                name,
                f"{{:g}} {name}",
                _places(cases(distribution), field),
            )
    for distribution, words in DISTRIBUTION_WORDS.items():
        for hold_s in settings.HEADINGS_S:
            yield Axis(
                f"fig6_{distribution}_{hold_s:g}s",
                f"Fig. 6: speed of walking users, {words}, headings held {hold_s:g} s",
                "speed (m/s)",
                "{:g} m/s",
                _places(settings.speeds(distribution, hold_s), "speed_mps"),
            )


def _places(cases: Sequence[Case], field: str) -> dict[float, Case]:
    return {float(getattr(case.setting, field)): case for case in cases}
