"""What is finished, what failed last and what is damaged in a store.

Source  docs/campaigns.md
"""

from testbench.campaign import collect, verify
from testbench.campaign.store import hashes_by_address
from testbench.errors import FileError


def store_status(store):
    """(plans, damaged, lines): a dictionary for each plan that can be read, one line of text for each plan or point
    that is damaged, and one for each line of a journal that cannot be read."""
    lines, last = [], {}
    written = hashes_by_address(_track_last_events(store.lines(lines), last))
    plans, damaged, faults = [], [], {}
    for name in collect.plan_names(store):
        try:
            addresses = set(collect.read_stored_plan(store, name).addresses)
        except FileError as problem:
            damaged.append(str(problem))
            continue
        faults |= verify.faults(store, addresses - faults.keys(), written)
        ended = {a for a in addresses - faults.keys() if store.has(a)}
        failed = [(a, last[a][1]) for a in sorted(addresses - ended) if a in last and last[a][1]]
        plans.append({"name": name, "points": len(addresses), "finished": len(ended), "failed": failed})
    return plans, damaged + [faults[address] for address in sorted(faults)], lines


def _track_last_events(events, last):
    """The same events; `last` gets {address: (time, error or nothing)} of the last one of each point."""
    for event in events:
        if event.point not in last or event.t >= last[event.point][0]:
            last[event.point] = event.t, " ".join(event.error.split())
        yield event
