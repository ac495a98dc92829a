"""Published file formats of recordings that others made, one loader each; a loader reads the content, not a name.

Source  docs/measured_results.md
"""

from testbench.storage import inputs

HEAD_BYTES = 4096


def load_matching_files(paths, form):
    """[(path, content)] of the files whose first bytes a module of this folder knows, and whose content it has."""
    out = []
    for path in paths:
        has_matching_head = form.is_one(inputs.head(path, HEAD_BYTES))
        content = form.load(path) if has_matching_head else None
        if content is not None:
            out.append((path, content))
    return out
