"""The cocotb test: replay, rows and signature in Python, clock by clock.

Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from analog_frontend.parts import adc_serial
from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import HALF_PS, PARTS
from testbench.golden.bundles.top_benches.layout import DEFAULT_FRAMES, PART_BITS, SHOWN_ROWS
from testbench.golden.recording import signature


def cocotb_test(block, case):
    """cocotb test (1.9 and 2) that is its own runner: RTL=folder python3 test_top.py."""
    stem = block.stem
    width = sum(p.width for _, p in benches.results(block))
    parts = -(-width // PART_BITS)
    return f'''"""cocotb test of {stem}/{case}: RTL=folder FRAMES=n python3 test_{stem}.py (Icarus; 0: all)."""

import json
import os
import sys
from pathlib import Path

TITLE = "{stem}/{case}"
HERE = Path(__file__).resolve().parent
SOURCES = {(*PARTS[stem], stem)!r}
FRAMES = int(os.environ.get("FRAMES") or {DEFAULT_FRAMES["cocotb"]})
HALF_PS = {HALF_PS}
WORD_BITS, PULSE = {adc_serial.WORD_BITS * adc_serial.WORDS}, {adc_serial.PULSE}
ROW_BITS = {signature.padded(width)}
POLYNOMIAL = {signature.POLYNOMIAL:#x}
POWER = {signature.POWER}

try:
    import cocotb
    from cocotb.triggers import Timer
except ImportError:
    sys.exit("cocotb is not installed: pip install cocotb")


def words(name):
    return [int(line, 16) for line in (HERE / name).read_text().split()]


def remainder(value):
    """Of a polynomial over GF(2) modulo the signature's, folded at powers of it first."""
    power = POWER
    while power:
        low = 64 * power
        while value >> low:
            high, value = value >> low, value & ((1 << low) - 1)
            for tap in {signature.TAPS!r}:
                value ^= high << tap * power
        power //= 2
    return value


class Converter:
    """The ADS1298 after each edge, with the pins as they are then."""

    def __init__(self):
        self.conversions = [(word >> WORD_BITS, word & ((1 << WORD_BITS) - 1)) for word in words("adc.hex")][::-1]
        self.cs_n, self.sclk, self.drdy_n, self.dout = 1, 0, 1, 0
        self.pulse = self.result = self.shift = 0

    def step(self, edge, cs_n, sclk):
        loaded = bool(self.conversions) and self.conversions[-1][0] == edge
        drdy_n, pulse = self.drdy_n, self.pulse
        if pulse:
            self.pulse -= 1
            if pulse == 1:
                self.drdy_n = 0
        if loaded:
            self.result = self.conversions.pop()[1]
            if drdy_n == 0:
                self.drdy_n, self.pulse = 1, PULSE
            elif pulse == 0:
                self.drdy_n = 0
        if cs_n != self.cs_n:
            self.dout, self.shift = 0, 0 if cs_n else self.result
        elif not cs_n and sclk != self.sclk:
            if sclk:
                self.dout = self.shift >> (WORD_BITS - 1)
                self.shift = self.shift << 1 & ((1 << WORD_BITS) - 1)
            elif not loaded and pulse == 0:
                self.drdy_n = 1
        self.cs_n, self.sclk = cs_n, sclk


def fields(word, ports):
    """Unsigned values of ports packed side by side."""
    values = []
    for port in reversed(ports):
        values.append(word & ((1 << port["width"]) - 1))
        word >>= port["width"]
    return values[::-1]


