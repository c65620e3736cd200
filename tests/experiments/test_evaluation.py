"""``orchid eval``: the same topologies for all, its files, its errors, what interruption leaves."""

import hashlib
import io
import itertools
import json
import os
import re
import shlex
import shutil
import signal
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from orchid_uav import notices
from orchid_uav.agents import load_policy
from orchid_uav.agents.controllers.heuristics import Hover, Loiter
from orchid_uav.agents.controllers.learned import Learned
from orchid_uav.cli.console import print_line
from orchid_uav.cli.main import main
from orchid_uav.cli.progress.evaluation import LineProgress
from orchid_uav.cli.tables.evaluation import print_tables
from orchid_uav.envs import EPISODE_METRICS, Parameters, WorldBatch, evaluation_seeds
from orchid_uav.experiments import interruption
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation import directory as evaluation_files
from orchid_uav.experiments.evaluation import flights as evaluation
from orchid_uav.experiments.evaluation.flights import (
    EvaluationPlan,
    HeldOut,
    Setting,
    evaluate,
    summarise_flights,
)
from orchid_uav.experiments.evaluation.methods import (
    known_methods,
    method_overrides,
    read_policy,
    rules,
    select,
)
from orchid_uav.experiments.figures import evaluation_figures as drawing
from orchid_uav.experiments.metrics import EVALUATION_METRICS, HEADROOM, METRICS
from orchid_uav.experiments.runs.records import find_run
from orchid_uav.experiments.statistics import intervals as statistics
from orchid_uav.experiments.statistics.intervals import UNKNOWN
from orchid_uav.experiments.statistics.results import EvaluationResult
from tests.helpers.damage import reseal
from tests.helpers.processes import (
    ESCAPE,
    TINY_FLAGS,
    assert_is_an_error,
    forked,
    signals_by_default,
    tell_of_file_steps,
)

