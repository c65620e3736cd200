"""Damaged and hostile files: the same numbers or a clear error, little memory, no code run."""

import ast
import hashlib
import json
import os
import pickle
import random
import resource
import shutil
import signal
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
import torch

from orchid_uav.agents import load_policy
from orchid_uav.agents.safe_files import TensorKind, read_document, read_tensors, sealed
from orchid_uav.experiments import training
from orchid_uav.experiments.checkpoints import CheckpointStore
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.methods import read_run
from orchid_uav.experiments.run_directory import RunDirectory
from orchid_uav.experiments.run_lock import RunLock
from orchid_uav.experiments.training_state import Training
from tests.running import (
    COLUMNS,
    TINY_FLAGS,
    WHOLE_NUMBERS,
    Audience,
    assert_is_an_error,
    fingerprint,
    learned_files,
    record_of,
    tiny_config,
)

CASES = 1000
ROOM = 16 * 2**20
"""Bytes that reading any of these files may take beyond what the process has already."""
HANGING_S = 20.0

POLICY_FILES = ("run.json", "config.json", "policy.json", "policy.safetensors")
EPISODES = 6
CHECKPOINTS = (6, 4, 2)
STATE_KEYS = ("learner", "worlds", "callbacks", "generators")

Write = Callable[[Path, bytes, random.Random, "Case"], None]


@dataclass(frozen=True)
class Made:
    """A run that was trained, and the learner that trained it."""

    path: Path
    config: RunConfig
    training: Training

    @property
    def tensor_files(self) -> tuple[str, ...]:
        """Of a checkpoint."""
        replay = ("replay",) if self.config.training.algorithm == "maddpg" else ()
        return tuple(f"{name}.safetensors" for name in ("weights", "optimizer", "worlds", *replay))

    @property
    def files(self) -> tuple[str, ...]:
        """All that the project reads of a run, the policy's twice as often."""
        checkpoint = ("state.json", *self.tensor_files)
        return (
            *POLICY_FILES,
            *POLICY_FILES,
            "episodes.csv",
            *(f"checkpoints/{episode}/{name}" for episode in CHECKPOINTS for name in checkpoint),
        )


def make(runs_dir: Path, **values: Any) -> Made:
    """Train a small run with a checkpoint after every second episode."""
    config = tiny_config(EPISODES, checkpoint__every_episodes=2, reset__window=2, **values)
    run = RunDirectory.create(runs_dir, "lab", config, ["orchid", "train"])
    learners = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "Training", lambda *given: keep(learners, Training(*given)))
        training.train(config, run, Audience())
    return Made(run.path, config, learners[0])


def keep(kept: list[Any], one: Any) -> Any:
    kept.append(one)
    return one


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Iterator[dict[str, list[Made]]]:
    """Two runs of each learner, in one directory."""
    runs_dir = tmp_path_factory.mktemp("made")
    small = {"maddpg__hidden_sizes": [16, 16], "maddpg__batch_size": 16}
    before = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
    yield {
        algorithm: [
            make(
                runs_dir,
                training__algorithm=algorithm,
                training__seed=seed,
                training__worlds=worlds,
                reset__enabled=True,
                **small,
            )
            for seed, worlds in ((0, 1), (1, 2))
        ]
        for algorithm in ("mappo", "maddpg")
    }
    torch.set_rng_state(before[0]), np.random.set_state(before[1])  # noqa: NPY002
    random.setstate(before[2])
    torch.set_flush_denormal(False)


@pytest.fixture(scope="module")
def run(made) -> Made:
    """One of them."""
    return made["mappo"][0]


# What the files say, read without the project's own readers.


def canonical(document: Any) -> str:
    return json.dumps(document, sort_keys=True)


def exact(tensors: dict[str, np.ndarray]) -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    return {
        name: (str(array.dtype), tuple(array.shape), array.tobytes())
        for name, array in tensors.items()
    }


