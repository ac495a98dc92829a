"""Detection score of the loop at pins: python -m tests.testbench.golden.loop_score [COUNT]

Plants faults in the reference RTL, closes the loop of the quick gyroscope around each, and compares the pins with the
model's until the first difference or the end: lock, rates, a silent ADC. Writes testbench/golden/loop/detection.json,
and the table of docs/rtl.md in docs/results/loop_detection.json.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

from fpga_model.rates import FRAME_HZ
from testbench.config import Config, changed
from testbench.engines import chips
from testbench.golden.loop import judgement, library, run
from testbench.golden.recording import make_recordings
from tests.testbench.golden import loop_faults, pin_tops

COUNT, SEED, FRAMES = 100, 7725, 900
PAGE = Path(__file__).resolve().parents[3] / "docs" / "results" / "loop_detection.json"


def scenario():
    """(Config, firmware): the quick gyroscope to lock, 300 and -300 deg/s, an ADC that is silent for ten frames."""
    rates = [[0.0, 0.0], [540 / FRAME_HZ, 300.0], [660 / FRAME_HZ, -300.0]]
    faults = [[780 / FRAME_HZ, "adc_silent", "adc", 0, 10 / FRAME_HZ]]
    given = {"seconds": FRAMES / FRAME_HZ, "origin": "power_on", "rate_dps": rates, "rate_shape": "steps"}
    given["faults"] = faults
    config = changed(Config(), make_recordings.QUICK | {f"scenario.{key}": value for key, value in given.items()})
    return config, make_recordings.quick_firmware(config)


def score(count, seed, folder, say=print):
    """{"kinds": {kind: [planted, seen]}, "unseen": [...], ...} of `count` faults."""
    config, firmware = scenario()
    faults = loop_faults.drawn(count, seed)
    rtl = loop_faults.write(folder / "rtl", firmware, faults)
    face = library.pin_face(pin_tops.TOP, firmware, chips.parts(chips.dac_chips(config.design)))
    listed = library.user_sources(rtl, face.top, rtl / "all.f")
    path = library.build(rtl, firmware, folder / "built", 1, face, listed)
    kinds, unseen, rows = {}, [], 0
    for number, fault in enumerate([None, *faults]):
        loop_faults.select(rtl, number)
        with library.Design(path, face, rtl) as design:
            outcome = run.run_lockstep(config, design, firmware)
        if fault is None:
            assert outcome.difference is None, outcome.text()
            rows = outcome.rows
            continue
        planted = kinds.setdefault(fault.kind, [0, 0])
        planted[0] += 1
        planted[1] += outcome.difference is not None
        if outcome.difference is None:
            unseen.append(fault._asdict())
        say(number, fault.kind, fault.file, fault.line + 1, outcome.difference and outcome.difference.row, flush=True)
    return {"faults": len(faults), "seen": len(faults) - len(unseen), "seed": seed, "rows": rows,
            "kinds": kinds, "unseen": unseen}  # fmt: skip


def main(given):
    began = time.process_time()
    with tempfile.TemporaryDirectory(prefix="gyro-score-") as folder:
        found = score(int(given[0]) if given else COUNT, SEED, Path(folder))
    judgement.DETECTION.write_text(json.dumps(found, indent=1) + "\n")
    page = json.loads(PAGE.read_text())
    page["tables"][0]["rows"] = [[kind, str(count), str(seen)] for kind, (count, seen) in found["kinds"].items()]
    PAGE.write_text(json.dumps(page, indent=1) + "\n")
    print(f"{found['seen']} of {found['faults']} seen, {time.process_time() - began:.0f} s of CPU")


if __name__ == "__main__":
    main(sys.argv[1:])
