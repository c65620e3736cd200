"""Command lines, drawn from the options that the commands really have."""

from collections.abc import Iterator, Mapping
from typing import Any

import typer
from hypothesis import strategies as st

from orchid_uav.cli.main import app

RUN = "20261127T120000Z-fuzz-s0-abcd"
_WORLD = ("--set=network.episode_slots=2", "--set=ppo.hidden_sizes=[8]")
_SMALL = ("--uavs=2", "--users=10", *_WORLD)
_BASE: Mapping[str, tuple[str, ...]] = {
    "train": (*_SMALL, "--episodes=1", "--runs-dir=runs"),
    "eval": (*_SMALL, "--episodes=1", "--methods=static-mmf", "--runs-dir=runs"),
    "ablate": (
        *("--seeds=0", "--jobs=1", "--topologies=1", "--base=training.episodes=1"),
        *("--base=network.episode_slots=2", "--base=network.user_count=10"),
        "--base=network.uav_count=2",
    ),
    "plan": ("--budget=20", "--drones=1"),
    "replay": _SMALL,
    "reproduce": ("--no-train", "--only=fig7"),
}
"""What keeps a command short if it is accepted; what is drawn comes behind and overrides it."""
_RARE = {"ablate": 12, "tensorboard": 40, "reproduce": 12, "replay": 3, "eval": 2}
"""One of so many command lines of these is tried: they take seconds."""
_FITTING: Mapping[str, tuple[str, ...]] = {
    "--uavs": ("2", "1,2", "2..3"),
    "--users": ("10", "8..12:2"),
    "--episodes": ("1", "2"),
    "--seed": ("0", "7"),
    "--seeds": ("0", "0,1"),
    "--speeds": ("0", "5", "0..10:10"),
    "--speed": ("0", "5"),
    "--heading-hold": ("1", "20"),
    "--methods": ("static-mmf", "rules", "orchid,orchid-zero", "loiter-mmf"),
    "--method": ("planner", "balanced", "static-mmf", RUN),
    "--set": (
        *("network.episode_slots=1", "reset.kappa=0.3", "uav.flight=station"),
        *("network.area_m=[500,900]", "gbs.positions_m=[]", "training.worlds=2"),
    ),
    "--base": ("reset.kappa=0.3", "network.distribution=uniform"),
    "--out": ("made", "made.png", "made.zip", "made.html", "people.csv", "there/made", "runs"),
    "-o": ("made.html", "made.png", "people.csv"),
    "--onnx": ("made.onnx", "people.csv"),
    "--config": ("config.toml", "config.json", "people.csv"),
    "--runs-dir": ("runs", "elsewhere", "people.csv"),
    "--resume": (RUN, "fuzz-s0", f"runs/{RUN}"),
    "--preset": ("paper", "quick", "informed", "stations"),
    "--name": ("fuzz", "a b", "ä", "a/b", ".."),
    "--drones": ("1", "2", "auto"),
    "--want": ("1Mbps:95%", "500kbps:50%"),
    "--budget": ("20", "10"),
    "--altitude": ("80..120", "100..100"),
    "--area": ("area.geojson", "people.csv"),
    "--no-fly": ("area.geojson",),
    "--home": ("0.004,-29.996", "0.004,-29.996,12"),
    "--mast": ("0.004,-29.996", "0.004,-29.996,25"),
    "--check": ("mission.plan", "people.csv"),
    "--reserve": ("20%", "0%"),
    "--where": ("status=completed", "rate_jfi>0.7", "name~fu"),
    "--sort": ("-rate_jfi", "seed"),
    "--columns": ("seed,reward",),
    "--metric": ("rate_jfi", "reward"),
    "--metrics": ("all", "rate_jfi"),
    "--limit": ("0", "3"),
    "--only": ("fig7", "c16", "q1"),
    "--rows": ("rows",),
    "--frame": ("0", "1"),
    "--topologies": ("1",),
    "--kappa": ("0.1", "0.3"),
    "--worlds": ("1", "2"),
    "--jobs": ("1",),
}
_ARGUMENTS: Mapping[str, tuple[str, ...]] = {
    "plan": ("people.csv", "area.geojson"),
    "runs import": ("run.zip", "people.csv"),
}
_RUNS = (RUN, "fuzz-s0", "20261127", f"runs/{RUN}", "nothing", "orchid")
_ODD = (
    *("", " ", "0", "-1", "3.5", "nan", "-inf", "1e400", "1e-400", "0x10", "1_000", "١", "½"),
    *("..", "1..", "5..1", "0..1:0", "1,,2", "0..1:1e-30", "ä", "\u202e", "a\nb", "\x1b[31m"),
    *("'", '"', "[]", "{}", "null", "true", "[1,2", "=", "a=b", "network.", "network.uav_count"),
    *("network.uav_count=x", "network.uav_count=-1", "ppo.hidden_sizes=[]", "-", "--", "-x"),
    *("--help", "/", ".", "..", "/dev/null", "/proc/self/mem", "nothing.csv", "a" * 300, "%s%n"),
    *("\udcff", "NaN%", "100%", "-5%", "91,181", "1Gbps:101%"),
)


