"""The tables of kills, of stops and of faults in docs/reliability.md."""

from collections.abc import Mapping
from typing import Any

from studies.pages.markdown import ROOT, recorded, table
from studies.recording import read

PAGE = ROOT / "docs" / "reliability.md"


def source(document: Mapping[str, Any]) -> str:
    """When, where and how something was measured, how long it took, and what failed."""
    failures = document["failures"]
    failed = dict.fromkeys(failure.partition(": ")[0] for failure in failures)
    found = f"**Failed: {'; '.join(failed)}**." if failed else "Nothing failed."
    minutes = round(document["seconds"] / 60.0)
    took = f"{minutes} minute{'s' * (minutes != 1)}"
    return (
        f"{found} {recorded(document)}, {document['host']['cores']} cores, {took}, "
        f"`{document['command']}`."
    )


def command_of(subject: str) -> str:
    """The command of a subject, such as ``train, MAPPO``."""
    command, comma, more = subject.partition(",")
    return f"`orchid {command}`{comma}{more}"


def kills_block() -> str:
    """What was killed, how often, and where it was hit."""
    document = read("torture/kills")
    rows = []
    for subject in document["subjects"]:
        hit = [f"{phase}: {count}" for phase, count in subject["phases"].items() if count]
        missed = [phase for phase, count in subject["phases"].items() if not count]
        rows.append(
            [
                command_of(subject["name"]),
                "; ".join(hit),
                "; ".join(missed) or "–",
                f"{subject['kills']}",
                f"{subject['chains']}",
                f"{subject['compared']}",
            ]
        )
    header = ["command", "hit: times", "not hit", "kills", "ends", "compared"]
    unborn = sum(subject["unborn"] for subject in document["subjects"])
    victims = [kill["victim"] for kill in document["kills"] if kill["subject"] == "ablate"]
    who = ", ".join(
        f"{victims.count(victim)} {words}"
        for victim, words in (
            ("all", "of all processes"),
            ("parent", "of the command alone"),
            ("child", "of one of its jobs"),
        )
    )
    return (
        table(header, rows, words=3)
        + f"\n\n{len(document['kills'])} kills; those of `orchid ablate` were {who}. Directories "
        f"of runs that were killed before they had a record: {unborn}. {source(document)}"
    )


def cycles_block() -> str:
    """What grows, and what does not, as a training is stopped and gone on with."""
    document = read("torture/cycles")
    rows = [
        [
            learner["name"],
            f"{noted['cycle']:,}",
            f"{noted['resident_kib'] / 1024:.0f}",
            f"{noted['open_files']}",
            f"{noted['threads']}",
            f"{noted['files_of_run']:,}",
            f"{noted['bytes_of_run'] / 1000:,.0f}",
            f"{noted['bytes_of_record'] / 1000:,.0f}",
        ]
        for learner in document["learners"]
        for noted in learner["noted"]
    ]
    header = ["learner", "after cycle", "memory (MiB)", "open files", "threads", "files of the run"]
    resets = "; ".join(
        f"{learner['name']} with {len(learner['reset_episodes'])} resets on the way"
        for learner in document["learners"]
    )
    return (
        table([*header, "kB of the run", "kB of run.json"], rows)
        + f"\n\n{resets}: weights, `episodes.csv`, checkpoint and final metrics are bit for bit "
        f"those of the undisturbed run. {source(document)}"
    )


def faults_block() -> str:
    """What happened to which command, and what it said."""
    document = read("torture/faults")
    rows = []
    for case in document["cases"]:
        end = f"not tried: {case['skipped']}" if case["skipped"] else f"{case['code']}"
        equal = "–" if case["skipped"] else "yes" if case["went_on_equal"] else "**no**"
        rows.append([case["fault"], command_of(case["subject"]), end, equal])
    how = "; ".join(f"{name}: {text}" for name, text in document["how"].items())
    return (
        table(["what happens", "command", "exit code", "goes on to the same end"], rows, words=4)
        + f"\n\n{how}. {source(document)}"
    )


TORTURE_BLOCKS = {
    "torture: kills": (PAGE, kills_block),
    "torture: cycles": (PAGE, cycles_block),
    "torture: faults": (PAGE, faults_block),
}
