"""Accidental and intended damage to files, for tests of the code that reads them."""

import hashlib
import json
import os
import pickle
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import safetensors.numpy

from orchid_uav.storage.files import sealed


class Payload:
    """Creates a folder when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.marker),)


@dataclass
class Target:
    """A file to be damaged; another path may share its content through a link."""

    path: Path
    chance: random.Random
    marker: Path
    """A path that exists if code from the file was executed."""
    others: list[Path] = field(default_factory=list)
    """Undamaged files that could be mistaken for it."""

    @property
    def content(self) -> bytes:
        return self.path.read_bytes()

    def place(self) -> int:
        """A random position in the file."""
        return self.chance.randrange(self.path.stat().st_size)


def put(path: Path, content: bytes) -> None:
    """Replace a file by a new one."""
    path.unlink()
    path.write_bytes(content)


def load_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


# Damage by accident.


def truncate(target: Target) -> None:
    put(target.path, target.content[: target.place()])


def flip_a_bit(target: Target) -> None:
    changed = bytearray(target.content)
    changed[target.place()] ^= 1 << target.chance.randrange(8)
    put(target.path, bytes(changed))


def insert(target: Target) -> None:
    at, more = target.place(), target.chance.randbytes(target.chance.randint(1, 16))
    put(target.path, target.content[:at] + more + target.content[at:])


def cut_out(target: Target) -> None:
    at = target.place()
    put(target.path, target.content[:at] + target.content[at + target.chance.randint(1, 16) :])


def zero(target: Target) -> None:
    """Fill with zeros, as after a power cut."""
    at, content = target.place(), target.content
    length = min(target.chance.randint(1, 4096), len(content) - at)
    put(target.path, content[:at] + bytes(length) + content[at + length :])


def empty(target: Target) -> None:
    put(target.path, b"")


def remove(target: Target) -> None:
    target.path.unlink()


def add_space(target: Target) -> None:
    put(target.path, target.content + target.chance.choice([b" ", b"\n", b"\r\n\t"]))


def write_otherwise(target: Target) -> None:
    """Write the same document in another order and without line breaks, if it is one."""
    if target.path.suffix == ".json":
        items = list(load_json(target.path).items())
        target.chance.shuffle(items)
        put(target.path, json.dumps(dict(items)).encode())
    else:
        add_space(target)


def take_another(target: Target) -> None:
    put(target.path, target.chance.choice(target.others).read_bytes())


def take_all_of_another_folder(target: Target) -> None:
    """Copy the file with its neighbours from another folder, so that they fit together."""
    folder = target.chance.choice(target.others).parent
    for path in target.path.parent.iterdir():
        if path.is_file() and (folder / path.name).is_file():
            put(path, (folder / path.name).read_bytes())


# Damage by intent.


def make_folder(target: Target) -> None:
    target.path.unlink()
    target.path.mkdir()


def make_pipe(target: Target) -> None:
    target.path.unlink()
    os.mkfifo(target.path)


def link_to_itself(target: Target) -> None:
    target.path.unlink()
    target.path.symlink_to(target.path)


def link_to_zeros(target: Target) -> None:
    target.path.unlink()
    target.path.symlink_to("/dev/zero")


def make_huge(target: Target) -> None:
    """Make the file a terabyte long, although it takes almost no space on the disk."""
    put(target.path, target.chance.choice([target.content, b""]))
    os.truncate(target.path, 2**40)


def put_a_pickle(target: Target) -> None:
    put(target.path, pickle.dumps(Payload(target.marker)))


_ODD_DOCUMENTS = (
    *(b"[" * 100_000, b'{"a":' * 100_000, b'{"a": ' + b"[" * 900 + b"]" * 900 + b"}"),
    *(b'{"a": ' + b"9" * 100_000 + b"}", b'{"a": NaN}', b'{"a": -Infinity}', b'{"a": 1e999}'),
    *(b'{"a": "\\ud800"}', b"null", b"[]", b'"text"', b"\xef\xbb\xbf{}", b"\x80\x81", b"{}"),
    '{"a": 1}'.encode("utf-16"),
)
_ODD_VALUES = (b"NaN", b"1e999", b"9" * 5000, b'"\\udfff"', b"[" * 5000 + b"]" * 5000)


def put_an_odd_document(target: Target) -> None:
    put(target.path, target.chance.choice(_ODD_DOCUMENTS))


def add_an_odd_value(target: Target) -> None:
    """Add a value that JSON or Python cannot represent, after a document's last value."""
    odd = b', "odd": ' + target.chance.choice(_ODD_VALUES) + b"}"
    put(target.path, target.content.rstrip().removesuffix(b"}") + odd)