TINY_EVAL = [
    *("eval", "--uavs=2", "--users=20", "--set=network.episode_slots=10", "--episodes=4"),
    "--planner-evaluations=40",
]
CONTRACT = {
    *("method", "run", "objective", "distribution", "uavs", "users", "speed_mps", "episodes"),
    *("deterministic", "coverage", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi"),
    *("worst_rate_bps", "sum_rate_bps", "propulsion_power_w", "reward", "collisions"),
    "blocking_pairs",
}
"""Keys of a result that other programs rely on."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A tiny run that nothing may change."""
    directory = tmp_path_factory.mktemp("trained")
    arguments = [*TINY_FLAGS, "--episodes=2", "--no-rf", "--quiet", "--name=mine"]
    assert main(["train", *arguments, "--runs-dir", str(directory)]) == 0
    (run,) = directory.iterdir()
    return run


@pytest.fixture
def run_copy(trained, tmp_path):
    """A copy of the run, to be damaged."""
    return shutil.copytree(trained, tmp_path / "copies" / trained.name)


@pytest.fixture
def evaluate_tiny(orchid, tmp_path, monkeypatch):
    """``orchid eval`` of tiny networks in an empty directory."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return lambda *arguments: orchid(*TINY_EVAL, *arguments)


ONE_SETTING = [Setting("tcp", 2, 20, 0.0, 1.0)]


def tiny_plan(contenders, settings=ONE_SETTING, episodes=4, **overrides):
    world = Parameters().with_overrides({"network.episode_slots": 10, **overrides})
    return EvaluationPlan(contenders, settings, episodes, seed=5, world=world)


def fly(plan, **keywords):
    flown, is_complete = evaluate(plan, **keywords)
    assert is_complete
    return flown


def test_a_stop_of_which_no_exception_told_is_heeded_in_the_next_slot():
    plan = tiny_plan([rules()["static-mmf"], rules()["loiter-mmf"]])
    asked = []

    def stop():
        asked.append(None)
        return len(asked) > 14  # in the second flight of ten slots

    flown, is_complete = evaluate(plan, stop=stop)
    assert not is_complete and len(asked) == 15
    assert [key[-2] for key in flown] == ["static-mmf"]


# What is flown


@pytest.mark.parametrize(("key", "make"), [("static-mmf", Hover), ("loiter-mmf", Loiter)])
def test_figures_are_those_of_worlds_flown_one_by_one(key, make):
    contender = rules()[key]
    plan = tiny_plan([contender])
    figures = fly(plan)[next(plan.flights()).key]
    parameters = plan.settings[0].apply(plan.world)
    for index, seed in enumerate(evaluation_seeds(5, 4)):
        world = WorldBatch(parameters, seed=[seed])
        world.set_progress(1.0)
        world.reset()
        method = make()
        method.begin(world)
        for _ in range(10):
            world.step(method.act(world))
        alone = world.episode_metrics(0)
        for name in EPISODE_METRICS:
            assert figures[name][index] == pytest.approx(alone[name], rel=1e-12), name


def test_all_methods_meet_the_same_users_whatever_their_start(trained, monkeypatch):
    seen = {}
    original = evaluation._fly_batch

    def spy(contender, parameters, topologies, *others):
        seen[contender.key] = topologies
        return original(contender, parameters, topologies, *others)

    monkeypatch.setattr(evaluation, "_fly_batch", spy)
    contenders = [*select(["rules"], planner_evaluations=40), *select([], [trained])]
    random_start = contenders[-1].__class__(
        "random", "", {"reward.objective": "mmf", "deployment.init": "random"}, lambda _: Hover()
    )
    fly(tiny_plan([*contenders, random_start], **{"network.sensing_error_std_m": 20.0}))
    reference = seen["static-pf"]
    for key, topologies in seen.items():
        for name in ("users_m", "target_users", "shadowing_db", "walk_keys"):
            assert np.array_equal(getattr(topologies, name), getattr(reference, name)), (key, name)
    assert not np.array_equal(seen["random"].start_m, reference.start_m)


def test_a_policy_flies_other_counts_than_it_was_trained_with(trained):
    settings = [Setting("tcp", uavs, users, 3.0, 2.0) for uavs in (1, 5) for users in (20, 30)]
    results = summarise_flights(plan := tiny_plan(select([], [trained]), settings), fly(plan))
    assert [(result.uavs, result.users) for result in results[::2]] == [
        (1, 20), (1, 30), (5, 20), (5, 30)
    ]  # fmt: skip
    assert results[0].metrics["nearest_uav_m"] == UNKNOWN
    assert results[-1].metrics["nearest_uav_m"].mean > 0.0


def test_a_run_flies_as_its_actor_does_and_its_twin_hovers(trained):
    plan = tiny_plan([*select(["static-mmf"]), *select([], [trained])])
    static, learned, twin = fly(plan).values()
    for name in EVALUATION_METRICS:
        assert np.array_equal(static[name], twin[name]), name
    world = WorldBatch(plan.settings[0].apply(plan.world), 4, evaluation_seeds(5, 4))
    world.set_progress(1.0)
    world.reset()
    method = Learned(load_policy(trained))
    for _ in range(10):
        world.step(method.act(world))
    rewards = [world.episode_metrics(index)["reward"] for index in range(4)]
    assert learned["reward"] == pytest.approx(rewards, rel=1e-9)


def test_sampled_rows_stand_beside_deterministic_ones(trained):
    contenders = select([], [trained], stochastic=True)
    assert [(one.key.endswith("-zero"), one.deterministic) for one in contenders] == [
        (False, True), (False, False), (True, True), (True, False)
    ]  # fmt: skip
    figures = list(fly(tiny_plan(contenders)).values())
    assert not np.array_equal(figures[0]["reward"], figures[1]["reward"])
    again = list(fly(tiny_plan(contenders)).values())
    assert np.array_equal(figures[1]["reward"], again[1]["reward"])


def test_the_first_topologies_do_not_depend_on_their_number(trained):
    contenders = select(["balanced-loiter", "track"], [trained], stochastic=True)
    speed = [Setting("uniform", 3, 20, 5.0, 1.0)]
    few, many = (fly(tiny_plan(contenders, speed, episodes=count)) for count in (3, 7))
    for key, figures in few.items():
        for name, values in figures.items():
            assert values == pytest.approx(many[key][name][:3], rel=1e-5), (key, name)


def test_batches_that_are_too_large_are_divided(monkeypatch):
    contenders = select(["static-mmf"])
    whole = fly(tiny_plan(contenders, episodes=5))
    monkeypatch.setattr(evaluation, "_WORLDS_AT_ONCE", 2)
    divided = fly(tiny_plan(contenders, episodes=5))
    for key in whole:
        assert np.array_equal(whole[key]["reward"], divided[key]["reward"])


def test_headroom_lies_between_loiter_and_planner():
    contenders = select(
        ["static-mmf", "loiter-mmf", "planner", "planner-retargeted"], (), False, 60
    )
    plan = tiny_plan(contenders)
    flown = fly(plan)
    results = {result.method: result.metrics for result in summarise_flights(plan, flown)}
    mean = {key: np.mean(figures["utility"]) for (*_, key, _), figures in flown.items()}
    assert results["loiter-mmf"][HEADROOM].mean == 0.0
    assert results["planner"][HEADROOM].mean == 1.0
    room = mean["planner"] - mean["loiter-mmf"]
    expected = (mean["static-mmf"] - mean["loiter-mmf"]) / room
    assert results["static-mmf"][HEADROOM].mean == pytest.approx(expected)
    low, high = results["static-mmf"][HEADROOM].ci95
    assert low <= expected <= high
    assert results["planner-retargeted"][HEADROOM].mean is None  # serves other users


# The command


def test_json_is_one_document_that_keeps_the_contract(evaluate_tiny, trained):
    arguments = ("--methods=static-pf,loiter-mmf", "--json", "--out=out", "--no-figures")
    finished = evaluate_tiny(trained, *arguments)
    assert finished.code == 0
    document = json.loads(finished.out)
    assert document["schema"] == 1
    assert set(document) >= {"settings", "results"}
    for result in document["results"]:
        assert set(result) >= CONTRACT | set(METRICS)
    assert [result["method"] for result in document["results"]] == [
        *("static-pf", "loiter-mmf", trained.name, f"{trained.name}-zero")
    ]
    assert [result["run"] for result in document["results"]][1:3] == [None, trained.name]
    assert [result["objective"] for result in document["results"]] == ["pf", "mmf", "mmf", "mmf"]
    assert document["settings"]["uavs"] == [2]


def test_a_balanced_start_is_the_methods_own_whoever_is_drawn_first():
    """It is chosen by the rates that the method's own shares give."""
    objectives = {name: method_overrides(name, "balanced", "station") for name in ("mmf", "pf")}
    contenders = {
        name: rules()["static-mmf"].with_overrides(values) for name, values in objectives.items()
    }
    world, setting, seeds = Parameters(), Setting(users=100, uavs=4), evaluation_seeds(0, 5)
    starts = []
    for order in (("mmf", "pf"), ("pf", "mmf")):
        held_out = HeldOut(world, setting, seeds)
        drawn = {name: held_out.of(contenders[name])[1] for name in order}
        starts.append({name: drawn[name].start_m for name in objectives})
    for name in objectives:
        np.testing.assert_array_equal(starts[0][name], starts[1][name])
    assert (starts[0]["mmf"] != starts[0]["pf"]).any()


def test_summary_agrees_with_the_episodes(evaluate_tiny, tmp_path):
    finished = evaluate_tiny(
        "--methods=rules", "--uavs=2,3", "--speeds=0..4:4", "--out=out", "--no-figures"
    )
    assert finished.code == 0
    assert "4 settings x 18 methods x 4 topologies = 288 flights" in finished.out
    summary = json.loads((tmp_path / "work/out/summary.json").read_text())
    rows = pq.read_table(tmp_path / "work/out/episodes.parquet").to_pylist()
    assert len(rows) == 288
    assert len({row["seed"] for row in rows}) == 4
    keys = ("method", "uavs", "speed_mps", "deterministic")
    for result in summary["results"]:
        own = [row for row in rows if all(row[key] == result[key] for key in keys)]
        assert [row["episode"] for row in own] == [0, 1, 2, 3]
        for metric in EVALUATION_METRICS:
            values = [row[metric] for row in own]
            described = result[metric]
            assert described["mean"] == pytest.approx(np.mean(values)), metric
            assert described["std"] == pytest.approx(np.std(values, ddof=1), abs=1e-12), metric
            low, high = described["ci95"]
            assert low <= described["mean"] + 1e-9 and described["mean"] <= high + 1e-9


def test_tables_have_a_column_per_setting_and_mark_the_best(evaluate_tiny):
    finished = evaluate_tiny(
        "--methods=static-mmf,loiter-mmf", "--uavs=2..4:2", "--quiet", "--no-figures"
    )
    assert ESCAPE not in finished.out
    lines = finished.out.splitlines()
    header = next(line for line in lines if line.startswith("energy efficiency"))
    assert header.split("\t")[1:] == ["2 UAVs", "4 UAVs"]
    static, loiter = lines[lines.index(header) + 1 : lines.index(header) + 3]
    assert all(cell.endswith(" *") for cell in loiter.split("\t")[1:])
    assert "*" not in static
    assert "±" in static


def shown_at(width, results, metrics):
    """The tables of some results on a terminal."""
    screen = io.StringIO()
    out = Console(file=screen, width=width, force_terminal=True, highlight=False, color_system=None)
    print_tables(out, results, metrics)
    return screen.getvalue()


RUN_IDS = ("20261122T211205Z-pf-8-s0-abcd", "20261122T211206Z-pf-8-s1-efgh")


def made_up_results(settings, methods=("orchid-random-init-zero", "static-pf-full-power")):
    """Results of two rules and two runs with their twins, each figure another number."""
    keys = [(key, None) for key in methods]
    keys += [(run + twin, run) for run in RUN_IDS for twin in ("", "-zero")]
    results = []
    for place, (setting, (key, run)) in enumerate(itertools.product(settings, keys)):
        figures = {
            name: {
                "mean": (1 + place + number / 100) / METRICS[name].scale,
                "std": 0.125 if name == "rate_jfi" else None,
                "ci95": None,
            }
            for number, name in enumerate(METRICS)
        }
        described = {"method": key, "run": run, "deterministic": True, "comparable": True}
        described |= {"objective": "mmf", "episodes": 4, **setting._asdict()}
        results.append(EvaluationResult.from_json(described | figures))
    return results


@pytest.mark.parametrize("width", [60, 80, 100, 140])
@pytest.mark.parametrize(
    "settings", [[Setting()], [Setting("tcp", uavs, 100, 12.5, 20.0) for uavs in range(4, 11)]]
)
def test_on_a_terminal_no_number_and_no_word_is_broken(width, settings):
    results = made_up_results(settings)
    text = shown_at(width, results, list(METRICS))
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    cells = [re.split(" {2,}", line.rstrip()) for line in lines]
    shown = Counter(cell.removesuffix(" *") for row in cells for cell in row)
    for name, metric in METRICS.items():
        for result in results:
            value = metric.text(result.metrics[name].mean)
            assert shown[value + (" ± 0.125" if name == "rate_jfi" else "")] > 0, (name, value)
    # Each table has the same rows, called as a reader recognises them.
    names = ["orchid-random-init-zero", "static-pf-full-power"]
    names += ["pf-8-s0", "pf-8-s0-zero", "pf-8-s1", "pf-8-s1-zero"]
    tables = {shown[name] for name in names}
    assert len(tables) == 1 and tables.pop() >= 2
    assert not any(run in text for run in RUN_IDS)
    for word in ("efficiency", "(Mbit/J)", "violations", "JFI"):
        assert len(settings) > 1 or word in text.split()


@pytest.mark.parametrize(("alike", "one_row"), [(4, None), (5, "the 5 others"), (6, "all methods")])
def test_methods_with_the_same_numbers_are_one_row_on_a_terminal(alike, one_row):
    settings = [Setting(), Setting(uavs=4)]
    results = made_up_results(settings)
    same = results[0].metrics["coverage"]
    names = list(dict.fromkeys(result.method for result in results))
    for result in results:
        if result.method in names[:alike]:
            result.metrics["coverage"] = same
    text = shown_at(140, results, ["coverage"])
    rows = [re.split(" {2,}", line.rstrip()) for line in text.splitlines()[2:]]
    value = METRICS["coverage"].text(same.mean)
    if one_row is None:
        assert len(rows) == 6
    else:
        assert len(rows) == 1 + 6 - alike
        assert [cell.removesuffix(" *") for cell in rows[-1]] == [one_row, value, value]
    out = io.StringIO()
    print_tables(Console(file=out, force_terminal=False), results, ["coverage"])
    assert len(out.getvalue().splitlines()) == 2 + 6, "a program is told every row"


def test_of_equal_names_and_seeds_the_letters_are_shown():
    results = made_up_results([Setting()])
    other = "20261122T211205Z-pf-8-s0-wxyz"
    results.append(results[-1].model_copy(update={"method": other, "run": other}))
    text = shown_at(80, results, ["utility"])
    rows = [line.split()[0] for line in text.splitlines()[1:]]
    assert rows[2:] == [
        *("pf-8-s0-abcd", "pf-8-s0-abcd-zero", "pf-8-s1", "pf-8-s1-zero", "pf-8-s0-wxyz"),
    ]


def test_figures_are_drawn_in_both_formats(evaluate_tiny, tmp_path):
    finished = evaluate_tiny("--methods=static-mmf", "--uavs=2,3", "--out=out")
    assert finished.code == 0
    folder = tmp_path / "work/out/figures"
    names = {path.name for path in folder.iterdir()}
    assert {"rate_jfi.png", "rate_jfi.svg", "blocking_pairs.svg"} <= names
    page = Path("out/figures/index.html")
    assert finished.out.splitlines()[-3:-1] == [f"figures: {page}", "completed: out"]
    text = (folder / page.name).read_text(encoding="utf-8")
    assert {f"{name.removesuffix('.png')}" for name in names if name.endswith(".png")} == set(
        re.findall(r'<img src="(\w+).png"', text)
    )
    assert "<code><span>orchid</span> <span>eval</span>" in text and "--uavs=2,3" in text


def test_the_summary_is_there_before_anything_is_drawn(evaluate_tiny, tmp_path, monkeypatch):
    out = tmp_path / "work/out"
    arguments = ("--methods=static-mmf,loiter-mmf", "--out=out")
    seen = []

    def die(*given):
        seen.append(json.loads((out / "summary.json").read_text()))
        raise KeyboardInterrupt

    monkeypatch.setattr(drawing, "draw_figures", die)
    assert evaluate_tiny(*arguments).code == 130
    assert [result["method"] for result in seen[0]["results"]] == ["static-mmf", "loiter-mmf"]
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(drawing, "draw_metric", lambda results, metric: None)  # which takes time
    finished = evaluate_tiny(*arguments)
    assert finished.code == 0, "the same command does not go on"
    assert "2 batches of them already flown" in finished.out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["results"] == seen[0]["results"]
    assert summary["status"] == "completed"
    assert (out / "figures").is_dir()


def test_figures_that_cannot_be_drawn_cost_no_evaluation(evaluate_tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(notices, "_told", set())

    def fail(figure, path, **options):
        raise ValueError("a font\nis missing")

    monkeypatch.setattr(drawing.Figure, "savefig", fail)
    finished = evaluate_tiny("--methods=static-mmf", "--out=out", "--quiet")
    assert finished.code == 0
    [warning] = finished.err.splitlines()
    assert warning.startswith("warning: no figures in out, ")
    assert warning.endswith("ValueError: a font is missing")
    assert "static-mmf" in finished.out
    assert json.loads((tmp_path / "work/out/summary.json").read_text())["status"] == "completed"
    assert {path.name for path in (tmp_path / "work/out").iterdir()} == {
        *("episodes.parquet", "summary.json")
    }


def test_a_backend_of_a_notebook_is_not_asked_for(start_process):
    script = (
        "from orchid_uav.cli.main import main; main(['config', 'show']);"
        "from orchid_uav.experiments.figures import style; import matplotlib;"
        "print(matplotlib.get_backend())"
    )
    inherited = {"MPLBACKEND": "module://of_a_notebook.that_is_not_here"}
    process = start_process([sys.executable, "-c", script], env=os.environ | inherited)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "")
    assert out.splitlines()[-1].lower() == "agg"


def test_ends_with_the_command_that_varies_the_fleet(evaluate_tiny, tmp_path):
    arguments = ["--methods=static-mmf", "--no-figures"]
    finished = evaluate_tiny(*arguments, "--out", "mine", "--uavs", "3")
    kept = [argument for argument in TINY_EVAL if argument != "--uavs=2"]
    expected = shlex.join(["orchid", *kept, *arguments, "--uavs", "4..10"])
    assert finished.out.splitlines()[-1] == f"next: {expected}"
    finished = evaluate_tiny(*arguments, "--uavs=2,3")
    assert finished.out.splitlines()[-1] == "next: orchid ablate --no-rf"
    for silent in ("--quiet", "--json"):
        finished = evaluate_tiny(*arguments, silent)
        assert "next:" not in finished.out + finished.err


def test_goes_to_a_directory_of_its_own_by_default(evaluate_tiny, tmp_path):
    for _ in range(3):
        assert evaluate_tiny("--methods=static-mmf", "--no-figures", "--quiet").code == 0
    made = list((tmp_path / "work/orchid-eval").iterdir())
    assert len(made) == 3
    assert all({path.name for path in one.iterdir()} == {"episodes.parquet", "summary.json"}
               for one in made)  # fmt: skip


def test_runs_are_found_by_the_beginning_of_their_id(evaluate_tiny, trained):
    finished = evaluate_tiny(
        trained.name[:-2], "--runs-dir", trained.parent, "--methods=static-mmf", "--no-figures"
    )
    assert finished.code == 0
    assert trained.name in finished.out


def test_says_where_a_run_was_trained_in_another_world(evaluate_tiny, trained):
    finished = evaluate_tiny(
        trained, "--methods=static-mmf", "--no-figures", "--set=uav.max_speed_mps=20"
    )
    assert "trained in another world: uav.max_speed_mps" in finished.err


def test_lists_all_methods(evaluate_tiny, tmp_path):
    finished = evaluate_tiny("--list")
    listed = dict(line.split("\t") for line in finished.out.splitlines()[1:])
    assert set(listed) == set(known_methods())
    assert listed["orchid-zero"] == "orchid with its actions forced to zero"
    finished = evaluate_tiny("--list", "--json")
    document = json.loads(finished.out)
    assert finished.err == ""
    assert document["schema"] == 1
    methods = {one["method"]: one for one in document["methods"]}
    assert {key: one["idea"] for key, one in methods.items()} == listed
    assert methods["orchid-zero"]["groups"] == ["all", "learned"]
    assert methods["planner"]["groups"] == ["all", "rules"]
    assert methods["planner-retargeted"]["groups"] == []
    assert list((tmp_path / "work").iterdir()) == []


# Bad input


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--methods=orchit"], ["orchit", "'orchid'"]),
        (["--methods=static_pf"], ["'static-pf'"]),
        (["--uavs=4-9"], ["--uavs", "4-9", "4..10"]),
        (["--uavs=9..4"], ["--uavs 9..4", "empty"]),
        (["--uavs=2.5"], ["2.5"]),
        (["--users=,"], ["--users"]),
        (["--users=1..20000"], ["10,000"]),
        (["--uavs=30"], ["user_count"]),
        (["--speeds=-3..0"], ["user_speed_mps"]),
        (["--heading-hold=0"], ["heading_hold_s"]),
        (["--distribution=gauss"], ["gauss", "tcp"]),
        (["--metrics=jfi"], ["jfi", "did you mean"]),
        (["--set=ppo.discount=0.9"], ["ppo.discount", "no effect"]),
        (["--set=network.uav_count=3"], ["--uavs"]),
        (["--set=reward.objective=pf"], ["--methods"]),
        (["--set=network.shares=pf"], ["--methods"]),
        (["--set=deployment.init=random"], ["--methods"]),
        (["--uavs=1..100", "--users=2..10001"], ["1,000,000 settings"]),
        (["--uavs=2,0"], ["--uavs 2,0", "not a whole number"]),
        (["~nosuchuser/run"], ["~nosuchuser"]),
        (["x" * 300], ["xxx"]),
        (["--episodes=1000000"], ["episodes"]),
        (["--set=uav.max_sped=3"], ["uav.max_speed_mps"]),
        (["no-such-run"], ["no-such-run"]),
        (["--episodes=0"], ["episodes"]),
        (["--planner-evaluations=5"], ["planner-evaluations"]),
    ],
)
def test_bad_input_is_told_and_leaves_nothing(evaluate_tiny, tmp_path, arguments, parts):
    methods = [] if any("--methods" in argument for argument in arguments) else ["--methods=rules"]
    finished = evaluate_tiny(*arguments, *methods, "--out=out")
    assert_is_an_error(finished, *parts)
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.parametrize(
    ("damage", "part"),
    [
        (lambda run: reseal(run / "run.json", status="running"), "died"),
        (lambda run: reseal(run / "run.json", status="failed"), "failed"),
        (lambda run: (run / "run.json").unlink(), "run.json"),
        (lambda run: (run / "run.json").write_text("{"), "run.json"),
        (lambda run: (run / "config.json").unlink(), "config.json"),
        (lambda run: (run / "policy.safetensors").unlink(), "policy.safetensors"),
        (lambda run: (run / "policy.json").unlink(), "policy.json"),
        (lambda run: (run / "policy.safetensors").write_bytes(b"x" * 100), "sha256"),
    ],
)
def test_a_run_that_cannot_be_flown_is_told(evaluate_tiny, run_copy, tmp_path, damage, part):
    damage(run_copy)
    assert_is_an_error(evaluate_tiny(run_copy, "--out=out"), part)
    assert list((tmp_path / "work").iterdir()) == []


