"""Known vulnerabilities of the pinned versions, by pip-audit: ``make audit``.

pip-audit says "no known vulnerabilities" also where it could look up nothing, so this counts what
it looked up. Where an index serves no page for a release, only the page of the project, that page
is asked: it tells of the newest release, so a pin that is older stays without an answer.

Exits with 1 if a finding is not explained in ``EXPLAINED``, or if a pin could not be looked up.
"""

import argparse
import re
import sys
from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

from packaging.version import Version

from studies.recording import (
    RESULTS,
    ROOT,
    add_recording_options,
    record,
    require_commit,
    write_result,
)
from studies.supply_chain.tested import pins

RESULT = RESULTS / "audit.json"
PINS = ("constraints.txt", "studies/supply_chain/requirements.txt")
EXPLAINED: dict[str, str] = {}
"""Why a finding, by any of its identifiers, is no danger here; nothing is, at present."""


def findings(name: str, found: Iterable[Any]) -> list[dict[str, Any]]:
    """Rows of the record, from pip-audit's ``VulnerabilityResult``."""
    return [
        {
            "name": name,
            "id": one.id,
            "aliases": sorted(one.aliases),
            "fixed_in": [str(fixed) for fixed in one.fix_versions],
            "explained": next(
                (EXPLAINED[known] for known in (one.id, *one.aliases) if known in EXPLAINED), None
            ),
        }
        for one in found
    ]


def answers(page: dict[str, Any], pinned: Version) -> bool:
    """Whether the page of a project tells of the pinned release, which must be its newest."""
    return Version(page["info"]["version"]) == pinned and "vulnerabilities" in page


class ProjectPage:
    """A session that asks for the page of a project instead of that of one of its releases."""

    def __init__(self, session: Any, pinned: Version) -> None:
        self.session = session
        self.pinned = pinned

    def get(self, url: str, **options: Any) -> Any:
        """The page if it tells of the pinned release, else a response that says "not found"."""
        response = self.session.get(url=re.sub(r"/[^/]+/json$", "/json", url), **options)
        if response.ok and not answers(response.json(), self.pinned):
            response.status_code = 404
        return response


def look_up(pinned: Iterable[tuple[str, str]]) -> tuple[list[dict[str, Any]], list[str]]:
    """Findings, and the pins that no page tells of.

    Raises:
        pip_audit._service.ServiceError: the index cannot be reached, or answers in other words.
    """
    # Not at the top: the rest of this module is tested without pip-audit.
    from pip_audit._service import PyPIService, ResolvedDependency

    service = PyPIService()
    of_releases = service.session
    found, unknown = [], []
    for name, release in pinned:
        asked_for = ResolvedDependency(name=name, version=Version(release))
        answer, results = service.query(asked_for)
        if answer.is_skipped():
            service.session = ProjectPage(of_releases, asked_for.version)
            answer, results = service.query(asked_for)
            service.session = of_releases
        if answer.is_skipped():
            unknown.append(f"{name}=={release}")
        found += findings(f"{name}=={release}", results)
    return found, unknown


def pinned_everywhere() -> list[tuple[str, str]]:
    """Name and version of all pins, each once."""
    return sorted({pin for name in PINS for pin in pins(ROOT / name).items()})


def main() -> int:
    """Look up all pins and write what was found; 1 if anything is left open."""
    parser = argparse.ArgumentParser(prog="studies.supply_chain.audit", description=__doc__)
    add_recording_options(parser, RESULT)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    pinned = pinned_everywhere()
    found, unknown = look_up(pinned)
    result = record(
        {"files": list(PINS)},
        pip_audit=version("pip-audit"),
        pins=len(pinned),
        findings=found,
        not_looked_up=unknown,
    )
    write_result(options.json, result, ['"findings"', '"not_looked_up"', '{"name"'])
    unexplained = [one for one in found if one["explained"] is None]
    for one in unexplained:
        fixed = ", ".join(one["fixed_in"]) or "no release"
        print(f"{one['name']}: {one['id']}, fixed in {fixed}", file=sys.stderr)
    print(f"{len(pinned)} pins, {len(found)} findings, {len(unexplained)} of them not explained")
    if unknown:
        print(f"not looked up: {len(unknown)}, {' '.join(unknown)}", file=sys.stderr)
    return 1 if unexplained or unknown else 0


if __name__ == "__main__":
    sys.exit(main())