def load_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def told_by_policy_files(directory: Path) -> Any:
    description = load_json(directory / "policy.json")
    tensors = safetensors.numpy.load((directory / "policy.safetensors").read_bytes())
    record = load_json(directory / "run.json")
    return canonical(description), exact(tensors), record["id"], record["status"] == "completed"


def told_by_checkpoint(directory: Path) -> Any:
    document = load_json(directory / "state.json")
    tensors = {
        path.stem: exact(safetensors.numpy.load(path.read_bytes()))
        for path in directory.glob("*.safetensors")
    }
    return canonical({key: document[key] for key in STATE_KEYS}), tensors


def told_by_log(path: Path, rows: int) -> Any:
    header, *lines = path.read_text().splitlines()
    assert header.split(",") == COLUMNS
    return [dict(zip(COLUMNS, map(float, line.split(",")), strict=True)) for line in lines[:rows]]


# What the project reads, and what is then in force.


def read_policy(directory: Path) -> Any:
    policy = read_run(directory)
    layers = {
        f"actor.{index}.{name}": array
        for index, layer in enumerate(policy.actor.layers)
        for name, array in zip(("weight", "bias"), layer, strict=True)
    }
    tensors = exact(layers | {"log_std": policy.actor.log_std})
    return canonical(policy.actor.description), tensors, policy.run, policy.is_complete


def read_checkpoint(directory: Path, run: Made, episode: int) -> Any:
    store = CheckpointStore(directory, run.path.name, len(CHECKPOINTS))
    run.training.restore(store.read(episode, run.training.kinds))
    document, tensors = run.training.state()
    return canonical(document), {name: exact(arrays) for name, arrays in tensors.items()}


def read_log(directory: Path, size: int, checksum: str) -> Any:
    reopened = RunDirectory(directory, {})
    try:
        return reopened.keep_episodes(size, checksum)
    finally:
        reopened._lock.release()


# Damage.


def put(path: Path, content: bytes) -> None:
    """Write a file anew: what is there may be a link to the original."""
    path.unlink()
    path.write_bytes(content)


def place(content: bytes, chance: random.Random) -> int:
    return chance.randrange(len(content))