# Damage by somebody who knows of seals and checksums.

NASTY_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2**31, 2**63, 10**30, -(10**30), 10**9, 0.5, -0.5, 1e308),
    *("", "x", "1", "nan", "inf", "../..", "a" * 1000, "AAAA", [], [1], ["x"], [[]], {}),
    *({"a": 1}, [10**9] * 3, [1e308] * 4, list(range(1000)), {"0": ["step"]}),
)
_VOUCHING = ("seal", "sha256", "files_sha256")


def spoil(document: Any, chance: random.Random) -> None:
    """Change a value somewhere in a document."""
    keys = list(document) if isinstance(document, dict) else list(range(len(document)))
    key = chance.choice([key for key in keys if key not in _VOUCHING])
    if isinstance(document[key], dict | list) and document[key] and chance.random() < 0.9:
        spoil(document[key], chance)
    elif chance.random() < 0.2:
        del document[key]
    elif chance.random() < 0.1 and isinstance(document, dict):
        document[f"{key}_"] = document.pop(key)
    else:
        document[key] = chance.choice(NASTY_VALUES)


def write_sealed(path: Path, document: dict[str, Any]) -> None:
    """Write a document with its seals and checksums."""
    if path.name == "config.json":
        content = json.dumps(document).encode()
        put(path, content)
        reseal(path.with_name("run.json"), config_sha256=hashlib.sha256(content).hexdigest())
    else:
        put(path, json.dumps(sealed(document)).encode())


def reseal(path: Path, **changes: Any) -> None:
    """Change a document and renew its seal."""
    write_sealed(path, load_json(path) | changes)


def write_sealed_tensors(path: Path, content: bytes) -> None:
    """Write a file of tensors with its seals and checksums."""
    put(path, content)
    checksum = hashlib.sha256(content).hexdigest()
    if path.name == "policy.safetensors":
        reseal(path.with_suffix(".json"), sha256=checksum)
    else:
        state = path.with_name("state.json")
        reseal(state, files_sha256=load_json(state)["files_sha256"] | {path.stem: checksum})


def seal_hostile_content(target: Target) -> None:
    if target.path.suffix == ".safetensors":
        change = target.chance.choice(list(HOSTILE_TENSORS.values()))
        write_sealed_tensors(target.path, change(target.content))
    elif target.path.suffix == ".json":
        document = load_json(target.path)
        spoil(document, target.chance)
        write_sealed(target.path, document)
    else:
        flip_a_bit(target)


# Invalid files of tensors, each made from a valid one.

Header = dict[str, Any]


def _split(content: bytes) -> tuple[Header, bytes]:
    (length,) = struct.unpack("<Q", content[:8])
    return json.loads(content[8 : 8 + length]), content[8 + length :]


def _joined(header: bytes, data: bytes) -> bytes:
    return struct.pack("<Q", len(header)) + header + data


def _with_header(change: Callable[[Header, Header], Any]) -> Callable[[bytes], bytes]:
    """Make damage that changes the header; ``change`` gets it and its last tensor's entry."""

    def changed(content: bytes) -> bytes:
        header, data = _split(content)
        header.pop("__metadata__", None)
        change(header, max(header.values(), key=lambda one: one["data_offsets"]))
        return _joined(json.dumps(header).encode(), data)

    return changed


