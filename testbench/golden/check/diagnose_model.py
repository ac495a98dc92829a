"""The golden step of a block on any rows: what a design should have done next, given where it was.

    row n of the design  -->  one edge of the block's own runner  -->  golden row n + 1, and golden pins of row n

Source  fpga_model/block.py
"""

import numpy as np

from fpga_model.block import declared, raws
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench import flatten
from testbench.golden.stimulus import blocks


class Model:
    """A block's step on the rows of somebody else; `of` gives None where the block or its ports are not known."""

    def __init__(self, block, params):
        self.block = block
        self.params = params
        self.inputs = [port.name for port in block.inputs]
        self.names = [port.name for port in block.registers]
        self.pins = [port.name for port in block.pins]
        self.reset = [port.reset for port in block.registers]

    @classmethod
    def of(cls, stem, params, inputs, registers, design=DEFAULT):
        """The model of block `stem` with `params` {flattened name: raw}, if the inputs and registers are its own."""
        block = blocks.of_record(design).get(stem)
        if block is None:
            return None
        model = cls(block, params)
        known = set(model.inputs) <= set(inputs) and set(model.names) <= set(registers)
        return model if known and set(model.parameters()) <= set(params) else None

    def parameters(self):
        """{flattened name: format} of the parameters."""
        case = next(iter(self.block.cases))
        return {name: fmt for name, _, fmt in blocks.params_of(self.block, case)}

    def _record(self, changed):
        like = next(iter(self.block.cases.values()))
        if like is None:
            return 0
        shape = formats(declared()[self.block.stem].Params, self.block.record)
        return flatten.rebuild(like, raws(shape, self.params | changed))

    def run(self, inputs, registers, rows=None, **changed):
        """(registers, pins), each {name: column}: one edge after each row, and the pins of those rows.

        inputs, registers  {name: int64 column}
        rows               indices of the rows, ascending; None takes all
        changed            other values of parameters
        """
        rows = np.arange(len(registers[self.names[0]])) if rows is None else rows
        state = np.stack([registers[name][rows] for name in self.names], axis=1).tolist()
        stim = np.zeros((len(rows), 2, 1 + len(self.inputs)), np.int64)
        for k, name in enumerate(self.inputs):
            stim[:, 0, k + 1] = inputs[name][rows]
        regs = np.zeros((len(rows), 2, len(self.names)), np.int64)
        pins = np.zeros((len(rows), 2, len(self.pins)), np.int64)
        record, like, run = self._record(changed), self.block.state, self.block.run
        for n, row in enumerate(state):
            run(record, flatten.rebuild(like, row), stim[n], regs[n], pins[n])
        after = regs[:, 1]
        if "rst" in inputs:
            after[inputs["rst"][rows] == 1] = self.reset
        return (
            {name: after[:, k].copy() for k, name in enumerate(self.names)},
            {name: pins[:, 0, k].copy() for k, name in enumerate(self.pins)},
        )