def truncate(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    put(path, content[: place(content, chance)])


def flip_a_bit(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    changed = bytearray(content)
    changed[place(content, chance)] ^= 1 << chance.randrange(8)
    put(path, bytes(changed))


def insert(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    at = place(content, chance)
    put(path, content[:at] + chance.randbytes(chance.randint(1, 16)) + content[at:])


def cut_out(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    at = place(content, chance)
    put(path, content[:at] + content[at + chance.randint(1, 16) :])


def zero(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    """As after a power cut."""
    at = place(content, chance)
    length = min(chance.randint(1, 4096), len(content) - at)
    put(path, content[:at] + bytes(length) + content[at + length :])


def add_space(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    put(path, content + chance.choice([b" ", b"\n", b"\r\n\t"]))


def write_otherwise(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    """The same document in another order and without line breaks, where it is one."""
    try:
        items = list(json.loads(content).items())
    except ValueError:
        return flip_a_bit(path, content, chance, case)
    chance.shuffle(items)
    put(path, json.dumps(dict(items)).encode())


def take_from_another_run(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    put(path, (case.other.path / case.file).read_bytes())


def take_from_another_learner(
    path: Path, content: bytes, chance: random.Random, case: "Case"
) -> None:
    source = case.stranger.path / case.file
    put(path, source.read_bytes() if source.is_file() else b"")


def take_from_another_checkpoint(
    path: Path, content: bytes, chance: random.Random, case: "Case"
) -> None:
    if case.episode is None:
        return take_from_another_run(path, content, chance, case)
    other = chance.choice([episode for episode in CHECKPOINTS if episode != case.episode])
    put(path, (path.parent.parent / str(other) / path.name).read_bytes())


def take_another_file(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    names = [name for name in case.run.files if name != case.file]
    put(path, (case.run.path / chance.choice(names)).read_bytes())


def take_whole_checkpoint(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    if case.episode is None:
        return take_from_another_run(path, content, chance, case)
    source = chance.choice(
        [case.other.path / "checkpoints" / str(case.episode)]
        + [path.parent.parent / str(other) for other in CHECKPOINTS if other != case.episode]
    )
    for other in sorted(source.iterdir()):
        put(path.parent / other.name, other.read_bytes())


def empty(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    put(path, b"")


def remove(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    path.unlink()


def make_folder(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    path.unlink()
    path.mkdir()


def make_pipe(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    path.unlink()
    os.mkfifo(path)


def link_to_itself(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    path.unlink()
    path.symlink_to(path)


def link_to_zeros(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def make_huge(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    """A terabyte, of which the disk holds next to nothing."""
    put(path, content if chance.random() < 0.5 else b"")
    os.truncate(path, 2**40)


def pickled(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    put(path, pickle.dumps(Payload(case.marker)))


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.marker),)


# JSON that nobody would write.

_ODD_DOCUMENTS = (
    b"[" * 100_000,
    b'{"a":' * 100_000,
    b'{"a": ' + b"[" * 900 + b"]" * 900 + b"}",
    b'{"a": ' + b"9" * 100_000 + b"}",
    b'{"a": NaN}',
    b'{"a": -Infinity}',
    b'{"a": 1e999}',
    b'{"a": "\\ud800"}',
    b"null",
    b"[]",
    b'"text"',
    b"\xef\xbb\xbf{}",
    '{"a": 1}'.encode("utf-16"),
    b"\x80\x81",
    b"{}",
)


def make_odd(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    put(path, chance.choice(_ODD_DOCUMENTS))


def add_odd_value(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    """Numbers and texts that JSON does not have, behind a document's last value."""
    value = chance.choice(
        [b"NaN", b"Infinity", b"1e999", b"9" * 5000, b'"\\udfff"', b"[" * 5000 + b"]" * 5000]
    )
    put(path, content.rstrip().removesuffix(b"}") + b', "odd": ' + value + b"}")


_NASTY_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2**31, 2**63, 10**30, -(10**30), 10**9, 0.5, -0.5, 1e308),
    *("", "x", "1", "nan", "inf", "../..", "a" * 1000, "AAAA", [], [1], ["x"], [[]], {}),
    *({"a": 1}, [10**9] * 3, [1e308] * 4, list(range(1000)), {"0": ["step"]}),
)


def spoil(document: Any, chance: random.Random) -> None:
    """Change a value somewhere in a document."""
    while True:
        keys = list(document) if isinstance(document, dict) else list(range(len(document)))
        keys = [key for key in keys if key not in ("seal", "sha256", "files_sha256")]
        if not keys:
            return
        key = chance.choice(keys)
        if isinstance(document[key], dict | list) and document[key] and chance.random() < 0.9:
            document = document[key]
            continue
        action = chance.random()
        if action < 0.15:
            del document[key]
        elif action < 0.25 and isinstance(document, list):
            document.insert(key, document[key])
        elif action < 0.25:
            document[f"{key}_"] = document.pop(key)
        else:
            document[key] = chance.choice(_NASTY_VALUES)
        return


def seal_hostile_content(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    """What somebody writes who knows of seals and checksums."""
    if path.suffix == ".safetensors":
        return seal_hostile_tensors(path, content, chance, case)
    if path.suffix == ".csv":
        return flip_a_bit(path, content, chance, case)
    document = json.loads(content)
    spoil(document, chance)
    write_sealed(path, document)


def write_sealed(path: Path, document: dict[str, Any]) -> None:
    """A document as the project would write it, with whatever vouches for it."""
    if path.name == "config.json":
        content = json.dumps(document).encode()
        put(path, content)
        checksum = hashlib.sha256(content).hexdigest()
        reseal(path.with_name("run.json"), config_sha256=checksum)
    else:
        put(path, json.dumps(sealed(document)).encode())


def reseal(path: Path, **changes: Any) -> None:
    put(path, json.dumps(sealed(load_json(path) | changes)).encode())


def seal_hostile_tensors(path: Path, content: bytes, chance: random.Random, case: "Case") -> None:
    write_sealed_tensors(path, chance.choice(HOSTILE_TENSORS)(content))


def write_sealed_tensors(path: Path, content: bytes) -> None:
    put(path, content)
    checksum = hashlib.sha256(content).hexdigest()
    if path.name == "policy.safetensors":
        reseal(path.with_suffix(".json"), sha256=checksum)
    else:
        state = path.with_name("state.json")
        reseal(state, files_sha256=load_json(state)["files_sha256"] | {path.stem: checksum})


# Files of tensors that nobody would write: each is made of one that is right.


def split(content: bytes) -> tuple[dict[str, Any], bytes]:
    (length,) = struct.unpack("<Q", content[:8])
    return json.loads(content[8 : 8 + length]), content[8 + length :]


def join(header: Any, data: bytes, length: int | None = None) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + data


def last_tensor(header: dict[str, Any]) -> dict[str, Any]:
    return max(
        (one for name, one in header.items() if name != "__metadata__"),
        key=lambda one: one["data_offsets"],
    )


def changing_header(change: Callable[[dict[str, Any]], Any]) -> Callable[[bytes], bytes]:
    def changed(content: bytes) -> bytes:
        header, data = split(content)
        change(header)
        return join(header, data)

    return changed


def claim_terabytes(header: dict[str, Any]) -> None:
    one = last_tensor(header)
    first = one["data_offsets"][0]
    one |= {"shape": [2**42], "dtype": "U8", "data_offsets": [first, first + 2**42]}


def overflow(header: dict[str, Any]) -> None:
    last_tensor(header)["shape"] = [2**33, 2**33]


def overlap(header: dict[str, Any]) -> None:
    first, *others = (one for name, one in header.items() if name != "__metadata__")
    for one in others:
        one["data_offsets"] = first["data_offsets"]


def run_backwards(header: dict[str, Any]) -> None:
    last_tensor(header)["data_offsets"].reverse()
    last_tensor(header)["data_offsets"][0] += 8


def negate_shape(header: dict[str, Any]) -> None:
    one = last_tensor(header)
    one["shape"] = [-length for length in one["shape"]] or [-1]


def take_other_type(header: dict[str, Any]) -> None:
    one = last_tensor(header)
    same_size = {"F32": "I32", "F64": "I64", "I64": "U64", "U64": "F64", "BOOL": "U8"}
    one["dtype"] = same_size[one["dtype"]]


def take_type_unknown_to_numpy(header: dict[str, Any]) -> None:
    one = last_tensor(header)
    length = one["data_offsets"][1] - one["data_offsets"][0]
    one |= {"dtype": "F8_E4M3", "shape": [length]}


def take_other_shape(header: dict[str, Any]) -> None:
    one = last_tensor(header)
    one["shape"] = [*one["shape"][::-1], 1]


def rename_tensor(header: dict[str, Any]) -> None:
    name = next(name for name in header if name != "__metadata__")
    header[f"{name}_"] = header.pop(name)


def add_tensor(header: dict[str, Any]) -> None:
    end = last_tensor(header)["data_offsets"][1]
    header["more"] = {"dtype": "F32", "shape": [0], "data_offsets": [end, end]}


def add_tensor_without_data(header: dict[str, Any]) -> None:
    header["more"] = {"dtype": "F32", "shape": [2**20], "data_offsets": [2**40, 2**40 + 2**22]}


def remove_tensor(content: bytes) -> bytes:
    tensors = safetensors.numpy.load(content)
    tensors.popitem()
    return safetensors.numpy.save(tensors)


def tell_length(length: int) -> Callable[[bytes], bytes]:
    return lambda content: struct.pack("<Q", length) + content[8:]


def name_twice(content: bytes) -> bytes:
    """The same name with two meanings, the second of them right."""
    header, data = split(content)
    text = json.dumps(header).encode()
    name = next(name for name in header if name != "__metadata__")
    wrong = f'{{{json.dumps(name)}: {{"dtype": "F32", "shape": [1], "data_offsets": [0, 4]}}, '
    return join(wrong.encode() + text[1:], data)


HOSTILE_TENSORS: tuple[Callable[[bytes], bytes], ...] = (
    changing_header(claim_terabytes),
    changing_header(overflow),
    changing_header(overlap),
    changing_header(run_backwards),
    changing_header(negate_shape),
    changing_header(take_other_type),
    changing_header(take_type_unknown_to_numpy),
    changing_header(take_other_shape),
    changing_header(rename_tensor),
    changing_header(add_tensor),
    changing_header(add_tensor_without_data),
    remove_tensor,
    name_twice,
    tell_length(0),
    tell_length(7),
    tell_length(2**20 + 1),
    tell_length(10**8),
    tell_length(2**63),
    tell_length(2**64 - 1),
    lambda content: join(b"[" * 500_000, b""),
    lambda content: join(b'{"a":' * 100_000, b""),
    lambda content: join(b"null", b""),
    lambda content: join(b" " * 10**6, b""),
    lambda content: join({}, b""),
    lambda content: content + b"more",
    lambda content: content[:-1],
    lambda content: content[:8],
    lambda content: b"",
)
"""All of them are refused, although their checksums are right."""

DAMAGES: dict[str, Write] = {
    damage.__name__: damage
    for damage in (
        *(truncate, flip_a_bit, insert, cut_out, zero, empty, remove),
        *(add_space, write_otherwise),
        *(take_from_another_run, take_from_another_learner, take_from_another_checkpoint),
        *(take_another_file, take_whole_checkpoint),
        *(make_folder, make_pipe, link_to_itself, link_to_zeros, make_huge, pickled),
        *(make_odd, add_odd_value, seal_hostile_content),
    )
}
_OFTEN = ("truncate", "flip_a_bit", "insert", "cut_out", *["seal_hostile_content"] * 6)
_NEVER_HARMLESS = set(DAMAGES) - {
    *("add_space", "write_otherwise", "insert", "cut_out", "truncate", "flip_a_bit", "zero"),
    *("seal_hostile_content", "add_odd_value"),
}
_HANDLED_ERRORS = (InputError, ValueError, OSError)


@dataclass
class Case:
    """A copy of a run, one of whose files is damaged."""

    number: int
    run: Made
    other: Made
    stranger: Made
    directory: Path
    marker: Path
    file: str = ""
    damage: str = ""

    @property
    def episode(self) -> int | None:
        """Of the checkpoint whose file is damaged."""
        parts = self.file.split("/")
        return int(parts[1]) if parts[0] == "checkpoints" else None

    def prepare(self, chance: random.Random) -> None:
        """Copy the run and damage a file."""
        shutil.copytree(
            self.run.path,
            self.directory,
            copy_function=os.link,
            ignore=shutil.ignore_patterns(".*"),
        )
        self.file = chance.choice(self.run.files)
        self.damage = chance.choice([*DAMAGES, *_OFTEN])
        path = self.directory / self.file
        DAMAGES[self.damage](path, path.read_bytes(), chance, self)

    def told(self, directory: Path) -> Any:
        """What the files say, None if they cannot be read."""
        try:
            if self.file == "episodes.csv":
                return told_by_log(directory / self.file, self.rows)
            if self.episode is not None:
                return told_by_checkpoint(directory / "checkpoints" / str(self.episode))
            return told_by_policy_files(directory)
        except Exception:
            return None

    @property
    def rows(self) -> int:
        return CHECKPOINTS[self.number % len(CHECKPOINTS)]

    def read(self) -> Any:
        """What the project reads from them."""
        if self.file == "episodes.csv":
            state = load_json(self.run.path / "checkpoints" / str(self.rows) / "state.json")
            return read_log(self.directory, state["log_size"], state["log_sha256"])
        if self.episode is not None:
            return read_checkpoint(self.directory, self.run, self.episode)
        return read_policy(self.directory)

    def is_harmless(self) -> bool:
        """Whether the damaged file still says what it said, judged without the project."""
        path, original = self.directory / self.file, self.run.path / self.file
        if not path.is_file() or path.stat().st_size > 2**24:
            return False
        content, before = path.read_bytes(), original.read_bytes()
        if self.file == "episodes.csv":
            state = load_json(self.run.path / "checkpoints" / str(self.rows) / "state.json")
            size = state["log_size"]
            return content[:size] == before[:size]
        if path.suffix == ".json" and path.name != "config.json":
            try:
                return canonical(json.loads(content)) == canonical(json.loads(before))
            except ValueError:
                return False
        return content == before

    def __str__(self) -> str:
        return f"case {self.number}: {self.damage} of {self.file} of {self.run.path.name}"


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


@cache
def code_events() -> list[str]:
    """Where an audit hook, which Python never takes off again, notes what runs other code."""
    noted: list[str] = []

    def note(event: str, arguments: Any) -> None:
        if _is_watching and event in _CODE_EVENTS:
            noted.append(f"{event} {arguments}")

    sys.addaudithook(note)
    return noted


_is_watching = False


@contextmanager
def no_code_run() -> Iterator[None]:
    global _is_watching  # noqa: PLW0603 - the hook outlives the test
    noted = code_events()
    noted.clear()
    _is_watching = True
    try:
        yield
    finally:
        _is_watching = False
    assert noted == []


def outcome_of(case: Case) -> Any:
    """What is read, or the error: within memory and time, and without any code being run."""
    with no_hanging(), no_code_run(), little_memory():
        try:
            return case.read()
        except _HANDLED_ERRORS as error:
            return error


def test_a_thousand_damaged_and_hostile_files_are_refused_or_read_as_they_are(made, tmp_path):
    for runs in made.values():  # whatever is imported late
        for one in runs:
            read_policy(one.path), read_checkpoint(one.path, one, EPISODES)
    found: Counter[str] = Counter()
    problems, messages = [], set()
    for number in range(CASES):
        chance = random.Random(number)
        algorithm = chance.choice(["mappo", "maddpg"])
        runs = chance.sample(made[algorithm], 2)
        stranger = chance.choice(made["maddpg" if algorithm == "mappo" else "mappo"])
        directory, marker = tmp_path / str(number), tmp_path / f"{number}-run"
        case = Case(number, *runs, stranger, directory, marker)
        case.prepare(chance)
        is_harmless = case.is_harmless()
        is_sealed = case.damage == "seal_hostile_content"
        before = case.told(case.run.path)
        after = case.told(directory) if is_harmless or is_sealed else None
        outcome = outcome_of(case)
        assert not marker.exists(), f"{case}: code was run"
        if isinstance(outcome, Exception):
            found["refused"] += 1
            found["harmless and refused"] += is_harmless
            messages.add(type(outcome))
            if not 1 <= len(str(outcome).splitlines()) <= 2 or not str(outcome).strip():
                problems.append(f"{case}: {outcome}")
        elif is_harmless:
            found["read as before"] += 1
            if not outcome == before == after:
                problems.append(f"{case}: other numbers")
        elif is_sealed:
            found["sealed and read as told"] += 1
            if outcome != after:
                problems.append(f"{case}: other numbers than those in the file")
        else:
            problems.append(f"{case}: not noticed")
        found[case.damage] += 1
        shutil.rmtree(directory)
    assert problems == []
    assert found.total() == 2 * CASES + found["harmless and refused"]
    assert set(DAMAGES) < set(found), "every kind of damage was done"
    assert found["refused"] > 800
    assert found["read as before"] > 40
    assert found["harmless and refused"] == 0
