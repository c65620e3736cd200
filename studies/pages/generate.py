"""Write all generated parts of the documentation: ``python -m studies.pages.generate``.

Numbers come from the committed JSON files under ``studies/results`` and
``runs/reference``, and from the configuration's own classes. ``tests/studies/test_pages.py`` fails
if a page differs from what this script makes of them.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from orchid_uav.envs.keys import FORMER_KEYS, fields_by_key, unit_of, values_of
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.planning.settings import PlanConfig
from orchid_uav.experiments.presets import PRESETS
from studies.flight import draw_flight
from studies.pages.ablation import ABLATION_BLOCKS, draw_ablations
from studies.pages.batches import BATCHES_BLOCKS
from studies.pages.claims import CLAIMS_BLOCKS
from studies.pages.dependencies import DEPENDENCY_BLOCKS
from studies.pages.deployment import draw_deployment
from studies.pages.evaluation import EVALUATION_BLOCKS, draw_studies
from studies.pages.figure_sources import record_sources
from studies.pages.findings import FINDING_BLOCKS
from studies.pages.flying import FLYING_BLOCKS, draw_flying
from studies.pages.headline import HEADLINE_BLOCKS
from studies.pages.pendulum import PENDULUM_BLOCKS, draw_pendulum
from studies.pages.performance import render as performance_page
from studies.pages.planning import PLANNING_BLOCKS
from studies.pages.results import RESULTS_BLOCKS
from studies.pages.results_details import RESULTS_DETAILS_BLOCKS
from studies.pages.results_figures import RESULTS_FIGURES_BLOCKS, draw_reproduction
from studies.pages.results_words import RESULTS_WORDS_BLOCKS
from studies.pages.torture import TORTURE_BLOCKS
from studies.pages.torture_fuzz import TORTURE_FUZZ_BLOCKS, draw_fleets
from studies.pages.validation import VALIDATION_BLOCKS, draw_validation

ROOT = Path(__file__).parents[2]
BEGIN, END = "<!-- begin generated: {} -->", "<!-- end generated: {} -->"


def configuration_page() -> str:
    """docs/configuration.md."""
    lines = [
        "# Configuration",
        "",
        "Every key with its default, unit, range and meaning; the defaults are the paper's (preset",
        "`paper`). M1 … M45 are the [decisions](model.md#decisions) on what the paper leaves open.",
        "Ranges include both ends; `3 × 0..10` are three numbers, each within 0..10. They are wide",
        "on purpose: a run with any values within them is flown with finite numbers.",
        "",
        "Set them in a TOML or JSON file (`--config lab.toml`), or singly (`--set",
        "network.user_count=50`, `--set uav.displacement_scale_m=15,15,5`). `--config` reads pipes",
        "too, as in `--config /dev/stdin` or `--config <(make-my-configuration)`: JSON if it",
        "begins with a brace, else TOML. `orchid config show` prints the merged configuration with",
        "the ranges, and with `--changed` only what differs from the preset.",
        "",
        "This page is made from the code by `make docs-data`.",
        "",
        "## Presets",
        "",
        "What a configuration begins with: `orchid train --preset quick`.",
        "",
        "| preset | what it is for | what differs from the paper |",
        "|---|---|---|",
        *(
            f"| `{name}` | {preset.idea} | {_changes(preset.sections)} |"
            for name, preset in PRESETS.items()
        ),
    ]
    plan = {"plan": PlanConfig.model_fields["plan"]}
    for section, info in {**RunConfig.model_fields, **plan}.items():
        model = type(info.default)
        lines += ["", f"## {section}", "", (model.__doc__ or "").strip(), ""]
        lines += ["| key | default | unit | values | meaning |", "|---|---|---|---|---|"]
        for key, field in fields_by_key(model).items():
            lines.append(
                f"| `{section}.{key}` | {_default(field.default)} | {unit_of(key)} "
                f"| {values_of(field, quote='`')} | {field.description} |"
            )
    lines += ["", "## Former names", "", "Files and commands of earlier versions are still read."]
    lines += ["", "| then | now |", "|---|---|"]
    lines += [f"| `{former}` | `{key}` |" for former, key in FORMER_KEYS.items()]
    return "\n".join(lines) + "\n"


def _changes(sections: Mapping[str, Mapping[str, Any]]) -> str:
    changes = [
        f"`{section}.{field} = {_default(value)}`"
        for section, fields in sections.items()
        for field, value in fields.items()
    ]
    return ", ".join(changes) or "nothing"


def _default(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_default, value))
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, bool):
        return str(value).lower()
    return "none" if value is None else str(value)


def replace_block(text: str, name: str, content: str) -> str:
    """``text`` with new content between the markers of that name."""
    begin, end = BEGIN.format(name), END.format(name)
    if begin not in text or end not in text:
        raise ValueError(f"no markers for '{name}'")
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n{content}\n{end}{after}"


_WHOLE: Mapping[Path, Callable[[], str]] = {
    ROOT / "docs" / "configuration.md": configuration_page,
    ROOT / "docs" / "performance.md": performance_page,
}
_BLOCKS: Mapping[str, tuple[Path, Callable[[], str]]] = {
    **EVALUATION_BLOCKS,
    **ABLATION_BLOCKS,
    **VALIDATION_BLOCKS,
    **FINDING_BLOCKS,
    **HEADLINE_BLOCKS,
    **PENDULUM_BLOCKS,
    **BATCHES_BLOCKS,
    **FLYING_BLOCKS,
    **PLANNING_BLOCKS,
    **CLAIMS_BLOCKS,
    **RESULTS_BLOCKS,
    **RESULTS_WORDS_BLOCKS,
    **RESULTS_DETAILS_BLOCKS,
    **RESULTS_FIGURES_BLOCKS,
    **TORTURE_BLOCKS,
    **TORTURE_FUZZ_BLOCKS,
    **DEPENDENCY_BLOCKS,
}
PAGES: Sequence[Path] = (*_WHOLE, *dict.fromkeys(path for path, _ in _BLOCKS.values()))
"""Every page that is generated, or has generated parts."""


def page(path: Path) -> str:
    """What one of :data:`PAGES` should say."""
    if path in _WHOLE:
        return _WHOLE[path]()
    text = path.read_text(encoding="utf-8")
    for name, (where, content) in _BLOCKS.items():
        if where == path:
            text = replace_block(text, name, content())
    return text


def main() -> None:
    """Write all pages and figures."""
    drawn = [
        draw_deployment(),
        *draw_studies(),
        *draw_ablations(),
        *draw_validation(),
        draw_pendulum(),
        draw_flying(),
        draw_fleets(),
        draw_flight(),
        *draw_reproduction(),
    ]
    for path in [*drawn, record_sources()]:
        print(f"wrote {path.relative_to(ROOT)}")
    for path in PAGES:
        path.write_text(page(path), encoding="utf-8")
        print(f"wrote {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
