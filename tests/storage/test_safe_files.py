"""Damaged and hostile files: the same numbers or a clear error, little memory, no code run."""

import ast
import hashlib
import json
import os
import pickle
import random
import shutil
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import safetensors.numpy
import torch

from orchid_uav.agents import load_policy
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.methods import read_policy
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.lock import RunLock
from orchid_uav.experiments.runs.records import RunRecord, read_record
from orchid_uav.experiments.training import loop as training
from orchid_uav.experiments.training.checkpoints import STATE_ERRORS, CheckpointStore
from orchid_uav.experiments.training.state import Training
from orchid_uav.storage.files import read_document, write_json
from orchid_uav.storage.tensors import TensorSpec, read_tensors
from tests.helpers.damage import (
    DAMAGES,
    HOSTILE_TENSORS,
    NASTY_VALUES,
    Payload,
    Target,
    load_json,
    put,
    reseal,
    write_sealed,
    write_sealed_tensors,
)
from tests.helpers.processes import (
    COLUMNS,
    TINY_FLAGS,
    Audience,
    assert_is_an_error,
    fingerprint,
    learned_files,
    record_of,
    tiny_config,
)

resource = pytest.importorskip("resource", reason="limits are POSIX")

CASES = 1000
ROOM = 16 * 2**20
"""Bytes that reading any of these files may take beyond what the process has already."""
HANGING_S = 20.0
STATED_ERRORS = (InputError, OSError, *STATE_ERRORS)
"""What reading may raise. Those of a state are turned into a warning by whoever resumes a run."""

ROOT = Path(__file__).parents[2]
EPISODES = 6
CHECKPOINTS = (6, 4, 2)
POLICY_FILES = ("run.json", "config.json", "policy.json", "policy.safetensors")
STATE_FILES = ("weights.safetensors", "optimizer.safetensors", "worlds.safetensors")
STATE_KEYS = ("learner", "worlds", "callbacks", "generators")
MADDPG_FLAGS = ["--set=maddpg.hidden_sizes=[16,16]", "--set=maddpg.batch_size=16"]
EVALUATION_FLAGS = ["--uavs=2", "--users=20", "--episodes=1", "--methods=static-mmf", "--quiet"]


@dataclass(frozen=True)
class Made:
    """A run that was trained, and the learner that trained it."""

    path: Path
    config: RunConfig
    training: Training

    @property
    def files(self) -> tuple[str, ...]:
        """All that the project reads of a run, those of the policy three times as often."""
        replay = ("replay.safetensors",) if self.config.training.algorithm == "maddpg" else ()
        checkpoint = ("state.json", *STATE_FILES, *replay)
        return (
            *POLICY_FILES * 3,
            "episodes.csv",
            *(f"checkpoints/{episode}/{name}" for episode in CHECKPOINTS for name in checkpoint),
        )

    def copy(self, place: Path, links: bool = False) -> Path:
        """The run in another place, its files being links for whoever writes them anew."""
        ignored = shutil.ignore_patterns(".*")
        return shutil.copytree(
            self.path, place, ignore=ignored, copy_function=os.link if links else shutil.copy2
        )


def make(runs_dir: Path, algorithm: str, seed: int, worlds: int) -> Made:
    """Train a small run with a checkpoint after every second episode."""
    config = tiny_config(
        EPISODES,
        checkpoint__every_episodes=2,
        reset__enabled=True,
        reset__window=2,
        training__algorithm=algorithm,
        training__seed=seed,
        training__worlds=worlds,
        maddpg__hidden_sizes=[16, 16],
        maddpg__batch_size=16,
    )
    run = RunDirectory.create(runs_dir, "lab", config, ["orchid", "train"])
    learners = []

    def noted(*given: Any) -> Training:
        learners.append(Training(*given))
        return learners[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "Training", noted)
        training.train(config, run, Audience())
    return Made(run.path, config, learners[0])


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Iterator[dict[str, list[Made]]]:
    """Two runs of each learner, in one directory."""
    runs_dir = tmp_path_factory.mktemp("made")
    generators = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
    yield {
        algorithm: [make(runs_dir, algorithm, seed, worlds) for seed, worlds in ((0, 1), (1, 2))]
        for algorithm in ("mappo", "maddpg")
    }
    torch.set_rng_state(generators[0])
    np.random.set_state(generators[1])  # noqa: NPY002
    random.setstate(generators[2])


@pytest.fixture
def run(made) -> Made:
    """One of them."""
    return made["mappo"][0]


@pytest.fixture
def copy(run, tmp_path) -> Path:
    """One that may be damaged."""
    return run.copy(tmp_path / "copy")


# What the files say, read without the project's own readers.


def canonical(document: Any) -> str:
    return json.dumps(document, sort_keys=True)


