"""Records as rows: order, names, formats and the way back."""

import numpy as np

from fpga_model import top as fpga
from fpga_model.jit import kernel
from testbench import flatten


@kernel
def write(rows, state):
    for k in range(rows.shape[0]):
        flatten.store(rows[k], state)


def counted():
    """A state whose registers are 0, 1, 2, ... in row order."""
    fresh = fpga.State()
    return flatten.rebuild(fresh, range(len(flatten.names(fresh))))


def test_a_row_is_the_record_depth_first():
    state = counted()
    rows = np.zeros((2, len(flatten.names(state))), np.int64)
    write(rows, state)
    assert rows[0].tolist() == rows[1].tolist() == list(range(rows.shape[1]))
    names = flatten.names(state)
    assert names.index("dds.phase") == state.dds.phase
    assert names.index("references.aligned.2") == state.references.aligned[2]
    assert names.index("control.agc.loop.acc") == state.control.agc.loop.acc


def test_rebuild_is_the_inverse():
    state = counted()
    rows = np.zeros((1, len(flatten.names(state))), np.int64)
    write(rows, state)
    assert flatten.rebuild(fpga.State(), rows[0]) == state


def test_formats_have_the_names_of_the_registers():
    assert [name for name, _ in flatten.format_leaves(fpga.STATE_FMT)] == flatten.names(fpga.State())
    assert all(
        fmt.holds(value)
        for (_, fmt), (_, value) in zip(flatten.format_leaves(fpga.STATE_FMT), flatten.leaves(fpga.State()))
    )
