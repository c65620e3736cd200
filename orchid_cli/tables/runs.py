"""Tables of runs on a terminal, tab-separated lines elsewhere."""

import shlex
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.console import Console

from orchid_uav.cli.console import (
    GAP,
    console,
    least_width,
    plain,
    print_line,
    print_note,
    print_table,
)

if TYPE_CHECKING:
    from orchid_uav.experiments.runs.index import Run
    from orchid_uav.experiments.runs.removal import Removal

LIST_COLUMNS = (
    "status",
    "training.algorithm",
    "training.seed",
    "episodes",
    "reward",
    "rate_jfi",
    "energy_efficiency_bit_per_joule",
    "load_jfi",
    "worst_rate_bps",
)
"""Columns of the list after the id."""
_GIVING_WAY = (
    "worst_rate_bps",
    "training.seed",  # it is also part of the id
    "load_jfi",
    "training.algorithm",
    "energy_efficiency_bit_per_joule",
)
"""Columns that are left out, in this order, on a terminal that is too narrow."""
_LEAST_ID = 32
"""Least terminal width kept for ids; longer ids are broken where necessary."""
SHOWN_ON_TERMINAL = 50
"""Runs that a list shows on a terminal unless --limit is given."""
_WRAPPED = ("host", "versions", "resumed", "resets", "checkpoints")
_MOST_COMMANDS = 5
_LEAST_PLOT_WIDTH, _MOST_PLOT_WIDTH = 40, 100


def print_runs(out: Console, runs: Sequence["Run"], columns: Sequence[str]) -> None:
    """Print one row per run; on a terminal, long ids are broken over several lines."""
    rows = [[*map(plain, (one, *_cells(run, columns)))] for one, run in _named(out, runs)]
    if out.is_terminal:
        room = max(out.width - sum(_least_widths(runs, columns)), _LEAST_ID)
        for row in rows:
            row[0] = "\n".join(textwrap.wrap(row[0], room, drop_whitespace=False))
    print_table(out, ["id", *map(plain, _headings(columns))], rows, wraps_last=True)


def _named(out: Console, runs: Sequence["Run"]) -> list[tuple[str, "Run"]]:
    """Runs and their names in a list: short names for people, full ids for programs."""
    from orchid_uav.experiments.runs.index import short_names

    names = short_names(runs) if out.is_terminal else [run.id for run in runs]
    return list(zip(names, runs, strict=True))


def columns_that_fit(out: Console, runs: Sequence["Run"]) -> list[str]:
    """The columns of ``LIST_COLUMNS`` that a terminal has room for; all of them elsewhere."""
    columns = list(LIST_COLUMNS)
    if not out.is_terminal:
        return columns
    widths = dict(zip(columns, _least_widths(runs, columns), strict=True))
    room = out.width - min(max(len(name) for name, _ in _named(out, runs)), _LEAST_ID)
    for key in _GIVING_WAY:
        if sum(widths[column] for column in columns) > room:
            columns.remove(key)
    return columns


def _least_widths(runs: Sequence["Run"], columns: Sequence[str]) -> list[int]:
    """The least width of each column on a terminal, with the gap before it."""
    table = [_headings(columns), *(_cells(run, columns) for run in runs)]
    return [GAP + least_width(column) for column in zip(*table, strict=True)]


def _headings(columns: Sequence[str]) -> list[str]:
    """Titles of metrics, and keys without their section where that is unambiguous."""
    from orchid_uav.experiments.metrics import heading_of

    fields = [key.rpartition(".")[2] for key in columns]
    return [
        field if "." in key and fields.count(field) == 1 else heading_of(key)
        for key, field in zip(columns, fields, strict=True)
    ]


def _cells(run: "Run", columns: Iterable[str]) -> list[str]:
    from orchid_uav.experiments.runs.index import value_text

    return [
        f"{run.values[key]}/{run.planned_episodes}"
        if key == "episodes"
        else value_text(run.values.get(key), key)
        for key in columns
    ]