def exact(tensors: dict[str, np.ndarray]) -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    return {
        name: (str(array.dtype), tuple(array.shape), array.tobytes())
        for name, array in tensors.items()
    }


def load_tensors(path: Path) -> dict[str, np.ndarray]:
    return safetensors.numpy.load(path.read_bytes())


def told_by_policy(directory: Path) -> Any:
    record = load_json(directory / "run.json")
    return (
        canonical(load_json(directory / "policy.json")),
        exact(load_tensors(directory / "policy.safetensors")),
        record["id"],
        record["status"] == "completed",
    )


def told_by_checkpoint(directory: Path) -> Any:
    document = load_json(directory / "state.json")
    tensors = {path.stem: exact(load_tensors(path)) for path in directory.glob("*.safetensors")}
    return canonical({key: document[key] for key in STATE_KEYS}), tensors


def told_by_log(path: Path, rows: int) -> Any:
    header, *lines = path.read_text().splitlines()
    assert header.split(",") == COLUMNS
    return [dict(zip(COLUMNS, map(float, line.split(",")), strict=True)) for line in lines[:rows]]


# What is in force when the project has read them.


def read_layers(directory: Path) -> Any:
    policy = read_policy(directory)
    layers = {
        f"actor.{index}.{name}": array
        for index, layer in enumerate(policy.actor.layers)
        for name, array in zip(("weight", "bias"), layer, strict=True)
    }
    tensors = exact(layers | {"log_std": policy.actor.log_std})
    return canonical(policy.actor.description.to_json()), tensors, policy.run, policy.is_complete


def read_checkpoint(directory: Path, run: Made, episode: int) -> Any:
    store = CheckpointStore(directory, run.path.name, len(CHECKPOINTS))
    run.training.restore(store.read(episode, run.training.specs))
    document, tensors = run.training.state()
    return canonical(document), {name: exact(arrays) for name, arrays in tensors.items()}


def read_log(directory: Path, size: int, checksum: str) -> Any:
    reopened = RunDirectory(directory, RunLock(directory), RunRecord.model_construct())
    try:
        return reopened.keep_episodes(size, checksum)
    finally:
        reopened._lock.release()


class Case:
    """A run one of whose files is damaged."""

    def __init__(self, number: int, made: dict[str, list[Made]], folder: Path) -> None:
        chance = random.Random(number)
        self.run, other = chance.sample(made[chance.choice(["mappo", "maddpg"])], 2)
        strangers = chance.choice([runs for runs in made.values() if self.run not in runs])
        self.file = chance.choice(self.run.files)
        often = ("truncate", "flip_a_bit", "insert", "add_space", "write_otherwise", "take_another")
        self.damage = chance.choice([*DAMAGES, *often, *["seal_hostile_content"] * 6])
        self.name = f"case {number}: {self.damage} of {self.file}"
        self.directory = folder / str(number)
        self.marker = folder / f"{number} was run"
        self.episode, self.rows = None, chance.choice(CHECKPOINTS)
        others = [other.path / self.file, strangers[0].path / self.file]
        if self.file.startswith("checkpoints"):
            self.episode = int(self.file.split("/")[1])
            name = self.file.rpartition("/")[2]
            others += [
                self.run.path / "checkpoints" / str(episode) / name
                for episode in set(CHECKPOINTS) - {self.episode}
            ]
        others += [self.run.path / name for name in self.run.files if name != self.file]
        existing = [path for path in others if path.is_file()]
        target = Target(self.directory / self.file, chance, self.marker, existing)
        self.run.copy(self.directory, links=True)
        DAMAGES[self.damage](target)

    def state(self) -> Any:
        return load_json(self.run.path / "checkpoints" / str(self.rows) / "state.json")

    def told(self, directory: Path) -> Any:
        """What the files say."""
        if self.file == "episodes.csv":
            return told_by_log(directory / self.file, self.rows)
        if self.episode is not None:
            return told_by_checkpoint(directory / "checkpoints" / str(self.episode))
        return told_by_policy(directory)

    def read(self) -> Any:
        """What is in force."""
        if self.file == "episodes.csv":
            state = self.state()
            return read_log(self.directory, state["log_size"], state["log_sha256"])
        if self.episode is not None:
            return read_checkpoint(self.directory, self.run, self.episode)
        return read_layers(self.directory)

    def outcome(self) -> Any:
        """What is in force, or the error: within memory and time, and without code being run."""
        with no_hanging(), no_code_run(), little_memory():
            try:
                return self.read()
            except STATED_ERRORS as error:
                return error

    def is_harmless(self) -> bool:
        """Whether all of the files say what they said, judged without the project."""
        folder = Path(self.file).parent
        return all(
            self._says_the_same(folder / path.name)
            for path in (self.run.path / folder).iterdir()
            if path.is_file() and not path.name.startswith((".", "events"))
        )

    def _says_the_same(self, file: Path) -> bool:
        path, original = self.directory / file, self.run.path / file
        if not path.is_file() or path.stat().st_size > 2**24:
            return False
        content, before = path.read_bytes(), original.read_bytes()
        if file.name == "episodes.csv" and self.file == "episodes.csv":
            size = self.state()["log_size"]
            return content[:size] == before[:size]
        if file.suffix == ".json" and file.name != "config.json":
            try:
                return canonical(json.loads(content)) == canonical(json.loads(before))
            except (ValueError, RecursionError):
                return False
        return content == before


