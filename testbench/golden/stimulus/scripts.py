"""Scripts: long inputs that walk a block through its states: debouncing, frames, start-up, loss and recovery.

`script_STEM` belongs to the block STEM.

Source  docs/firmware.md
"""

import itertools

from fpga_model import fault_monitor, lock_monitor, rates, spi_adc
from fpga_model.fixed import signed_bits
from testbench.golden.stimulus.script_axi_slave import script_axi_slave  # noqa: F401
from testbench.golden.stimulus.script_host_bus import script_host_bus  # noqa: F401
from testbench.golden.stimulus.script_sequencer import script_sequencer  # noqa: F401
from testbench.golden.stimulus.script_spi_slave import script_spi_slave  # noqa: F401
from testbench.golden.stimulus.writer import LONG_ROWS, around, frame, wrap_to_format

LONG = 1000  # debounce in frames above which a script takes each way once


def _lock_errors(p, setpoint, table, offset, sign):
    """Inputs whose four errors are `offset` LSB beside the limits of `table`."""
    names = ("agc_error", "phase", "sense_sin", "sense_cos")
    limits = ((setpoint * table[0]) >> lock_monitor.FRACTION, *table[1:])
    return {"setpoint": setpoint} | {name: sign * (limit + offset) for name, limit in zip(names, limits, strict=True)}


def _single_bit_neighbours(limit):
    """168 magnitudes around a limit; a zero where there are fewer."""
    magnitudes = sorted({abs(v) for v in around(limit, signed_bits(24)) if abs(v) < 1 << 23})
    return magnitudes + [0] * (168 - len(magnitudes))


def script_lock_monitor(w):
    """The errors at both of their limits +-1 LSB, long enough to lock and to lose lock; then each bit alone."""
    p = w.block.cases[w.case]
    common = {"en": 1, "enable": 15, "judged": 15}
    longest_in, longest_out = max(p.frames_in) + 2, max(p.frames_out) + 2
    if max(longest_in, longest_out) > LONG:
        w.append_row({**common, **_lock_errors(p, 1 << 22, p.limit_in, 0, 1)}, times=longest_in)
        w.append_row({**common, **_lock_errors(p, 1 << 22, p.limit_out, 1, -1)}, times=longest_out)
        return
    for sign in (1, -1):
        for offset_lsb in (1, 0, -1):
            w.append_row({**common, **_lock_errors(p, 1 << 22, p.limit_in, offset_lsb, sign)}, times=longest_in)
            w.append_row({**common, **_lock_errors(p, 1 << 22, p.limit_out, offset_lsb, -sign)}, times=longest_out)
        w.append_row({**common, "sense_cos": 1 << 22, "rail": 1}, times=longest_in)
    # setpoints whose product with a limit has all ones in the bits that are cut
    for table in (p.limit_in, p.limit_out):
        setpoint = (1 << 20) | (-pow(table[0], -1, 1 << lock_monitor.FRACTION) % (1 << lock_monitor.FRACTION))
        for offset_lsb in (0, 1):
            w.append_row({**common, **_lock_errors(p, setpoint, table, offset_lsb, 1)}, times=3)
    # each bit of each comparison alone; between them the counts start again, not locked, then locked
    good, lost = {**common, "setpoint": 1 << 22}, {**common, **_lock_errors(p, 1 << 22, p.limit_out, 1, 1)}
    for table, between, times in ((p.limit_in, lost, longest_out), (p.limit_out, good, longest_in)):
        w.append_row(between, times=times)
        for magnitudes in zip(*(_single_bit_neighbours(limit) for limit in table), strict=True):
            for sign in (1, -1):
                w.append_row({**common, **_lock_errors(p, 1 << 22, (table[0], *magnitudes[1:]), 0, sign)})
                w.append_row(between)
        base = ((1 << 22) * table[0]) >> lock_monitor.FRACTION
        for error in _single_bit_neighbours(base):
            w.append_row({**common, "setpoint": 1 << 22, "agc_error": error})
            w.append_row(between)
        # the limit of the amplitude is a product: each of its bits, and the error at it +-1
        setpoints = [1 << k for k in range(8, 24)] + [w.random.draw_integer(1 << 24) for _ in range(24)]
        for setpoint in setpoints:
            for offset_lsb, sign in ((0, 1), (1, 1), (0, -1), (1, -1)):
                errors = _lock_errors(p, setpoint, table, offset_lsb, sign)
                w.append_row({**common, "setpoint": setpoint, "agc_error": errors["agc_error"]})
                w.append_row(between)
    for k in range(4):
        w.append_row({**common, "enable": 1 << k}, times=p.frames_in[k] + 1)
        w.append_row({**common, "judged": 15 ^ (1 << k)}, times=4)
    for word in range(16):
        w.append_row({**common, "enable": word, "judged": 15 ^ word}, times=2)
    # an error between both limits starts each count again
    between = {**common, **_lock_errors(p, 1 << 22, p.limit_out, 0, 1)}
    w.append_row(lost, times=longest_out)
    for pending, frames, times in ((good, p.frames_in, longest_in), (lost, p.frames_out, longest_out)):
        w.append_row(pending, times=min(frames) - 1)
        w.append_row(between)
        w.append_row(pending, times=times)
    # resets while counting and while locked
    for times in (2, longest_in):
        w.append_row({**common, **_lock_errors(p, 1 << 22, p.limit_in, 0, 1)}, times=times)
        w.append_row(common, rst=1)


