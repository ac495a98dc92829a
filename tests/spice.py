"""Circuits as ngspice netlists, run in a temporary folder; the truth that averaged formulas are held against."""

import shutil
import subprocess
from pathlib import Path

import numpy as np

NGSPICE = shutil.which("ngspice")
SECONDS_LIMIT = 300


def ring_diode(
    carrier_v=5.0,
    carrier_hz=8e6,
    c0_f=2e-12,
    dc_f="0",
    stray_f=3e-12,
    cref_f=50e-12,
    is_a=2.2e-8,
    n=1.08,
    cj0_f=0.0,
    vj_v=0.65,
    m=0.5,
    eg_ev=0.69,
    xti=2.0,
    vj_per_k=0.0,
    temp_degc=27.0,
    stop_s=6e-6,
):
    """Four diodes, two moving capacitors, two reference capacitors; `dc_f` may be an expression of `time`.

    The moving capacitors are given by their charge, so that their own motion carries current.
    """
    half, edge = 0.5 / carrier_hz, 50e-12
    return f"""ring diode
Vcar car 0 PULSE({-carrier_v / 2} {carrier_v / 2} 0 {edge} {edge} {half - edge} {2 * half})
Cplus car a q='({c0_f}+({dc_f}))*(v(car)-v(a))'
Cminus car b q='({c0_f}-({dc_f}))*(v(car)-v(b))'
Castray a 0 {stray_f}
Cbstray b 0 {stray_f}
D1 a c schottky
D2 c b schottky
D3 b d schottky
D4 d a schottky
Crefc c 0 {cref_f}
Crefd d 0 {cref_f}
Rc c 0 1e12
Rd d 0 1e12
.model schottky D(IS={is_a} N={n} RS=6 CJO={cj0_f} VJ={vj_v} M={m} BV=15 IBV=1e-4 EG={eg_ev} XTI={xti}
+ TLEV=0 TLEVC=1 TPB={vj_per_k} TNOM=27)
.options reltol=1e-6 abstol=1e-13 vntol=1e-9 chgtol=1e-19 trtol=1 gmin=1e-15 temp={temp_degc}
.tran 1n {stop_s} 0 0.5n uic
.control
run
wrdata out.txt v(c) v(d)
quit
.endc
.end
"""


def run(netlist, folder):
    """Times and one array per printed vector; raises with ngspice's own words when it fails."""
    folder = Path(folder)
    (folder / "circuit.cir").write_text(netlist)
    done = subprocess.run(
        [NGSPICE, "-b", "circuit.cir"], cwd=folder, capture_output=True, text=True, timeout=SECONDS_LIMIT, check=False
    )
    out = folder / "out.txt"
    if not out.exists():
        raise RuntimeError(f"ngspice left no output ({done.returncode}): {done.stdout[-1500:]}{done.stderr[-1500:]}")
    table = np.loadtxt(out)
    return table[:, 0], [table[:, k] for k in range(1, table.shape[1], 2)]


def mean(times, values, start, stop):
    """Time average over start .. stop of a piecewise linear waveform."""
    inner = (times > start) & (times < stop)
    t = np.concatenate([[start], times[inner], [stop]])
    v = np.interp(t, times, values)
    return np.trapezoid(v, t) / (stop - start)