def print_resume_commands(out: Console, runs: Sequence["Run"]) -> bool:
    """Print how to continue the runs that died, and return whether there are any.

    If the output is not a terminal, these lines go to stderr, since a program may read the table.
    """
    died = [run for run in runs if run.status == "died"]
    shown = out if out.is_terminal else console(stderr=True)
    for run in died[:_MOST_COMMANDS]:
        print_line(shown, plain(f"died; continue with: {run.resume}"))
    if len(died) > _MOST_COMMANDS:
        rest = len(died) - _MOST_COMMANDS
        print_line(shown, f"{rest} more died: list them with --where status=died --json")
    return bool(died)


def print_run(out: Console, run: "Run") -> None:
    """Print everything that is known about a run."""
    from orchid_uav.experiments.runs.directory import FINAL_EPISODES
    from orchid_uav.experiments.runs.index import changed, checkpoints_of, value_text
    from orchid_uav.experiments.runs.records import CONFIG_FILE

    record = run.record
    host, versions = record.host, record.versions
    facts = {
        "run": run.id,
        "directory": str(run.path),
        "recorded as": record.id if record.id != run.id else None,
        "formerly": ", ".join(record.former_ids),
        "status": run.status,
        "error": record.error,
        "continue with": run.resume,
        "episodes": f"{record.episodes} of {run.planned_episodes}",
        "resets": _resets(run),
        "started": _time(record.started),
        "finished": _time(record.finished),
        "learning took": f"{record.seconds:.1f} s" if record.seconds else None,
        "resumed": ", ".join(_time(one.time) for one in record.resumed),
        "checkpoints": ", ".join(map(str, checkpoints_of(run))) or "none",
        "command": shlex.join(record.command),
        "host": ", ".join(f"{key} {value_text(value)}" for key, value in host.items()),
        "versions": ", ".join(f"{key} {value_text(value)}" for key, value in versions.items()),
    }
    _print_facts(out, {name: text for name, text in facts.items() if text})
    differing = changed(run)
    print_line(out, "")
    if differing:
        rows = [
            [key, value_text(value), value_text(default)]
            for key, (value, default) in differing.items()
        ]
        _print(out, [f"{CONFIG_FILE}, where it differs", "value", "default"], rows)
    else:
        print_line(out, f"{CONFIG_FILE}: all defaults")
    print_line(out, "")
    _print_metrics(out, [run], [f"mean of last {min(FINAL_EPISODES, record.episodes)}"])


def _print_facts(out: Console, facts: dict[str, str]) -> None:
    """Print names and texts. Lists are wrapped on a terminal; what may be copied is not."""
    indent = max(map(len, facts)) + 2
    for name, text in facts.items():
        if not out.is_terminal:
            print(name, plain(text), sep="\t", file=out.file)  # Rich turns tabs into spaces
            continue
        room = out.width - indent if name in _WRAPPED else len(text) + 1
        wrapped = textwrap.wrap(plain(text), max(room, 20), break_on_hyphens=False)
        print_line(out, f"{name:<{indent}}" + f"\n{'':{indent}}".join(wrapped))


def _resets(run: "Run") -> str:
    if not run.config.get("reset.enabled"):
        return "Reset-and-Finetune is off"
    episodes = ", ".join(map(str, run.record.reset_episodes))
    return f"after episode {episodes}" if episodes else "none"


def _time(text: str | None) -> str:
    return (text or "").replace("T", " ").replace("+00:00", " UTC")


def print_comparison(out: Console, runs: Sequence["Run"]) -> None:
    """Print the keys that differ, then the final metrics side by side."""
    from orchid_uav.experiments.runs.index import differences, short_names, value_text

    names = short_names(runs)
    rows = [[key, *map(value_text, values)] for key, values in differences(runs).items()]
    states = [
        ["status", *(run.status for run in runs)],
        ["episodes", *(_cells(run, ["episodes"])[0] for run in runs)],
    ]
    _print(out, ["", *names], [*states, *rows])
    if not rows and len(runs) > 1:
        print_line(out, "the configurations are the same")
    print_line(out, "")
    _print_metrics(out, runs, names)


