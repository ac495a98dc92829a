"""`python -m testbench.golden.coverage [BLOCK ...]`: search again for the corners of all blocks, or of those named.

Takes minutes and needs Hypothesis. The result replaces testbench/golden/corners/BLOCK.json.
Source  docs/golden.md
"""

import argparse

from testbench.golden.stimulus import blocks, corners


def main():
    parser = argparse.ArgumentParser(description="Search for stimulus corners that the directed families miss.")
    parser.add_argument("blocks", nargs="*", metavar="BLOCK", help="blocks to search; all if none is named")
    parser.add_argument("--examples", type=int, default=None, help="candidates for each goal")
    given = parser.parse_args()
    unknown = sorted(set(given.blocks) - set(blocks.BLOCKS))
    if unknown:
        parser.error(f"block: {unknown[0]!r} is not one of {', '.join(blocks.BLOCKS)}")
    from testbench.golden.coverage import search

    for stem in given.blocks or blocks.BLOCKS:
        found, missing = search.explore(blocks.BLOCKS[stem], given.examples or search.EXAMPLES)
        corners.store(stem, found, missing)


if __name__ == "__main__":
    main()