@cocotb.test()
async def golden(dut):
    manifest = json.loads((HERE / "manifest.json").read_text())
    inputs = manifest["inputs"]
    names = [{{**port, "name": "r_" + port["name"]}} for port in manifest["registers"]]
    names += [{{**port, "name": "o_" + port["name"]}} for port in manifest["outputs"]]
    frame_cycles, tick = manifest["frame_cycles"], manifest["tick_cycles"]
    frames = min(FRAMES or manifest["frames"], manifest["frames"])
    at, stim, exp, sig = words("at.hex"), words("stim.hex"), words("exp.hex"), words("sig.hex")
    host, sar, adc = words("host.hex")[::-1], words("sar.hex"), Converter()
    parts = [getattr(dut, f"got_{{k}}") for k in reversed(range({parts}))]
    dut.clk.value = 0
    for port in inputs:
        getattr(dut, port["name"]).value = 1 if port["name"] in ("rst", "drdy_n") else 0
    for _ in range(manifest["reset"]["cycles"]):
        await Timer(HALF_PS, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    wrong, row, stream, busy = 0, 0, 0, True
    fed = dict.fromkeys([port["name"] for port in inputs], 0)
    for n in range(frames * frame_cycles):
        if n:
            adc.step(n - 1, int(str(dut.adc_cs_n.value) == "1"), int(str(dut.adc_sclk.value) == "1"))
        now = {{**fed, "rst": 0, "write": 0, "drdy_n": adc.drdy_n, "dout": adc.dout}}
        if host and host[-1] >> 60 == n:
            event = host.pop()
            if event >> 56 & 1:
                now["rst"] = 1
            else:
                now.update(write=1, address=event >> 48 & 0xFF, data=event & ((1 << 48) - 1))
        if n % tick == 0 and n // tick < len(sar):
            now.update(sample_x=sar[n // tick] >> 18, sample_y=sar[n // tick] & ((1 << 18) - 1))
        for name, value in now.items():
            if busy or value != fed[name]:
                getattr(dut, name).value = value
        fed, busy = now, False
        await Timer(HALF_PS - 1, "ps")
        text = "".join([str(part.value) for part in parts])
        got = int(text, 2) if set(text) <= set("01") else None
        stream = stream << ROW_BITS | (got or 0)
        if stream.bit_length() > 64 * POWER:
            stream = remainder_of_rows(stream)
        if row < len(at) and at[row] == n:
            given = 0
            for port in inputs:
                given = given << port["width"] | fed[port["name"]]
            if got != exp[row] or given != stim[row]:
                wrong += 1
                if wrong <= {SHOWN_ROWS}:
                    report(n, names, exp[row], got, text)
                    report(n, inputs, stim[row], given, "")
            row += 1
        if n % frame_cycles == frame_cycles - 1:
            frame = n // frame_cycles
            if remainder(stream) != sig[frame]:
                wrong += 1
                first, got_sig = frame * frame_cycles, remainder(stream)
                print(f"frame {{frame}} (clocks {{first}} .. {{n}}): signature: expected {{sig[frame]:016x}},"
                      f" got {{got_sig:016x}}", flush=True)
            stream = 0
        await Timer(1, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    if wrong:
        print(f"FAIL {{TITLE}}: {{wrong}} rows or frames differ", flush=True)
    assert wrong == 0


def remainder_of_rows(value):
    """One fold at the largest power: the stream stays short."""
    low = 64 * POWER
    high, value = value >> low, value & ((1 << low) - 1)
    for tap in {signature.TAPS!r}:
        value ^= high << tap * POWER
    return value


def report(n, ports, expected, got, text):
    """One line for each port that differs."""
    if got is None:
        print(f"clock {{n}}: unknown bits among the results: {{text[:40]}} ...", flush=True)
        return
    for port, want, have in zip(ports, fields(expected, ports), fields(got, ports)):
        if want != have:
            print(f"clock {{n}}: {{port['name']}}: expected {{want:x}}, got {{have:x}} (hex)", flush=True)


def main():
    try:
        from cocotb_tools.runner import get_runner
    except ImportError:
        from cocotb.runner import get_runner
    rtl, sim = os.environ.get("RTL", ""), os.environ.get("SIM") or "icarus"
    if not rtl:
        print(f"NO DESIGN {{TITLE}}: no design was given")
        return
    sources = [Path(rtl).resolve() / f"{{part}}.v" for part in SOURCES]
    if not sources[-1].is_file():
        sys.exit(f"FAIL {{TITLE}}: no design {{sources[-1]}}")
    build = HERE / "build" / f"cocotb-{{sim}}"
    runner = get_runner(sim)
    files = [HERE / "cocotb_{stem}.v", *(path for path in sources if path.is_file())]
    more = ["-Wno-fatal", "-Wno-lint", "-Wno-style"] if sim == "verilator" else []
    runner.build(sources=files, includes=[HERE], hdl_toplevel="cocotb_{stem}", build_dir=build, build_args=more,
                 always=True)
    (build / "results.xml").unlink(missing_ok=True)
    done = runner.test(hdl_toplevel="cocotb_{stem}", test_module=Path(__file__).stem, build_dir=build, test_dir=HERE,
                       results_xml=str(build / "results.xml"), extra_env={{"PYTHONDONTWRITEBYTECODE": "1"}})
    text = Path(done).read_text()
    if "<failure" in text or "<error" in text or "<testcase" not in text:
        sys.exit(1)
    print(f"PASS {{TITLE}}: {{FRAMES or 'all'}} frames")


if __name__ == "__main__":
    main()
'''