@contextmanager
def little_memory() -> Iterator[None]:
    """Nothing can take more than ROOM."""
    pages = Path("/proc/self/statm")
    if not pages.is_file():
        yield
        return
    used = int(pages.read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


class HangingError(BaseException):
    """Reading has not come to an end."""


@contextmanager
def no_hanging() -> Iterator[None]:
    def give_up(number: int, frame: Any) -> None:
        raise HangingError

    previous = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, HANGING_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


_CODE_EVENTS = {
    *("exec", "compile", "import", "marshal.loads", "marshal.load", "pickle.find_class"),
    *("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "ctypes.dlopen"),
}
_watched: set[str] = set()


def _caller() -> str:
    """The module that called a function of this one."""
    frame = sys._getframe(1)
    while frame.f_back and frame.f_globals["__name__"] == __name__:
        frame = frame.f_back
    return str(frame.f_globals["__name__"])


@cache
def _audited() -> list[str]:
    """Where an audit hook, which Python never takes off again, notes the events in _watched."""
    noted: list[str] = []

    def note(event: str, arguments: Any) -> None:
        if event in _watched:
            noted.append(f"{event} {arguments} in {_caller()}")

    sys.addaudithook(note)
    return noted


@contextmanager
def watching(events: set[str]) -> Iterator[list[str]]:
    """Gives what happens of some of Python's audit events."""
    noted = _audited()
    noted.clear()
    _watched.update(events)
    try:
        yield noted
    finally:
        _watched.clear()


@contextmanager
def no_code_run() -> Iterator[None]:
    with watching(_CODE_EVENTS) as noted:
        yield
    assert noted == [], noted


def test_a_thousand_damaged_and_hostile_files_are_refused_or_read_as_they_are(made, tmp_path):
    for run in (one for runs in made.values() for one in runs):  # whatever is imported late
        read_layers(run.path)
        read_checkpoint(run.path, run, EPISODES)
    found: Counter[str] = Counter()
    problems = []
    for number in range(CASES):
        case = Case(number, made, tmp_path)
        outcome = case.outcome()
        is_harmless = case.is_harmless()
        # All files of another run make up that run, all of another checkpoint do not.
        is_whole = case.damage == "seal_hostile_content" or (
            case.damage == "take_all_of_another_folder" and case.episode is None
        )
        found[case.damage] += 1
        if isinstance(outcome, Exception):
            found["refused"] += 1
            if is_harmless:
                problems.append(f"{case.name}: refused for nothing: {outcome}")
            if len(str(outcome).splitlines()) not in (1, 2):
                problems.append(f"{case.name}: {outcome}")
        elif is_harmless:
            found["read as before"] += 1
            if not outcome == case.told(case.run.path) == case.told(case.directory):
                problems.append(f"{case.name}: other numbers than before")
        elif is_whole:
            found["read as it is"] += 1
            if outcome != case.told(case.directory):
                problems.append(f"{case.name}: other numbers than in the file")
        else:
            problems.append(f"{case.name}: not noticed")
        if case.marker.exists():
            problems.append(f"{case.name}: code was run")
        shutil.rmtree(case.directory)
    assert not problems, "\n".join(problems)
    assert found["refused"] + found["read as before"] + found["read as it is"] == CASES
    assert set(DAMAGES) < set(found), "every kind of damage was done"
    assert found["refused"] > 750
    assert found["read as before"] > 50


def test_the_limit_on_memory_of_these_tests_binds():
    if not Path("/proc/self/statm").is_file():
        pytest.skip("no /proc")
    with pytest.raises(MemoryError), little_memory():
        bytearray(100 * ROOM)  # more than earlier tests can have left free


class TestSwapped:
    """Whole files, in the wrong place."""

    def test_policy_of_another_run_is_refused(self, made, copy):
        for name in ("policy.json", "policy.safetensors"):
            put(copy / name, (made["mappo"][1].path / name).read_bytes())
        with pytest.raises(InputError, match=f"that of run {made['mappo'][1].path.name}"):
            read_policy(copy)

    @pytest.mark.parametrize(("number", "episode"), [(0, 4), (0, 2), (1, 6)])
    def test_checkpoint_of_another_run_or_episode_is_refused(
        self, made, run, copy, number, episode
    ):
        folder = copy / "checkpoints" / "6"
        shutil.rmtree(folder)
        shutil.copytree(made["mappo"][number].path / "checkpoints" / str(episode), folder)
        with pytest.raises(InputError, match=f"is checkpoint {episode} of run"):
            read_checkpoint(copy, run, 6)


class TestSealedByOneWhoKnows:
    """Seals and checksums are right: what is in the files is not."""

    @pytest.mark.parametrize("algorithm", ["mappo", "maddpg"])
    def test_a_state_is_refused_or_in_force_just_as_it_says(self, made, tmp_path, algorithm):
        run = made[algorithm][1]
        directory = run.copy(tmp_path / "copy")
        state = directory / "checkpoints" / "6" / "state.json"
        original, tried, problems = load_json(state), Counter(), []
        for path in places_in({key: original[key] for key in STATE_KEYS}):
            for value in (..., *random.Random(str(path)).sample(NASTY_VALUES, 6)):
                write_sealed(state, changed(original, path, value))
                try:
                    outcome = read_checkpoint(directory, run, 6)
                except STATED_ERRORS:
                    tried["refused"] += 1
                else:
                    tried["in force"] += 1
                    if outcome != told_by_checkpoint(state.parent):
                        problems.append(f"{path} = {value!r:.40}: something else is in force")
        assert not problems, "\n".join(problems)
        assert tried["refused"] > 200
        assert tried["in force"] > 5

    @pytest.mark.parametrize(
        "file", ["policy.safetensors", *(f"checkpoints/6/{name}" for name in STATE_FILES)]
    )
    @pytest.mark.parametrize("hostile", HOSTILE_TENSORS)
    def test_a_file_of_tensors_is_refused_that(self, run, copy, file, hostile):
        path = copy / file
        write_sealed_tensors(path, HOSTILE_TENSORS[hostile](path.read_bytes()))
        with (
            no_hanging(),
            little_memory(),
            pytest.raises((InputError, ValueError), match=path.name) as error,
        ):
            load_policy(copy) if path.parent == copy else read_checkpoint(copy, run, 6)
        assert len(str(error.value).splitlines()) == 1

    def test_tensors_are_read_where_the_file_says_the_same_in_another_way(self, copy):
        path = copy / "policy.safetensors"
        before = read_layers(copy)
        tensors = dict(sorted(load_tensors(path).items(), key=lambda item: item[1].size))
        content = safetensors.numpy.save(tensors, metadata={"made": "elsewhere"})
        assert content != path.read_bytes()
        write_sealed_tensors(path, content)
        assert read_layers(copy)[1:] == before[1:]

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            *((name, np.nan) for name in ("actor.0.weight", "actor.2.bias", "log_std")),
            *((name, np.inf) for name in ("actor.0.bias", "actor.1.weight", "log_std")),
            *((name, -np.inf) for name in ("actor.1.weight", "log_std")),
            # The next layer would add +inf and -inf, or the noise be infinite.
            *(("actor.0.weight", 3e38), ("actor.1.weight", -3e38), ("log_std", 1e3)),
        ],
    )
    def test_weights_are_refused_whose_actions_would_be_no_numbers(self, copy, name, value):
        path = copy / "policy.safetensors"
        tensors = load_tensors(path)
        tensors[name].flat[-1] = value
        write_sealed_tensors(path, safetensors.numpy.save(tensors))
        with pytest.raises(ValueError, match=r"policy\.safetensors holds numbers"):
            load_policy(copy)

    @pytest.mark.parametrize("value", [-1e30, -1.0, 5.0])
    def test_weights_are_read_whose_actions_are_numbers(self, copy, value):
        path = copy / "policy.safetensors"
        tensors = load_tensors(path) | {"log_std": np.full(4, value, np.float32)}
        tensors["actor.0.weight"][:] = 1e6
        write_sealed_tensors(path, safetensors.numpy.save(tensors))
        assert np.isfinite(load_policy(copy).act(np.full((3, 16), 1e3))).all()

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            # The compiled step takes slots and associations for indices, unchecked.
            *(("slot", -1), ("slot", 11), ("slot", 2**62)),
            *(("association", -2), ("association", 2), ("association", 2**62)),
            *(("loads", 21), ("loads", 2**62)),
            *(("users_m", -1.0), ("users_m", 2001.0), ("users_m", -1e9), ("users_m", 1e300)),
            *((name, value) for name in ("users_m", "positions_m") for value in (np.nan, np.inf)),
        ],
    )
    def test_worlds_are_refused_that_cannot_be(self, run, copy, name, value):
        path = copy / "checkpoints" / "6" / "worlds.safetensors"
        tensors = load_tensors(path)
        tensors[name].flat[0] = value
        write_sealed_tensors(path, safetensors.numpy.save(tensors))
        with pytest.raises((InputError, ValueError)):
            read_checkpoint(copy, run, 6)

    @pytest.mark.parametrize("position", [-1, 625, 10**6, 10**12, True, None, "1"])
    def test_a_generator_is_refused_that_would_read_beyond_its_numbers(self, run, copy, position):
        state = copy / "checkpoints" / "6" / "state.json"
        place = ("generators", "numpy", 2)
        assert 0 <= load_json(state)["generators"]["numpy"][2] <= 624
        write_sealed(state, changed(load_json(state), place, position))
        with pytest.raises(STATED_ERRORS):
            read_checkpoint(copy, run, 6)
        np.random.random_sample(700)  # noqa: NPY002 - from where it stands now

    @pytest.mark.parametrize(
        "sizes",
        [
            *([16, 10**9, 4], [16, 10**30, 4], [16, 65536, 65536, 4], [16, *[65536] * 62, 4]),
            *([16, True, 4], [16, 16.0, 4], [16, -16, 4], [16, 0, 4], [16], [16] * 100),
            *({"16": 0, "4": 1}, "16", None),
        ],
    )
    def test_a_policy_of_absurd_size_is_refused_before_its_weights_are_read(self, copy, sizes):
        reseal(copy / "policy.json", layer_sizes=sizes)
        os.truncate(copy / "policy.safetensors", 2**42)
        with no_hanging(), little_memory(), pytest.raises(ValueError, match=r"policy\.json"):
            load_policy(copy)

    @pytest.mark.parametrize("place", [(99_999, False), (0, True), (-1, True), (2**70, True)])
    def test_a_replay_of_absurd_size_is_refused_before_memory_is_taken(self, made, tmp_path, place):
        run = made["maddpg"][0]
        folder = run.copy(tmp_path / "copy") / "checkpoints" / "6"
        replay = dict(zip(("pos", "full"), place, strict=True))
        document = changed(load_json(folder / "state.json"), ("learner", "replay"), replay)
        write_sealed(folder / "state.json", document)
        with no_hanging(), little_memory(), pytest.raises(InputError):
            read_checkpoint(tmp_path / "copy", run, 6)

    @pytest.mark.parametrize("size", [True, -1, 1.5, "7", None, [1], 10**15, 2**70])
    def test_a_log_of_absurd_size_is_refused(self, copy, size):
        content = (copy / "episodes.csv").read_bytes()
        checksum = hashlib.sha256(content).hexdigest()
        with no_hanging(), little_memory(), pytest.raises(ValueError, match=r"size|written"):
            read_log(copy, size, checksum)
        assert (copy / "episodes.csv").read_bytes() == content

    @pytest.mark.parametrize(
        "change",
        [
            lambda lines: lines[:2] + lines[3:],
            lambda lines: [lines[0], *lines[:0:-1]],
            lambda lines: [lines[0].replace("reward", "rewards"), *lines[1:]],
            lambda lines: [*lines[:-1], lines[-1] + ",1"],
            lambda lines: [*lines[:-1], lines[-1].rpartition(",")[0]],
            lambda lines: [*lines[:-1], lines[-1].replace("0.", "zero.", 1)],
            lambda lines: [*lines[:-1], "9" * 200_000],
            lambda lines: [*lines[:-1], "\0"],
            lambda lines: [""],
        ],
    )
    def test_a_log_of_something_else_is_refused(self, copy, change):
        path = copy / "episodes.csv"
        lines = change(path.read_text().splitlines())
        put(path, "".join(f"{line}\n" for line in lines).encode())
        content = path.read_bytes()
        with pytest.raises(ValueError):
            read_log(copy, len(content), hashlib.sha256(content).hexdigest())
        assert path.read_bytes() == content

    def test_a_record_is_refused_that_lacks_something_or_holds_something_else(self, copy):
        path = copy / "run.json"
        original = load_json(path)
        wrong = {
            **dict.fromkeys(("id", "name", "started", "config_sha256"), (7, None, [], {})),
            "status": (7, None, "odd", "died", ["completed"]),
            **dict.fromkeys(("command", "reset_episodes", "resumed"), (7, None, "[]", {})),
            **dict.fromkeys(("versions", "host", "final"), (7, None, "{}", [])),
            **dict.fromkeys(("seconds", "episodes"), ("7", None, [], {})),
            **dict.fromkeys(("finished", "error"), (7, [], {})),
            "pid": ("1", 1.5, []),
        }
        for key, values in wrong.items():
            missing = () if key == "pid" else (...,)  # of released policies nobody knows it
            for value in (*missing, *values):
                write_sealed(path, changed(original, (key,), value))
                with pytest.raises(InputError, match=r"run\.json is not the record of") as error:
                    read_record(copy)
                assert len(str(error.value).splitlines()) == 1
        write_sealed(path, original)
        assert read_record(copy).to_json() == original