def _print_metrics(out: Console, runs: Sequence["Run"], names: Sequence[str]) -> None:
    """Print one row per metric; for two runs, also the second value minus the first."""
    from orchid_uav.envs.metrics import REWARD
    from orchid_uav.experiments.configuration import reward_differences
    from orchid_uav.experiments.metrics import METRICS, heading_of
    from orchid_uav.experiments.runs.directory import FINAL_EPISODES
    from orchid_uav.experiments.runs.index import TRAINING_METRICS, value_text

    apart = reward_differences([run.config for run in runs])
    if len({run.record.episodes for run in runs}) > 1:
        apart.append("the number of episodes so far (it sets the reward's weights)")
    rows = []
    for key in TRAINING_METRICS:
        values = [run.record.final.get(key) for run in runs]
        if key not in METRICS or values == [None] * len(values):
            continue
        cells = [value_text(value, key) for value in values]
        if len(runs) == 2:
            one, other = values
            if one is None or other is None or (key == REWARD and apart):
                cells.append("-")
            else:
                cells.append(value_text(other - one, key))
        rows.append([heading_of(key), *cells])
    if not rows:
        print_line(out, "no final metrics: no episode is finished yet")
        return
    more = ["difference"] if len(runs) == 2 else []
    longest = max(run.record.episodes for run in runs)
    title = f"mean of last {min(FINAL_EPISODES, longest)}" if len(runs) > 1 else "metric"
    _print(out, [title, *names, *more], rows)
    if apart and len(runs) > 1:
        print_note(f"rewards cannot be compared, as these change their meaning: {', '.join(apart)}")


def print_curves(out: Console, runs: Sequence["Run"], metrics: Sequence[str], window: int) -> None:
    """Draw learning curves over each other on a terminal; elsewhere, print a small table."""
    from orchid_uav.cli.tables.terminal_curves import (
        Line,
        can_show_braille,
        sampled_table,
        terminal_curves,
    )
    from orchid_uav.experiments.metrics import METRICS, heading_of
    from orchid_uav.experiments.runs.index import read_log, short_names
    from orchid_uav.experiments.statistics.curves import single_curve

    logs = [read_log(run) for run in runs]
    if not any(logs):
        return
    # Without colours, only letters tell several curves apart.
    is_coloured = out.color_system is not None and not out.no_color
    braille = can_show_braille(out.encoding) and (is_coloured or len(runs) == 1)
    width = max(_LEAST_PLOT_WIDTH, min(out.width - 1, _MOST_PLOT_WIDTH))
    for metric in metrics:
        lines = []
        for name, rows in zip(short_names(runs), logs, strict=True):
            curve = single_curve(rows, metric, window)
            lines.append(Line(name, curve.episodes.tolist(), curve.values.tolist()))
        digits = METRICS[metric].digits if metric in METRICS else 6
        heading = heading_of(metric)
        heading += f", trailing means of {window} episodes" if window > 1 else ""
        print_line(out, "")
        if not out.is_terminal:
            print_line(out, heading)
            _print(out, *sampled_table(lines, digits))
            continue
        for line in terminal_curves(lines, heading, width, digits, braille=braille):
            out.print(line, soft_wrap=True)


def print_removals(out: Console, removals: Sequence["Removal"]) -> None:
    """Print what would be deleted."""
    rows = [
        [
            removal.path.name,
            removal.status,
            f"only the link; {removal.link_target} stays"
            if removal.link_target
            else f"{removal.size / 1e6:.1f} MB",
        ]
        for removal in removals
    ]
    _print(out, ["to be deleted", "status", ""], rows, wraps_last=True)


def _print(
    out: Console,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    wraps_last: bool = False,
) -> None:
    """Print a table of text from files, without control characters."""
    cells = [[*map(plain, row)] for row in rows]
    print_table(out, [*map(plain, columns)], cells, wraps_last)