def _commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS: Mapping[tuple[str, ...], Any] = dict(_commands(typer.main.get_command(app)))
"""All commands, by their words."""


@st.composite
def command_lines(draw: st.DrawFn) -> tuple[str, ...]:
    """Arguments of ``orchid``: some right, most with a mistake or two."""
    words = draw(st.sampled_from(sorted(COMMANDS)))
    name = " ".join(words)
    if (rarely := _RARE.get(name)) and draw(st.integers(1, rarely)) > 1:
        words, name = ("config", "show"), "config show"
    arguments = list(words)
    if draw(st.integers(0, 30)) == 0:
        arguments[-1] = draw(st.text(max_size=8).filter(lambda text: "\0" not in text))
    arguments += _BASE.get(name, ())
    parameters = COMMANDS[words].params
    for parameter in parameters:
        if parameter.param_type_name == "argument":
            fitting = _ARGUMENTS.get(name, _RUNS)
            for _ in range(draw(st.integers(0, 2))):
                arguments.append(draw(_value(fitting)))
    options = [one for one in parameters if one.param_type_name == "option"]
    for option in draw(st.lists(st.sampled_from(options), max_size=4)) if options else ():
        spelled = draw(st.sampled_from(option.opts))
        if option.is_flag:
            arguments.append(spelled)
            continue
        value = draw(_value(_FITTING.get(spelled, ("1", "0.5", "pf", "uniform", "random"))))
        form = draw(st.integers(0, 9))
        if form == 0:
            arguments.append(spelled)  # its value is missing
        elif form < 5 and spelled.startswith("--"):
            arguments.append(f"{spelled}={value}")
        else:
            arguments += [spelled, value]
    if draw(st.integers(0, 15)) == 0:
        arguments.append(draw(st.sampled_from(("--nothing", "-z", "--seedd=1", "more"))))
    return tuple(arguments)


def _value(fitting: tuple[str, ...]) -> st.SearchStrategy[str]:
    right = st.sampled_from(fitting)
    text = st.text(max_size=12).filter(lambda text: "\0" not in text)
    return st.one_of(right, right, right, st.sampled_from(_ODD), text)


def _number() -> st.SearchStrategy[str]:
    return st.one_of(
        st.integers(-3, 40).map(str),
        st.decimals(-2, 30, allow_nan=False, allow_infinity=False, places=2).map(str),
        st.floats(width=16).map(repr),
        st.sampled_from(("1e3", "+5", ".5", "5.", "1e400", "0x1", "", " 4 ", "1_0", "٣", "--1")),
    )


@st.composite
def ranges(draw: st.DrawFn) -> str:
    """Lists and ranges of numbers as ``--uavs`` takes them, and things that look like them."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.text(alphabet="0123456789.,:eE+- ", max_size=12))
    parts = []
    for _ in range(draw(st.integers(1, 4))):
        form = draw(st.integers(0, 2))
        numbers = [draw(_number()) for _ in range(3)]
        parts.append((numbers[0], "..".join(numbers[:2]), "{}..{}:{}".format(*numbers))[form])
    return draw(st.sampled_from((",", ",", ",", ", ", ";", " "))).join(parts)