def places_in(document: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where in a document something could be changed; of a list only its first element."""
    if path:
        yield path
    if isinstance(document, dict):
        for key, value in document.items():
            yield from places_in(value, (*path, key))
    elif isinstance(document, list) and document:
        yield from places_in(document[0], (*path, 0))


def changed(document: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A copy with another value at a place or, with ``...``, none."""
    made = json.loads(json.dumps(document))
    inner = made
    for key in path[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return made


class TestDocuments:
    @pytest.mark.parametrize(
        ("content", "part"),
        [
            (b'{"a": NaN}', "NaN"),
            (b'{"a": [-Infinity]}', "Infinity"),
            (b'{"a": [{"b": 1e999}]}', "too large"),
            (b'{"a": -1e999}', "too large"),
            (b'{"a": "\\ud800"}', "surrogate"),
            (b'{"\\udfff": 1}', "surrogate"),
            (b'{"a": ' + b"[" * 40 + b"]" * 40 + b"}", "nested"),
            (b'{"a": ' + b"[" * 10**5 + b"}", "recursion|Stack overflow"),
            (b'{"a": ' + b"9" * 10**5 + b"}", "digits"),
            (b'{"a": 1} {}', "Extra data"),
            (b"[]", "not a JSON object"),
            (b"7", "not a JSON object"),
            (b'\xff{"a": 1}', "utf-8"),
            (b"", "Expecting value"),
        ],
    )
    def test_are_refused_in_a_line_if_json_or_python_cannot_hold_them(
        self, tmp_path, content, part
    ):
        path = tmp_path / "a.json"
        path.write_bytes(content)
        with pytest.raises(ValueError, match=part) as error:
            read_document(path)
        assert str(path) in str(error.value)
        assert len(str(error.value).splitlines()) == 1

    @pytest.mark.parametrize(
        "document",
        [{}, {"a": [[[[1.5, None, True, "²", "\U0001f681"]]]]}, {"a": 10**300, "b": -1e308}],
    )
    def test_are_read_as_they_are_otherwise(self, tmp_path, document):
        path = tmp_path / "a.json"
        for text in (json.dumps(document), json.dumps(document, ensure_ascii=False, indent=1)):
            path.write_text(text, encoding="utf-8")
            assert read_document(path) == document

    def test_are_not_read_if_they_are_too_large(self, tmp_path):
        path = tmp_path / "a.json"
        path.write_bytes(b'{"a": 1}')
        os.truncate(path, 2**40)
        with no_hanging(), little_memory(), pytest.raises(ValueError, match="1,099,511,627,776"):
            read_document(path)

    def test_take_the_memory_of_what_is_there_not_of_what_may_be(self, tmp_path):
        path = tmp_path / "a.json"
        path.write_bytes(b'{"a": 1}')
        with little_memory():
            assert read_document(path, largest=2**40) == {"a": 1}

    @pytest.mark.parametrize("length", [1, 10_000])
    def test_are_read_whole_if_another_process_replaces_them_meanwhile(
        self, tmp_path, monkeypatch, length
    ):
        path = tmp_path / "a.json"
        path.write_text(json.dumps({"former": "x" * 100}), encoding="utf-8")
        replacement = {"new": "y" * length}
        open_path = Path.open

        def open_what_has_been_replaced(self, *arguments, **keywords):
            write_json(self, replacement)
            return open_path(self, *arguments, **keywords)

        monkeypatch.setattr(Path, "open", open_what_has_been_replaced)
        assert read_document(path) == replacement


def test_tensors_of_all_kinds_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "a.safetensors"
    chance = np.random.default_rng(0)
    tensors = {
        f"{kind.__name__} of {shape}": np.asarray(200 * chance.random(shape)).astype(kind)
        for kind in (np.bool_, np.uint8, np.int64, np.uint64, np.float32, np.float64)
        for shape in ((), (0,), (3,), (2, 0, 4), (2, 3, 4))
    }
    path.write_bytes(safetensors.numpy.save(tensors))
    checksum = hashlib.sha256(path.read_bytes()).hexdigest()
    wanted = {name: TensorSpec.of(array) for name, array in tensors.items()}
    assert exact(read_tensors(path, wanted, checksum)) == exact(tensors)


def refusing(load: Callable[..., Any]) -> Callable[..., Any]:
    """A loader for numba alone, which keeps compiled code as pickles beside the sources."""

    def refuse(*arguments: Any, **options: Any) -> Any:
        assert _caller().startswith("numba."), f"{_caller()} unpickles"
        return load(*arguments, **options)

    return refuse


class TestNoCode:
    LOADERS = {
        *("torch.load", "np.load", "numpy.load", "MAPPO.load", "MADDPG.load", "PPO.load"),
        *("BaseAlgorithm.load", "policy.load", "model.load", "marshal.loads", "marshal.load"),
        *("pd.read_pickle", "eval", "exec", "runpy.run_path", "yaml.load", "shelve.open"),
    }
    NAMED_BY_THE_USER: ClassVar = {"own_methods.py": {"exec"}}
    """A file that the command line names is run; tests/experiments/test_own_methods.py sees that
    nothing else is."""
    MODULES = {
        *("pickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal"),
        *("copyreg", "jsonpickle", "yaml", "runpy", "imp"),
    }

    def test_can_be_run_by_a_source_that_reads_files(self):
        seen = 0
        for folder in ("agents", "callbacks", "envs", "experiments", "orchid_cli", "src"):
            for path in (ROOT / folder).rglob("*.py"):
                seen += 1
                for node in ast.walk(ast.parse(path.read_text())):
                    names = []
                    if isinstance(node, ast.Call):
                        loaders = self.LOADERS - self.NAMED_BY_THE_USER.get(path.name, set())
                        assert ast.unparse(node.func) not in loaders, f"{path}:{node.lineno}"
                        keywords = {keyword.arg for keyword in node.keywords}
                        assert "allow_pickle" not in keywords, f"{path}:{node.lineno}"
                    elif isinstance(node, ast.Import):
                        names = [alias.name for alias in node.names]
                    elif isinstance(node, ast.ImportFrom):
                        names = [node.module or ""]
                    roots = {name.split(".")[0] for name in names}
                    assert not roots & self.MODULES, f"{path}:{node.lineno}"
        assert seen > 80

    def test_is_unpickled_while_a_run_is_trained_extended_and_evaluated(
        self, orchid, runs_dir, new_runs, tmp_path, monkeypatch
    ):
        for owner, name in ((pickle, "load"), (pickle, "loads"), (torch, "load"), (np, "load")):
            monkeypatch.setattr(owner, name, refusing(getattr(owner, name)))
        seen = set(new_runs())
        with watching({"pickle.find_class"}) as noted:
            for learner in ([], ["--algorithm=maddpg", *MADDPG_FLAGS]):
                given = [*TINY_FLAGS, *learner, "--episodes=3", "--runs-dir", runs_dir, "--quiet"]
                assert orchid("train", *given).code == 0
                [run] = set(new_runs()) - seen
                seen.add(run)
                extended = orchid("train", "--resume", run, "--episodes", 5, "--quiet")
                assert extended.code == 0, extended.err
                assert len((run / "episodes.csv").read_text().splitlines()) == 6
            flown = orchid("eval", *new_runs(), *EVALUATION_FLAGS, "--out", tmp_path / "out")
            assert flown.code == 0, flown.err
        assert [event for event in noted if " in numba." not in event] == []

    def test_of_a_pickle_is_run_under_any_name(self, made, orchid, tmp_path):
        run = made["maddpg"][0]
        marker = tmp_path / "code was run"
        strange = ("policy.pkl", "policy.pt", "replay_buffer.pkl", "model.zip", "checkpoints/7/a")
        replay = "checkpoints/6/replay.safetensors"
        for name in {*POLICY_FILES, "episodes.csv", "checkpoints/6/state.json", replay, *strange}:
            copy = run.copy(tmp_path / "copies" / name.replace("/", "-"))
            (copy / name).parent.mkdir(exist_ok=True)
            (copy / name).write_bytes(pickle.dumps(Payload(marker)))
            if name in POLICY_FILES:
                with pytest.raises(InputError):
                    read_policy(copy)
            else:
                assert read_layers(copy) == read_layers(run.path)
            resumed = orchid("train", "--resume", copy, "--episodes", EPISODES + 1, "--quiet")
            assert resumed.code in (0, 1, 2)
            assert "Traceback" not in resumed.err
            assert not marker.exists(), name
        assert pickle.loads(pickle.dumps(Payload(marker))) is None
        assert marker.exists(), "a payload that does nothing would prove nothing"


@pytest.mark.usefixtures("made")
class TestCommands:
    """The same at the interface that users see."""

    def damage(self, copy: Path, file: str, damage: str) -> None:
        chance = random.Random(f"{file} {damage}")
        DAMAGES[damage](Target(copy / file, chance, copy / "code was run"))

    def resume(self, orchid: Callable[..., Any], copy: Path, *more: Any) -> Any:
        with no_hanging():
            return orchid("train", "--resume", copy, "--quiet", *more)

    @pytest.mark.parametrize("file", POLICY_FILES)
    @pytest.mark.parametrize(
        "damage", ["truncate", "flip_a_bit", "make_pipe", "link_to_itself", "empty", "put_a_pickle"]
    )
    def test_eval_tells_in_two_lines_what_is_damaged(self, copy, orchid, tmp_path, file, damage):
        self.damage(copy, file, damage)
        with no_hanging():
            finished = orchid("eval", copy, *EVALUATION_FLAGS, "--out", tmp_path / "out")
        assert_is_an_error(finished, file, code=2)
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize("file", ["run.json", "config.json"])
    @pytest.mark.parametrize("damage", ["truncate", "flip_a_bit", "make_pipe", "make_folder"])
    def test_resume_tells_in_two_lines_what_is_damaged_and_changes_nothing(
        self, copy, orchid, file, damage
    ):
        self.damage(copy, file, damage)
        before = fingerprint(copy)
        assert_is_an_error(self.resume(orchid, copy, "--episodes", 9), file, code=2)
        assert fingerprint(copy) == before

    @pytest.mark.parametrize("file", ["state.json", "weights.safetensors", "worlds.safetensors"])
    @pytest.mark.parametrize("damage", ["truncate", "zero", "make_pipe", "make_folder", "remove"])
    def test_resume_takes_the_checkpoint_before_a_damaged_one_and_says_so(
        self, run, copy, orchid, file, damage
    ):
        self.damage(copy, f"checkpoints/6/{file}", damage)
        reseal(copy / "run.json", status="interrupted", episodes=5)
        finished = self.resume(orchid, copy)
        assert finished.code == 0, finished.err
        note, warning = finished.err.splitlines()
        assert note.startswith("note: ") and "copy" in note  # the directory has another name
        assert warning.startswith("warning: checkpoint 6 cannot be used: ")
        assert learned_files(copy) == learned_files(run.path)

    @pytest.mark.parametrize("damage", ["truncate", "flip_a_bit", "remove", "make_pipe"])
    def test_resume_with_a_damaged_log_tells_why_and_keeps_what_is_there(
        self, copy, orchid, damage
    ):
        log = copy / "episodes.csv"
        whole = log.read_bytes()
        log.write_bytes(whole[:300])  # so that the damage is within the first checkpoint's part
        self.damage(copy, "episodes.csv", damage)
        if log.is_file():
            log.write_bytes(log.read_bytes() + whole[300:])
        reseal(copy / "run.json", status="interrupted", episodes=6)
        before = fingerprint(copy / "checkpoints"), (copy / "policy.safetensors").read_bytes()
        finished = self.resume(orchid, copy)
        assert finished.code == 1
        told = [line for line in finished.err.splitlines() if line.startswith("warning: ")]
        assert [line.split()[2] for line in told] == ["6", "4", "2"]
        assert all("episodes.csv" in line for line in told)
        assert "error: " in finished.err
        assert "none of the checkpoints can be used" in finished.err
        after = fingerprint(copy / "checkpoints"), (copy / "policy.safetensors").read_bytes()
        assert after == before
        assert (record_of(copy)["status"], record_of(copy)["episodes"]) == ("failed", 6)

    @pytest.mark.parametrize("link", [".reserve", ".lock", "run.json", "checkpoints/.7.new"])
    def test_resume_writes_through_no_link(self, copy, orchid, tmp_path, link):
        precious = tmp_path / "precious"
        precious.write_text("mine\n")
        (copy / link).unlink(missing_ok=True)
        (copy / link).symlink_to(precious)
        finished = self.resume(orchid, copy, "--episodes", 7)
        assert precious.read_text() == "mine\n"
        assert "Traceback" not in finished.err

    def test_resume_removes_nothing_behind_a_link(self, copy, orchid, tmp_path):
        elsewhere = tmp_path / "elsewhere"
        (copy / "checkpoints").rename(elsewhere)
        for name in (".ssh", ".5.new", "9"):
            (elsewhere / name).mkdir()
            (elsewhere / name / "key").write_text("mine\n")
        (copy / "checkpoints").symlink_to(elsewhere)
        before = fingerprint(elsewhere)
        finished = self.resume(orchid, copy, "--episodes", 7)
        assert fingerprint(elsewhere) == before
        assert finished.code in (1, 2)
        assert "Traceback" not in finished.err

    def test_resume_removes_nothing_that_is_not_its_own(self, copy, orchid):
        notes = copy / "checkpoints" / ".notes" / "a.txt"
        notes.parent.mkdir()
        notes.write_text("mine\n")
        assert self.resume(orchid, copy, "--episodes", 7).code == 0
        assert notes.read_text() == "mine\n"