def test_a_policy_for_other_observations_is_told(evaluate_tiny, run_copy, monkeypatch):
    from orchid_uav.experiments.evaluation import methods

    monkeypatch.setitem(methods.OBSERVATION_SIZES, "paper", 17)
    assert_is_an_error(evaluate_tiny(run_copy), "16 observations", "17")


def test_nothing_is_overwritten(evaluate_tiny, tmp_path):
    out = tmp_path / "work/out"
    assert evaluate_tiny("--methods=static-mmf", "--out=out", "--no-figures").code == 0
    before = (out / "summary.json").read_bytes()
    assert_is_an_error(evaluate_tiny("--methods=static-pf", "--out=out"), "complete")
    assert (out / "summary.json").read_bytes() == before
    other = tmp_path / "work/other"
    other.mkdir()
    (other / "thesis.txt").write_text("years of work")
    assert_is_an_error(evaluate_tiny("--methods=static-pf", "--out=other"), "other")
    assert [path.name for path in other.iterdir()] == ["thesis.txt"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_directory_that_cannot_be_written_is_told_before_anything_is_flown(
    evaluate_tiny, tmp_path
):
    (tmp_path / "work").chmod(0o500)
    assert_is_an_error(evaluate_tiny("--methods=static-mmf", "--out=out"), "out")


def test_ambiguous_and_unknown_runs(trained, tmp_path):
    shutil.copytree(trained, tmp_path / (trained.name + "x"))
    shutil.copytree(trained, tmp_path / trained.name)
    assert find_run(trained.name, tmp_path) == tmp_path / trained.name
    with pytest.raises(InputError, match="the ids of 2 runs begin with"):
        find_run(trained.name[:-1], tmp_path)
    with pytest.raises(InputError, match=f"did you mean '{trained.name}"):
        find_run(trained.name[1:], tmp_path)
    with pytest.raises(InputError, match="no directory"):
        find_run("x", tmp_path / "nowhere")
    with pytest.raises(InputError, match="given twice"):
        select([], [trained, tmp_path / trained.name])
    assert read_policy(trained).run == trained.name


# Interruption


@pytest.mark.parametrize("numbers", [[signal.SIGINT], [signal.SIGTERM, signal.SIGTERM]])
def test_an_interrupted_evaluation_goes_on_to_the_same_result(
    evaluate_tiny, tmp_path, monkeypatch, numbers
):
    methods = "--methods=static-pf,static-mmf,loiter-mmf"
    assert evaluate_tiny(methods, "--uavs=2,3", "--out=whole", "--no-figures").code == 0
    original, calls = evaluation._fly_batch, []

    def interrupted(*arguments):
        calls.append(arguments[0].key)
        if len(calls) == 5:
            for number in numbers:
                signal.raise_signal(number)
        return original(*arguments)

    def too_long(*arguments, **options):
        raise AssertionError("who wants to stop does not wait for it")

    arguments, told = (methods, "--uavs=2,3", "--out=parts"), []
    with monkeypatch.context() as patch:
        patch.setattr(interruption, "os", SimpleNamespace(write=lambda *given: told.append(given)))
        patch.setattr(evaluation, "_fly_batch", interrupted)
        patch.setattr(statistics, "bootstrap", too_long)
        patch.setattr(drawing, "draw_figures", too_long)
        stopped = evaluate_tiny(*arguments)
    assert stopped.code == 130
    assert told == [(2, b"stopping; what was flown is kept\n")]
    assert "continue with: orchid eval" in stopped.err
    parts = tmp_path / "work/parts"
    partial = json.loads((parts / "summary.json").read_text())
    assert partial["status"] == "interrupted"
    assert len(partial["results"]) == 4
    for result in partial["results"]:
        assert result["utility"]["mean"] > 0.0
        assert result["utility"]["ci95"] is None
    assert_is_an_error(evaluate_tiny(methods, "--uavs=2,4", "--out=parts"), "other settings: uavs")
    finished = evaluate_tiny(*arguments, "--no-figures")
    assert finished.code == 0
    assert "4 batches of them already flown" in finished.out
    for name in ("results", "settings", "status"):
        documents = [
            json.loads((tmp_path / "work" / out / "summary.json").read_text())[name]
            for out in ("whole", "parts")
        ]
        assert documents[0] == documents[1]
    assert pq.read_table(parts / "episodes.parquet") == pq.read_table(
        tmp_path / "work/whole/episodes.parquet"
    )


@pytest.mark.parametrize("stage", ["summary_document", "write_evaluation"])
def test_what_was_flown_is_kept_whatever_happens_afterwards(
    evaluate_tiny, tmp_path, monkeypatch, stage
):
    original = getattr(evaluation_files, stage)

    def interrupted(*arguments, **keywords):
        if keywords:  # of nothing flown yet
            return original(*arguments, **keywords)
        raise KeyboardInterrupt

    arguments = ("--methods=static-pf,loiter-mmf", "--out=out", "--no-figures")
    monkeypatch.setattr(evaluation_files, stage, interrupted)
    stopped = evaluate_tiny(*arguments)
    assert stopped.code == 130
    assert "continue with: orchid eval" in stopped.err
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(evaluation, "_fly_batch", interrupted)  # nothing is flown again
    finished = evaluate_tiny(*arguments)
    assert finished.code == 0
    assert "2 batches of them already flown" in finished.out


@pytest.mark.parametrize("numbers", [[signal.SIGINT], [signal.SIGTERM, signal.SIGTERM]])
@pytest.mark.parametrize("step", ["write", "replace", "fsync"])
def test_an_interruption_lets_files_be_written_first(
    evaluate_tiny, tmp_path, monkeypatch, numbers, step
):
    left = [True]

    def interrupt(name):
        if name == step and left:
            left.clear()
            for number in numbers:
                signal.raise_signal(number)

    write = evaluation_files._write_table

    def write_interrupted(*arguments):
        with monkeypatch.context() as patch:
            tell_of_file_steps(patch, interrupt)
            write(*arguments)

    arguments = ("--methods=static-pf,loiter-mmf", "--uavs=2,3", "--out=out", "--no-figures")
    with monkeypatch.context() as patch:
        patch.setattr(evaluation_files, "_write_table", write_interrupted)
        assert evaluate_tiny(*arguments).code == 130
    assert len(pq.read_table(tmp_path / "work/out/episodes.parquet")) == 2 * 4
    assert {path.name for path in (tmp_path / "work/out").iterdir()} == {
        *("summary.json", "episodes.parquet")
    }
    assert "2 batches of them already flown" in evaluate_tiny(*arguments).out


@pytest.mark.skipif(os.name != "posix", reason="fork is POSIX")
@pytest.mark.parametrize("number", [None, signal.SIGHUP])
def test_flights_are_kept_when_the_output_breaks(evaluate_tiny, tmp_path, monkeypatch, number):
    start, calls = LineProgress.start, []

    def broken(self, flight):
        print_line(self._out, "here")
        calls.append(flight)
        if len(calls) == 3 and number:
            signal.raise_signal(number)
        start(self, flight)

    def fly() -> None:
        read, write = os.pipe()
        os.close(read)
        os.dup2(write, 1)
        os.dup2(write, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        LineProgress.start = broken
        with signals_by_default():
            os._exit(main([*TINY_EVAL, *arguments]))

    arguments = ("--methods=static-pf,loiter-mmf", "--uavs=2,3", "--out=out", "--no-figures")
    _, status = os.waitpid(forked(fly), 0)
    assert os.waitstatus_to_exitcode(status) == (130 if number else 1)
    summary = json.loads((tmp_path / "work/out/summary.json").read_text())
    assert summary["status"] == ("interrupted" if number else "completed")
    assert len(summary["results"]) == (2 if number else 4)


def test_settings_that_are_not_listed_come_from_the_file(evaluate_tiny, tmp_path):
    (tmp_path / "work/lab.toml").write_text(
        "[network]\nuser_speed_mps = 3.0\nuav_count = 9\n[ppo]\ndiscount = 0.5\n"
    )
    finished = evaluate_tiny("--config=lab.toml", "--methods=static-mmf", "--json", "--no-figures")
    settings = json.loads(finished.out)["settings"]
    assert (settings["uavs"], settings["speeds_mps"]) == ([2], [3.0])
    assert "have no effect here: ppo.discount" in finished.err


def test_a_method_with_another_task_is_never_the_best(evaluate_tiny):
    finished = evaluate_tiny("--methods=static-mmf,planner,planner-retargeted", "--no-figures")
    (line,) = [one for one in finished.out.splitlines() if one.startswith("planner-retargeted")]
    assert "*" not in line


def test_no_share_of_a_headroom_that_is_not_there():
    setting = [Setting("tcp", 1, 20, 0.0, 1.0)]
    plan = tiny_plan(select(["static-mmf", "loiter-mmf", "planner"], (), False, 31), setting)
    figures = {"utility": np.array([1.0, 1.1, 1.2, 1.3])}
    plain = {name: np.zeros(4) for name in EVALUATION_METRICS}
    flown = {flight.key: plain | figures for flight in plan.flights()}
    assert all(result.metrics[HEADROOM].mean is None for result in summarise_flights(plan, flown))


def test_a_run_with_the_key_of_a_method_is_refused(evaluate_tiny, run_copy):
    reseal(run_copy / "run.json", id="static-mmf")
    reseal(run_copy / "policy.json", run="static-mmf")
    assert_is_an_error(evaluate_tiny(run_copy), "static-mmf", "rename")


def test_a_damaged_configuration_is_told_in_one_line(evaluate_tiny, run_copy):
    path = run_copy / "config.json"
    config = json.loads(path.read_text())
    config["network"]["uav_count"] = -1
    path.write_text(json.dumps(config))
    assert_is_an_error(evaluate_tiny(run_copy), "config.json", "sha256")
    checksum = hashlib.sha256(path.read_bytes()).hexdigest()
    reseal(run_copy / "run.json", config_sha256=checksum)
    assert_is_an_error(evaluate_tiny(run_copy), "config.json", "uav_count")


def test_the_policy_of_another_run_is_refused(evaluate_tiny, run_copy):
    reseal(run_copy / "policy.json", run="20200101T000000Z-orchid-s0-abcd")
    assert_is_an_error(evaluate_tiny(run_copy), "20200101T000000Z-orchid-s0-abcd")


def test_an_interrupted_run_is_flown_with_a_note(evaluate_tiny, run_copy):
    reseal(run_copy / "run.json", status="interrupted")
    finished = evaluate_tiny(run_copy, "--methods=static-mmf", "--no-figures")
    assert finished.code == 0
    planned = json.loads((run_copy / "config.json").read_text())["training"]["episodes"]
    done = json.loads((run_copy / "policy.json").read_text())["episodes"]
    assert f"was interrupted after {done} of {planned} episodes" in finished.err


def test_an_interrupted_evaluation_of_an_earlier_version_is_flown_again(
    evaluate_tiny, tmp_path, monkeypatch
):
    def interrupted(*arguments, **keywords):
        raise KeyboardInterrupt

    arguments = ("--methods=static-pf", "--out=out", "--no-figures")
    monkeypatch.setattr(evaluation_files, "write_evaluation", interrupted)
    assert evaluate_tiny(*arguments).code == 130
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path / "work")
    path = tmp_path / "work/out/episodes.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["total_coverage"]), path)
    finished = evaluate_tiny(*arguments)
    assert finished.code == 0
    [note] = [line for line in finished.err.splitlines() if line.startswith("note: ")]
    assert "total_coverage: they are flown again" in note
    assert "total_coverage" in pq.read_table(path).column_names


def test_users_at_fewer_places_than_clusters_are_noted_once_for_each_fleet(evaluate_tiny):
    points = "network.scatter_std_m=0"
    finished = evaluate_tiny(
        *("--methods=static-mmf,loiter-mmf", "--uavs=4,5,6", "--speeds=0,5"),
        *("--set", points, "--no-figures"),
    )
    assert finished.code == 0
    assert [line.split(":")[0] for line in finished.err.splitlines()].count("note") == 2
    for uavs in (5, 6):
        assert finished.err.count(f"the {uavs + 1} clusters of Phase I") == 1


def test_a_released_policy_flies_as_the_same_run_does(evaluate_tiny):
    from studies.reference_policies import REFERENCE

    finished = evaluate_tiny(
        REFERENCE / "orchid-random-init", "--methods=orchid-random-init", "--json", "--no-figures"
    )
    released, run, _ = json.loads(finished.out)["results"]
    assert released["utility"] == run["utility"]


def test_interrupted_before_anything_was_flown_leaves_nothing(evaluate_tiny, tmp_path, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation, "_fly_batch", interrupted)
    assert evaluate_tiny("--methods=static-mmf", "--out=out").code == 130
    assert list((tmp_path / "work").iterdir()) == []
