"""What a stimulus reaches in a block, counted on the model: toggles of every register and pin, outcomes of every place.

    toggles    bits that were seen to rise and to fall from one row to the next, of those that can
    outcomes   of every place that decides, rounds, cuts, saturates or wraps in the source of `step` (probes.py)

A goal that no stimulus can meet is taken out of what is possible, with its reason (unreachable.py).
Source  docs/golden.md
"""

from typing import NamedTuple

import numpy as np

from testbench.golden.coverage import probes
from testbench.golden.stimulus import blocks


class Toggle(NamedTuple):
    """Masks of one port: bits that rose and fell at least once."""

    name: str
    width: int
    rose: int
    fell: int


def toggles(ports, rows):
    """One Toggle for each column of int64 rows."""
    port_toggles = []
    for k, port in enumerate(ports):
        column, mask = rows[:, k], (1 << port.width) - 1
        before, after = column[:-1], column[1:]
        rose = int(np.bitwise_or.reduce(after & ~before, initial=0)) & mask
        fell = int(np.bitwise_or.reduce(before & ~after, initial=0)) & mask
        port_toggles.append(Toggle(port.name, port.width, rose, fell))
    return port_toggles


def toggle_goals(ports):
    """Every ("toggle", port, "rise k" or "fall k")."""
    return [
        ("toggle", port.name, f"{way} {k}") for port in ports for k in range(port.width) for way in ("rise", "fall")
    ]


def reached_toggle_goals(ports, rows):
    """The toggle goals that rows meet."""
    reached_goals = set()
    for port_toggle in toggles(ports, rows):
        for way, mask in (("rise", port_toggle.rose), ("fall", port_toggle.fell)):
            reached_goals |= {
                ("toggle", port_toggle.name, f"{way} {k}") for k in range(port_toggle.width) if mask >> k & 1
            }
    return reached_goals


def side_by_side(regs, pins):
    """Registers and pins in one array, in the order of `goal_ports`."""
    return np.column_stack([regs, pins])


def goal_ports(block):
    """Registers and pins, the pins with the prefix of their port."""
    return (*block.registers, *(port._replace(name=f"o_{port.name}") for port in block.pins))


def goals(block, case):
    """Every goal (kind, place, outcome) of a case, whether it can be met or not, in a fixed order."""
    return toggle_goals(goal_ports(block)) + probes.build_probed_step(block, case).goals()


def find_reached_goals(block, case, rows, results=None):
    """Goals that a stimulus meets; `results` are the registers and pins of the model if they are known."""
    if results is None:
        results = side_by_side(*blocks.run(block, case, rows))
    probed = probes.build_probed_step(block, case)
    probes.follow(block, case, probed, np.asarray(rows).tolist())
    return reached_toggle_goals(goal_ports(block), results) | probed.reached_goals()