def _append_constant_codes(w, p, common):
    """Codes at rest, all or one, clipped or not, one frame short of the debounce or longer; and by one bit at rest."""
    names = [f"codes_{k}" for k in range(4)]
    for times in (p.stuck, p.stuck + 1, p.stuck + 2):
        w.append_row({**common, "codes_2": times}, times=times)
    limit = fault_monitor.RANGE_LIMIT
    for name, code in itertools.product(names, (5, limit - 1, limit, 1 - limit, -limit)):
        for times in (p.stuck, p.stuck + 1, p.stuck + 2):
            for row in range(times):
                w.append_row({**common, **dict.fromkeys(names, 16 * times + row), name: code})
    # one bit of one code after the other, while all others move: it alone makes the code another, at both of its values
    code = 0
    for _ in range(2):
        for name, bit in itertools.product(names, range(fault_monitor.CODE.width)):
            w.append_row({**common, **dict.fromkeys(names, 2 * bit), name: code})
            code = wrap_to_format(code ^ (1 << bit), fault_monitor.CODE)
            w.append_row({**common, **dict.fromkeys(names, 2 * bit + 1), name: code})


def script_fault_monitor(w):
    """Every code around its limit, every symptom one frame short of its debounce, just as long, and longer."""
    p = w.block.cases[w.case]
    common = {"en": 1, "armed": 1, "fresh": 1, "watch_stuck": 1}
    longest = max(p._replace(top=0))
    if longest > LONG:
        top = fault_monitor.CODE.hi
        w.append_row({**common, "codes_0": top, "i_drive": 1, "i_rate": 1, "i_rail": 1}, times=longest + 3)
        w.append_row({**common, "fresh": 0}, times=2)
        return
    for k in range(4):
        for offset_lsb in (-1, 0, 1):
            for sign in (1, -1):
                code = sign * (fault_monitor.RANGE_LIMIT + offset_lsb)
                for row in range(p.over_range + 2):
                    w.append_row({**common, f"codes_{k}": code, f"codes_{k ^ 1}": row})
    for k in range(4):
        for sign in (1, -1):
            for code in around(sign * fault_monitor.RANGE_LIMIT, fault_monitor.CODE):
                w.append_row({**common, f"codes_{k}": code})
                w.append_row(common)
    for name, frames in (("drive", p.drive), ("rate", p.rate), ("rail", p.rail)):
        for times in (frames - 1, frames, frames + 1):
            for row in range(times):
                w.append_row({**common, "codes_0": row, f"i_{name}": 1})
            w.append_row({**common, "codes_0": -1})
    _append_constant_codes(w, p, common)
    w.append_row({**common, "fresh": 0}, times=5)
    for word in range(8):
        w.append_row({**common, "codes_1": word, "clear": 1 << word})
        w.append_row({**common, "codes_1": ~word, "levels": 1 << word, "clear": 1 << word})
    # a reset while every flag, the latch and the counters are up
    every = {
        **common,
        "codes_0": fault_monitor.CODE.hi,
        "i_drive": 1,
        "i_rate": 1,
        "i_rail": 1,
        "levels": fault_monitor.ALL,
    }
    w.append_row(every, times=longest + 2)
    w.append_row({**every, "fresh": 0})
    w.append_row(every, rst=1)
    w.append_row(common, times=2)
    # and while each symptom is counted in frames that are good
    for en in (1, 0):
        for row in range(2):
            w.append_row({**every, "codes_2": row, "codes_3": row, "levels": 0})
        w.append_row({**every, "en": en}, rst=1)
    # the counters of good and bad frames: through every carry below LONG_ROWS, in the quick case to their top
    w.append_row({**common, "fresh": 0})
    for fresh in (1, 0):
        w.append_row({**common, "fresh": fresh, "watch_stuck": 0}, times=fault_monitor.QUICK_TOP)
        w.append_row({"fresh": 1 - fresh}, times=2)
        w.append_row({**common, "fresh": fresh, "watch_stuck": 0}, times=LONG_ROWS - fault_monitor.QUICK_TOP)
    w.append_row({**common, "watch_stuck": 0}, times=2)


