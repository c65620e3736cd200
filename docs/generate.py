"""Everything in the documentation that is not prose: ``python -m docs.generate``.

Numbers come from the committed JSON files under ``benchmarks/results`` and from the configuration's
own classes. ``tests/test_docs.py`` fails when a page is not what this script makes of them.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from orchid_uav.experiments.configuration import RunConfig, unit_of

ROOT = Path(__file__).parent.parent
RUN = ROOT / "benchmarks" / "results" / "reference_run.json"
FIGURE = ROOT / "docs" / "figures" / "reference_run.png"
BEGIN, END = "<!-- begin generated: {} -->", "<!-- end generated: {} -->"

CURVES = (
    ("reward", "reward per episode", 1.0),
    ("energy_efficiency_bit_per_joule", "energy efficiency in Mbit/J", 1e-6),
    ("rate_jfi", "rate JFI", 1.0),
    ("load_jfi", "load JFI", 1.0),
)
FLIGHT_COLUMNS = (
    ("coverage", "coverage", 1.0, 3),
    ("energy_efficiency_bit_per_joule", "EE, Mbit/J", 1e-6, 3),
    ("rate_jfi", "rate JFI", 1.0, 3),
    ("load_jfi", "load JFI", 1.0, 3),
    ("worst_rate_bps", "worst user, Mbit/s", 1e-6, 2),
    ("propulsion_power_w", "propulsion, W", 1.0, 0),
)


def configuration_page() -> str:
    """docs/configuration.md."""
    lines = [
        "# Configuration",
        "",
        "Every key with its default, unit, range and meaning; the defaults are the paper's (preset",
        "`paper`). M1 … M33 are the [decisions](model.md#decisions) on what the paper leaves open.",
        "Set them in a TOML or JSON file (`--config`), or singly (`--set network.user_count=50`).",
        "This page is made from the code by `make docs-data`.",
    ]
    for section, info in RunConfig.model_fields.items():
        model = type(info.default)
        lines += ["", f"## {section}", "", (model.__doc__ or "").strip(), ""]
        lines += ["| key | default | unit | values | meaning |", "|---|---|---|---|---|"]
        for field, description in model.model_fields.items():
            lines.append(
                f"| `{section}.{field}` | {_default(description.default)} | {unit_of(field)} "
                f"| {_values(description)} | {description.description} |"
            )
    return "\n".join(lines) + "\n"


def _default(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_default, value))
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, bool):
        return str(value).lower()
    return "none" if value is None else str(value)


def _values(field: FieldInfo) -> str:
    bounds = [*field.metadata, *_nested_bounds(field.annotation)]
    words = {Gt: "> {}", Ge: "≥ {}", Lt: "< {}", Le: "≤ {}"}
    texts = [
        words[type(bound)].format(getattr(bound, type(bound).__name__.lower()))
        for bound in bounds
        if type(bound) in words
    ]
    choices = [choice for choice in _choices(field.annotation) if isinstance(choice, str)]
    return ", ".join(dict.fromkeys(f"`{choice}`" for choice in choices) or dict.fromkeys(texts))


def _nested_bounds(annotation: Any) -> list[Any]:
    found = list(getattr(annotation, "__metadata__", ()))
    found = [bound for item in found for bound in (getattr(item, "metadata", None) or [item])]
    for argument in get_args(annotation):
        found += _nested_bounds(argument)
    return found


def _choices(annotation: Any) -> list[Any]:
    arguments = get_args(annotation)
    return [leaf for argument in arguments for leaf in (_choices(argument) or [argument])]


def readme_results(data: Mapping[str, Any]) -> str:
    """The block of README.md about the paper's run."""
    run, flights = data["run"], data["flights"]
    final = run["final"]
    resets = ", ".join(map(str, run["reset_episodes"])) or "none"
    lines = [
        "![Learning curves of the paper's run](docs/figures/reference_run.png)",
        "",
        f"The paper's run, `{' '.join(run['command'])}`: 700 episodes in {run['seconds']:.0f} s on "
        f"one core ({run['host']['processor']}), Reset-and-Finetune at episode {resets}.",
        f"Means of the last 50 training episodes: reward {final['reward']:.1f}, energy efficiency "
        f"{final['energy_efficiency_bit_per_joule'] / 1e6:.3f} Mbit/J, rate JFI "
        f"{final['rate_jfi']:.3f}, load JFI {final['load_jfi']:.3f}.",
        "",
        f"The policy on {data['topologies']} unseen topologies (mean ± standard deviation over "
        "topologies), beside its",
        "zero-action twin and the simplest rule there is:",
        "",
        "| who flies | " + " | ".join(title for _, title, _, _ in FLIGHT_COLUMNS) + " |",
        "|---|" + "---|" * len(FLIGHT_COLUMNS),
    ]
    for name, figures in flights.items():
        cells = [
            f"{figures[key]['mean'] * scale:.{digits}f} ± {figures[key]['std'] * scale:.{digits}f}"
            for key, _, scale, digits in FLIGHT_COLUMNS
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    lines += [
        "",
        f"One training seed, {data['date']}, from [benchmarks/results/reference_run.json]"
        "(benchmarks/results/reference_run.json), made by "
        + " and ".join(f"`{command}`" for command in data["command"])
        + ".",
    ]
    return "\n".join(lines)


def replace_block(text: str, name: str, content: str) -> str:
    """``text`` with what stands between the markers of that name replaced."""
    begin, end = BEGIN.format(name), END.format(name)
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n{content}\n{end}{after}"


def draw_run(data: Mapping[str, Any], path: Path) -> None:
    """Learning curves: every episode, and the mean of the last 50."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    episodes = data["episodes"]
    figure, axes = plt.subplots(2, 2, figsize=(9, 5.2), sharex=True, layout="constrained")
    for axis, (key, title, scale) in zip(axes.flat, CURVES, strict=True):
        values = [value * scale for value in episodes[key]]
        means = [
            sum(values[max(0, end - 50) : end]) / min(end, 50) for end in range(1, len(values) + 1)
        ]
        axis.plot(episodes["episode"], values, color="0.8", linewidth=0.6, label="episode")
        axis.plot(episodes["episode"], means, color="#0072B2", label="mean of the last 50")
        for reset in data["run"]["reset_episodes"]:
            axis.axvline(reset, color="#D55E00", linestyle="--", label="Reset-and-Finetune")
        axis.set_title(title, fontsize=10)
        axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("training episode")
    axes[0, 0].legend(fontsize=8, loc="upper right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def pages() -> dict[Path, str]:
    """Every generated text by its file."""
    from benchmarks.render import render

    readme = ROOT / "README.md"
    data = json.loads(RUN.read_text())
    return {
        ROOT / "docs" / "configuration.md": configuration_page(),
        ROOT / "docs" / "performance.md": render(),
        readme: replace_block(readme.read_text(), "reference run", readme_results(data)),
    }


def main() -> None:
    """Write all pages and the figure."""
    for path, text in pages().items():
        path.write_text(text)
        print(f"wrote {path.relative_to(ROOT)}")
    draw_run(json.loads(RUN.read_text()), FIGURE)
    print(f"wrote {FIGURE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
