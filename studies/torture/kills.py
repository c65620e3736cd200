"""SIGKILL at random moments; whoever goes on gets what the undisturbed command makes.

Moments are drawn from the seed; what a process does at a moment depends on the machine. So a second
call kills at the same seconds, not at the same instructions: what was hit is recorded.
"""

import os
import random
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

from studies.recording import ONE_THREAD
from studies.torture.subjects import (
    NOTES,
    ORCHID,
    START,
    Command,
    Outcome,
    Subject,
    differences,
    episodes_done,
    litter,
    paths_below,
    positions_file,
    subjects,
    unborn,
    unfinished,
)

KILLS = 100
"""At scale 1."""
LONGEST_CHAIN = 8
"""Kills after which a command may come to its end."""
GIVE_UP_AFTER_S = 900.0
_LOOK_EVERY_S = 0.001
_AIMED_FOR_S = 3.0
_LONGEST_MESSAGE = 300

Victim = Literal["all", "parent", "child"]
Aim = Literal["any time", "after the start", "a write"]


class Kill(NamedTuple):
    """A SIGKILL, and what it hit."""

    subject: str
    chain: int
    victim: Victim
    """All processes of the command, or only the first one, or only one that it had started."""
    aim: Aim
    after_s: float
    """Seconds after the command began."""
    phase: str
    episodes: int
    """Rows in the logs of all its runs."""


class Undisturbed(NamedTuple):
    """A command that nothing happened to."""

    seconds: float
    working_s: float
    """Seconds from the first file that it wrote to its end."""
    outcome: Outcome


@dataclass
class Story:
    """What happened to one subject."""

    kills: list[Kill] = field(default_factory=list)
    unborn: int = 0
    """Directories of runs that were killed before they had a record."""
    chains: int = 0
    """Commands that were killed once or several times and then came to their end."""
    faults: list[str] = field(default_factory=list)
    """What was not as it should be."""

    def hits(self, phase: str) -> int:
        """How many kills hit a phase."""
        return sum(kill.phase == phase for kill in self.kills)


def run(scale: float, seed: int, victims: Sequence[Subject] | None = None) -> dict[str, Any]:
    """Kill all subjects in turn, ``KILLS`` times ``scale`` in all.

    Args:
        scale: share of the kills.
        seed: of the moments and of what is killed.
        victims: the commands; by default those of :func:`studies.torture.subjects.subjects`.

    Returns:
        The kills, the subjects, and the ``failures``, none of which there should be.
    """
    draw = random.Random(seed)
    victims = subjects() if victims is None else victims
    wanted = max(len(victims), round(KILLS * scale))
    stories = {subject.name: Story() for subject in victims}
    with tempfile.TemporaryDirectory(prefix="orchid-kills-") as place:
        whole = {one.name: undisturbed(one, Path(place) / "whole") for one in victims}
        done = 0
        while done < wanted:
            # The subject that was hit least comes next.
            subject = min(victims, key=lambda one: len(stories[one.name].kills))
            story, working = stories[subject.name], Path(place) / "killed"
            before = len(story.faults)
            most = min(draw.randint(1, LONGEST_CHAIN), wanted - done)
            _chain(subject, working, whole[subject.name], most, draw, story)
            for fault in story.faults[before:]:
                print(f"{subject.name}: {fault}", flush=True)
            if len(story.faults) > before:
                kept = Path(tempfile.mkdtemp(prefix="orchid-kills-failed-"))
                shutil.copytree(working, kept, dirs_exist_ok=True)
                print(f"what was left is kept in {kept}", flush=True)
            shutil.rmtree(working)
            done = sum(len(one.kills) for one in stories.values())
            print(f"{done} of {wanted} kills, last of {subject.name}", flush=True)
    return {
        "subjects": [
            {
                "name": one.name,
                "command": " ".join(["orchid", *one.command]),
                "seconds": round(whole[one.name].seconds, 1),
                "compared": len(whole[one.name].outcome),
                "kills": len(stories[one.name].kills),
                "chains": stories[one.name].chains,
                "unborn": stories[one.name].unborn,
                "phases": {phase: stories[one.name].hits(phase) for phase in one.phases},
            }
            for one in victims
        ],
        "kills": [kill._asdict() for story in stories.values() for kill in story.kills],
        "failures": [f"{name}: {fault}" for name, one in stories.items() for fault in one.faults],
    }


def undisturbed(subject: Subject, working: Path) -> Undisturbed:
    """Run a command to its end in a new directory, which is removed.

    Raises:
        RuntimeError: it fails by itself.
    """
    working.mkdir()
    positions_file(working)
    began_s = time.monotonic()
    with started(subject.command, working) as process:
        until(lambda: _has_begun(working, 0) or process.poll() is not None, GIVE_UP_AFTER_S)
        first_s = time.monotonic()
        code = process.wait(GIVE_UP_AFTER_S)
    if code:
        raise RuntimeError(f"orchid {' '.join(subject.command)}: {code}: {told_by(working)}")
    ended_s, outcome = time.monotonic(), subject.outcome(working)
    shutil.rmtree(working)
    return Undisturbed(ended_s - began_s, ended_s - first_s, outcome)