def script_spi_adc(w):
    d = w.block.record
    word, end, tail = spi_adc.word_clocks(d), 1 + spi_adc.read_clocks(d), d.adc_tail_clocks
    for status in (0xC00000, 0xCFFFFF, 0x800000, 0x400000, 0xD00000, 0xFFFFFF, 0):
        frame(w, w.random, status)
    for code in (0, 1, 0x800000, 0x7FFFFF, 0xFFFFFF, 0x555555, 0xAAAAAA):
        frame(w, w.random, rows=[code] * d.adc_channels)
    # a reset at every bit of the first word, within every other, at the end and in the tail
    words = [word * k + 17 for k in range(1, 1 + d.adc_channels)]
    ends = *range(end - 2, end + 3), end + tail - 20, *range(end + tail - 3, end + tail + 1)
    for rows in (*range(1, word + 8, 2), *words, *ends):
        begun = len(w.rows)
        frame(w, w.random)
        w.rows[begun + rows :] = []
        w.append_row({"drdy_n": 0, "dout": 1}, rst=1)
        w.append_row({"drdy_n": 1}, times=5)
    for cut in (1, 100):
        frame(w, w.random, cut=cut)
        w.append_row(times=end + 64)


def script_watchdog(w):
    p = w.block.cases[w.case]
    for ticks in (p.limit - 1, p.limit, p.limit + 1):
        w.append_row({"ce_1m": 1}, times=ticks)
        w.append_row(times=2)
        w.append_row({"frame": 1})
    w.append_row({"ce_1m": 1}, times=1030)
    w.append_row({"ce_1m": 1, "frame": 1})
    w.append_row({"ce_1m": 1}, times=p.limit + 2)
    w.append_row({"ce_1m": 1}, rst=1)
    w.append_row({"ce_1m": 1}, times=3)


def script_rates(w):
    frame_clocks = w.block.record.frame_clocks
    w.append_row(times=frame_clocks + 30)
    w.append_row({"go": 1}, times=3)
    w.append_row(times=rates.SLOTS + 3)
    # a reset in the last clock of a frame, where everything is about to wrap
    w.append_row(rst=1)
    w.append_row(times=frame_clocks - 1)
    w.append_row({"go": 1}, rst=1)
    w.append_row(times=3)
