"""The operations audit: proves from the logs of a run that its work could have happened, or says where it could not.

Knows the tables of a run and what its scenario asks for; nothing of states, dispatchers and planners, so it can disagree with all of
them. `docs/audits.md` has the docstrings of the rules.
"""

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

from mrp_sumo.metrics.operations import energy, orders, places, robots
from mrp_sumo.metrics.operations.evidence import Finding, Logs

LISTED = 20  # findings of a rule that are listed
RULES: dict[str, tuple[Callable[[Logs], Iterator[Finding]], ...]] = {
    "released once": (orders.releases,),
    "one state": (orders.states, orders.ends_are_events),
    "stops in order": (orders.stops_in_order,),
    "loads": (orders.loads, orders.on_board),
    "service": (places.service,),
    "shifts": (places.shifts,),
    "heading": (places.headings,),
    "one robot a place": (places.places,),
    "one load a place": (places.held,),
    "utilisation": (places.shares,),
    "first come, first served": (places.waits,),
    "lifts": (places.lifts,),
    "doors": (places.doors,),
    "states": (robots.states, robots.stands),
    "Little's law": (robots.had,),
    "conservation": (robots.conservation,),
    "visits": (robots.visits,),
    "idle beside work": (robots.idle,),
    "oldest first": (robots.passed_over,),
    "batteries": (energy.batteries, energy.empty),
}


def operations_audit(logs: Logs) -> dict[str, Any]:
    """Look over the work of a run: `passed`, and `findings` by time, of each rule at most `LISTED`.

    A finding has `rule`, `t_s`, `robot`, `place`, `order` (names, None where there is none) and `text`, a line for people.
    """
    findings = [finding for rules in RULES.values() for rule in rules for finding in islice(rule(logs), LISTED)]
    findings.sort(key=lambda finding: finding.t_s)
    return {"passed": not findings, "findings": [finding._asdict() for finding in findings]}


def in_words(audited: dict[str, Any]) -> str:
    """The first finding of an audit, and how many more there are; '' for none."""
    findings = audited["findings"]
    if not findings:
        return ""
    more = len(findings) - 1
    return f"{findings[0]['text']}{f', and {more} more findings' if more > 1 else ', and one more finding' if more else ''}"