def _first_offset(entry: Header, length: int) -> list[int]:
    first = entry["data_offsets"][0]
    return [first, first + length]


def _overlap(header: Header, last: Header) -> None:
    for entry in header.values():
        entry["data_offsets"] = [0, entry["data_offsets"][1] - entry["data_offsets"][0]]


def _rename(header: Header, last: Header) -> None:
    name = min(header)
    header[f"{name}_"] = header.pop(name)


def _name_twice(content: bytes) -> bytes:
    header, data = _split(content)
    name = min(header)
    wrong = json.dumps({name: {"dtype": "F32", "shape": [1], "data_offsets": [0, 4]}})
    return _joined(f"{json.dumps(header)[:-1]}, {wrong[1:]}".encode(), data)


def _without_one(content: bytes) -> bytes:
    tensors = safetensors.numpy.load(content)
    tensors.popitem()
    return safetensors.numpy.save(tensors)


_OTHER_TYPES = {"F32": "I32", "F64": "I64", "I64": "U64", "U64": "F64", "BOOL": "U8"}
_TERABYTES = 2**42
HOSTILE_TENSORS: dict[str, Callable[[bytes], bytes]] = {
    "claims terabytes": _with_header(
        lambda header, last: last.update(
            dtype="U8", shape=[_TERABYTES], data_offsets=_first_offset(last, _TERABYTES)
        )
    ),
    "overflows": _with_header(lambda header, last: last.update(shape=[2**33, 2**33])),
    "overlaps": _with_header(_overlap),
    "runs backwards": _with_header(lambda header, last: last["data_offsets"].reverse()),
    "is of negative length": _with_header(
        lambda header, last: last.update(shape=[-length for length in last["shape"]] or [-1])
    ),
    "is of another type": _with_header(
        lambda header, last: last.update(dtype=_OTHER_TYPES[last["dtype"]])
    ),
    "is of a type unknown to NumPy": _with_header(
        lambda header, last: last.update(
            dtype="F8_E4M3", shape=[last["data_offsets"][1] - last["data_offsets"][0]]
        )
    ),
    "is of another shape": _with_header(
        lambda header, last: last.update(shape=[*last["shape"][::-1], 1])
    ),
    "has another name": _with_header(_rename),
    "has two meanings": _name_twice,
    "has one more": _with_header(
        lambda header, last: header.update(
            more={"dtype": "F32", "shape": [0], "data_offsets": [last["data_offsets"][1]] * 2}
        )
    ),
    "has one more beyond the end": _with_header(
        lambda header, last: header.update(
            more={"dtype": "F32", "shape": [2**20], "data_offsets": [2**40, 2**40 + 2**22]}
        )
    ),
    "lacks one": _without_one,
    **{
        f"has a header of {length} bytes": lambda content, length=length: (
            struct.pack("<Q", length) + content[8:]
        )
        for length in (0, 7, 2**20 + 1, 10**8, 2**63, 2**64 - 1)
    },
    "is nested in lists": lambda content: _joined(b"[" * 500_000, b""),
    "is nested in objects": lambda content: _joined(b'{"a":' * 100_000, b""),
    "is null": lambda content: _joined(b"null", b""),
    "is blank": lambda content: _joined(b" " * 10**6, b""),
    "holds nothing": lambda content: _joined(b"{}", b""),
    "goes on": lambda content: content + b"more",
    "ends early": lambda content: content[:-1],
    "is a length alone": lambda content: content[:8],
    "is empty": lambda content: b"",
}
"""All of these files are refused, although their checksums are right."""

DAMAGES: dict[str, Callable[[Target], None]] = {
    damage.__name__: damage
    for damage in (
        *(truncate, flip_a_bit, insert, cut_out, zero, empty, remove, add_space, write_otherwise),
        *(take_another, take_all_of_another_folder, make_folder, make_pipe, link_to_itself),
        *(link_to_zeros, make_huge, put_a_pickle, put_an_odd_document, add_an_odd_value),
        seal_hostile_content,
    )
}