def _chain(
    subject: Subject,
    working: Path,
    whole: Undisturbed,
    most: int,
    draw: random.Random,
    story: Story,
) -> None:
    """Begin, kill, go on, kill …, and let it come to its end; then compare."""
    working.mkdir()
    positions_file(working)
    first, code = len(story.kills), -signal.SIGKILL
    command: Command | None = subject.command
    while command is not None and code == -signal.SIGKILL:
        is_last = len(story.kills) - first >= most
        with started(command, working) as process:
            if not is_last:
                _strike(process, subject, working, whole, draw, story)
            code = process.wait(GIVE_UP_AFTER_S)
        if code not in (0, -signal.SIGKILL):
            story.faults.append(f"orchid {' '.join(command)} ends with {code}: {told_by(working)}")
            return
        command = subject.going_on(working)
    story.chains += 1
    outcome = subject.outcome(working)
    story.faults += [f"differs: {name}" for name in differences(whole.outcome, outcome)]
    story.unborn += len(unborn(working))
    story.faults += [f"left behind: {path.relative_to(working)}" for path in litter(working)]


def _strike(
    process: "subprocess.Popen[bytes]",
    subject: Subject,
    working: Path,
    whole: Undisturbed,
    draw: random.Random,
    story: Story,
) -> None:
    """Kill a command at a random moment, unless it ends before; a child of it, and then itself."""
    began_s, began_ns = time.monotonic(), time.time_ns()
    victims: tuple[Victim, ...] = ("all",)
    if subject.command[0] == "ablate":
        # A job that is killed is run once more, so that a child is killed no second time.
        victims = draw.choice([("all",), ("parent",), ("child",), ("child", "all")])
    for victim in victims:
        aim: Aim = draw.choice(["any time", "after the start", "a write"])
        _await(aim, process, subject, working, whole, draw.random(), began_ns)
        if victim == "child":
            until(
                lambda: process.poll() is not None or bool(children_of(process.pid)), whole.seconds
            )
        if process.poll() is not None:
            return
        if victim == "child":
            children = children_of(process.pid)
            if not children:
                continue
            os.kill(draw.choice(children), signal.SIGKILL)
        elif victim == "parent":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
        after_s = round(time.monotonic() - began_s, 2)
        if victim != "child":
            process.wait(GIVE_UP_AFTER_S)
        # A resume that has changed nothing yet leaves what the kill before it left.
        has_begun = START not in subject.phases or _has_begun(working, began_ns)
        phase = subject.phase(working) if has_begun else START
        number, episodes = story.chains + 1, episodes_done(working)
        story.kills.append(Kill(subject.name, number, victim, aim, after_s, phase, episodes))


def _await(
    aim: Aim,
    process: "subprocess.Popen[bytes]",
    subject: Subject,
    working: Path,
    whole: Undisturbed,
    share: float,
    began_ns: int,
) -> None:
    """Wait for the moment: a share of the whole time, or of the time after the first write."""

    def has_ended() -> bool:
        return process.poll() is not None

    # What a plan writes first comes at its end.
    if aim == "any time" or START not in subject.phases:
        until(has_ended, 1.05 * share * whole.seconds)
    else:
        until(lambda: has_ended() or _has_begun(working, began_ns), GIVE_UP_AFTER_S)
        until(has_ended, share * whole.working_s)
    if aim == "a write":
        until(lambda: has_ended() or bool(unfinished(working)), _AIMED_FOR_S)


def _has_begun(working: Path, began_ns: int) -> bool:
    """Whether something was written since, by a command that begins with writing into a folder."""
    for path in paths_below(working):
        with suppress(FileNotFoundError):
            if path.name not in NOTES and path.lstat().st_mtime_ns > began_ns:
                return True
    return False


def until(is_true: Callable[[], bool], most_s: float) -> None:
    """Wait for something to be true, so many seconds at most."""
    end_s = time.monotonic() + most_s
    while not is_true() and time.monotonic() < end_s:
        time.sleep(_LOOK_EVERY_S)


def children_of(pid: int) -> list[int]:
    """Processes that a process has started."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += [int(child) for child in task.read_text(encoding="ascii").split()]
    return found


def told_by(working: Path) -> str:
    """The end of what commands have written to standard error."""
    return (working / "stderr").read_text(encoding="utf-8")[-_LONGEST_MESSAGE:].strip()


@contextmanager
def started(
    command: Command,
    working: Path,
    notes: Path | None = None,
    before: Sequence[str] = (),
    environment: dict[str, str] | None = None,
) -> Iterator["subprocess.Popen[bytes]"]:
    """A command in a session of its own, which does not outlive the block.

    Args:
        command: arguments of ``orchid``.
        working: its working directory.
        notes: where ``stdout`` and ``stderr`` are kept; by default in the working directory.
        before: a command that starts it, with its arguments.
        environment: further variables.
    """
    notes = notes or working
    with (notes / "stderr").open("ab") as errors, (notes / "stdout").open("ab") as output:
        process = subprocess.Popen(
            [*before, *ORCHID, *command],
            cwd=working,
            env={**os.environ, **ONE_THREAD, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=errors,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
