"""Both worlds together: engines, runs, records, golden vectors, measured data.

Public API (docs/api.md): the modules of PUBLIC, imported on first use.
"""

import importlib

PUBLIC = {
    "budget": "testbench.run.budget",
    "simulate": "testbench.run.simulate",
}


def __getattr__(name):
    if name in PUBLIC:
        return importlib.import_module(PUBLIC[name])
    raise AttributeError(f"module 'testbench' has no attribute {name!r}; public are {', '.join(PUBLIC)}, config")
