"""Any law that is a product, at a port: coefficient x factors. What the catalogue is made of, and what data discover.

    PORT = COEFFICIENT FACTOR FACTOR ...      PORT: force_x force_y (N), cv_x cv_y (V)
    force_x = -2.5e9 x^3      force_y = -1e-9 abs(vx) vx      cv_y = 1e-6 u      force_y = -1e-5 lag(600) x

    x y (m)   vx vy (m/s)   u w (V): electrodes of drive and sense   cx cy (V): C/V outputs, at ports cv_* only
    NAME^n, sgn(NAME), abs(NAME)               of those, at most MOST_FACTORS in all
    rate (rad/s)   temp (K from the plant's temp_ref_degc)      the same forms, as they stand in a frame
    cos(F) sin(F): of 2 pi F t, F in Hz   lag(S) = 1 - e^(-t/S)   step(S) = 1 from S on;  t in s from power-on
    walk(S): random walk, variance t/S    flip(S): +1 or -1 at random, anew every S s     of the noise's seed

Applied   force: impulse on the velocity once per tick, from the states at its first instant, before any impulse, and
          the means of the electrodes about it, v + lead (v_end - v);
          C/V: mean over the tick from both of its ends, held over it.   Off: no law, bit for bit nothing, one branch
Source    docs/effects.md
"""

import math
import re
import zlib
from typing import NamedTuple

import numpy as np

from analog_frontend.effects.ports import CV_PORTS, FORCE_PORTS
from analog_frontend.parts import noise
from fpga_model.jit import inlined, outlined

SLOTS, MOST_FACTORS = 8, 6
PORTS = (*FORCE_PORTS, *CV_PORTS)
# places in the linear state of the plant (top.State.z)
STATES = {"u": 2, "w": 5, "x": 6, "vx": 7, "y": 8, "vy": 9, "cx": 12, "cy": 15}
VELOCITIES, OUTPUTS = ("vx", "vy"), ("cx", "cy")
UNITS = {"x": "m", "y": "m", "vx": "m/s", "vy": "m/s", "u": "V", "w": "V", "cx": "V", "cy": "V"}
UNITS |= {"rate": "rad/s", "temp": "K"}
TIMES = ("cos", "sin", "lag", "step", "walk", "flip")
PLAIN, ABS, SGN = 0, 16, 32  # added to the place of a state
# columns of `table`: which port, how many factors of the state, then power and dress of the surroundings
AT_PORT, COUNT, RATE_POWER, RATE_DRESS, TEMP_POWER, TEMP_DRESS, TIME, KEY0, KEY1, FIRST = range(10)
COLUMNS = FIRST + MOST_FACTORS
GAIN, TIME_ARGUMENT, END = NUMBERS = range(3)  # END: share of a tick's end in the mean over it
STRAIGHT = 0.5  # that of what moves little in a tick
NO_LEADS = np.zeros(2)
U, W = STATES["u"], STATES["w"]
OCTAVES = 24  # of a walk: 2^24 steps


class Factor(NamedTuple):
    """One factor: a state or what surrounds the plant, dressed and raised; a function of time has its argument."""

    name: str
    dress: int = PLAIN
    power: int = 1
    argument: float = 0.0

    def __str__(self):
        if self.name in TIMES:
            return f"{self.name}({self.argument:g})"
        name = {PLAIN: self.name, ABS: f"abs({self.name})", SGN: f"sgn({self.name})"}[self.dress]
        return name if self.power == 1 else f"{name}^{self.power}"


class Law(NamedTuple):
    """A coefficient (SI) times factors at a port."""

    port: str
    coefficient: float
    factors: tuple

    def __str__(self):
        return " ".join((f"{self.port} = {self.coefficient!r}", *map(str, self.factors)))

    @property
    def unit(self):
        """Unit of the coefficient."""
        divisor_units = [(UNITS[f.name], f.power) for f in self.factors if f.name in UNITS and f.dress != SGN]
        units = "N" if self.port in FORCE_PORTS else "V"
        powers = {}
        for unit, power in divisor_units:
            powers[unit] = powers.get(unit, 0) + power
        return units + "".join(f"/({u})^{n}" if n > 1 else f"/({u})" for u, n in powers.items())


class Params(NamedTuple):
    """Laws of a plant, those of the force ports first; arrays are read only."""

    force: int
    cv: int
    timed: int
    temp_ref_degc: float
    table: np.ndarray  # (SLOTS, COLUMNS) int64
    numbers: np.ndarray  # (SLOTS, 3): coefficient in the engine's units, argument of the function of time, END
    leads: np.ndarray  # (2,): ticks from the first instant on to where u and w stand at their means about it


_FACTOR = re.compile(r"(?:(sgn|abs|cos|sin|lag|step|walk|flip)\(\s*([^()\s]+)\s*\)|([a-z]+))(?:\^(\d+))?")


def parse(text):
    """`Law` of a text; ValueError says what is wrong with it."""
    where = f"law {text!r}"
    port, equals, right = (part.strip() for part in text.partition("="))
    if not equals or port not in PORTS:
        raise ValueError(f"{where}: expected 'PORT = coefficient factors', PORT one of {', '.join(PORTS)}")
    head, *factor_texts = right.replace("*", " ").split() or [""]
    try:
        coefficient = float(head)
    except ValueError:
        raise ValueError(f"{where}: {head!r} is not a coefficient") from None
    if not math.isfinite(coefficient):
        raise ValueError(f"{where}: coefficient {coefficient} is not finite")
    return check_law(Law(port, coefficient, tuple(_factor(item, where) for item in factor_texts)), where)


def _factor(item, where):
    factor_match = _FACTOR.fullmatch(item)
    if not factor_match:
        raise ValueError(f"{where}: {item!r} is not a factor")
    form, inside, name, power = factor_match.groups()
    power = int(power or 1)
    if form in TIMES:
        try:
            argument = float(inside)
        except ValueError:
            raise ValueError(f"{where}: {inside!r} is not a number (Hz or s)") from None
        low, high = (0.0, 1000.0) if form in ("cos", "sin") else (1e-3, 1e6)
        if not low <= argument <= high or power != 1:
            raise ValueError(f"{where}: {item} is outside {low:g} .. {high:g} {'Hz' if low == 0 else 's'}, power 1")
        return Factor(form, argument=argument)
    name = name or inside
    if name not in UNITS:
        raise ValueError(f"{where}: {name!r} is none of {', '.join((*UNITS, *(f'{t}(..)' for t in TIMES)))}")
    return Factor(name, {"abs": ABS, "sgn": SGN}.get(form, PLAIN), power)


def check_law(law, where="law"):
    """The law, if an engine can run it; ValueError."""
    states = sum(f.power for f in law.factors if f.name in STATES)
    if states > MOST_FACTORS or any(not 1 <= f.power <= MOST_FACTORS for f in law.factors):
        raise ValueError(f"{where}: more than {MOST_FACTORS} factors of the state")
    for name in (*law.factors,):
        inputs = [f.name for f in law.factors if f.name not in STATES]
        group = TIMES if name.name in TIMES else (name.name,)
        if name.name not in STATES and sum(n in group for n in inputs) > 1:
            raise ValueError(f"{where}: duplicate factor {name.name}")
    names = {f.name for f in law.factors}
    if law.port in FORCE_PORTS and names & set(OUTPUTS):
        raise ValueError(f"{where}: cx and cy are allowed only at the ports cv_x and cv_y")
    if law.port in CV_PORTS and names & set(VELOCITIES):
        raise ValueError(f"{where}: velocities are allowed only at the force ports")
    return law


def design(laws, mass_kg, h_s, w_rad_per_s, temp_ref_degc, seed=0, leads=(0.0, 0.0)):
    """`Params` of `Law`s for a mode of `mass_kg`, ticks of `h_s`, state scale W; zero coefficients are left out.

    leads   of u and w, whose voltages are staircases: `dac.end_share` less 1/2
    """
    if not (mass_kg > 0.0 and h_s > 0.0 and w_rad_per_s > 0.0):
        raise ValueError(f"law: mass {mass_kg} kg, tick {h_s} s, scale {w_rad_per_s} rad/s must be positive")
    on = sorted((law for law in laws if law.coefficient), key=lambda law: law.port in CV_PORTS)
    if len(on) > SLOTS:
        raise ValueError(f"law: {len(on)} laws are more than the {SLOTS} of a plant")
    table, numbers = np.zeros((SLOTS, COLUMNS), np.int64), np.zeros((SLOTS, len(NUMBERS)))
    for k, law in enumerate(on):
        scale = h_s / (mass_kg * w_rad_per_s) if law.port in FORCE_PORTS else 1.0
        codes = []
        for f in law.factors:
            if f.name in STATES:
                codes += [STATES[f.name] + f.dress] * f.power
                scale *= w_rad_per_s**f.power if f.name in VELOCITIES and f.dress != SGN else 1.0
            elif f.name in TIMES:
                table[k, TIME], numbers[k, TIME_ARGUMENT] = 1 + TIMES.index(f.name), f.argument
                key0, key1 = noise.keys(seed, "effect")
                table[k, KEY0], table[k, KEY1] = key0 ^ zlib.crc32(str(f).encode()), key1
            else:
                at = RATE_POWER if f.name == "rate" else TEMP_POWER
                table[k, at], table[k, at + 1] = f.power, f.dress
        table[k, AT_PORT], table[k, COUNT] = PORTS.index(law.port), len(codes)
        table[k, FIRST : FIRST + len(codes)] = codes
        numbers[k, GAIN] = law.coefficient * scale
        steps = [leads["uw".index(f.name)] for f in law.factors if f.name in ("u", "w")]
        numbers[k, END] = STRAIGHT + (sum(steps) / len(steps) if steps else 0.0)
    force = sum(law.port in FORCE_PORTS for law in on)
    timed, leads = int(table[:, TIME].any()), np.array(leads, float)
    return Params(force, len(on) - force, timed, float(temp_ref_degc), table, numbers, leads)


OFF = design((), 1.0, 1.0, 1.0, 0.0)


@inlined
def apply_dress(v, dress):
    """v, |v| or its sign; zero has none."""
    if dress == SGN:
        return 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
    if dress == ABS:
        return abs(v)
    return v


@inlined
def _cosine(turns):
    """cos 2 pi turns for 0 <= turns < 1, to 1e-9; no library function, so that every machine has the same bits."""
    v = abs(turns - 0.5) * 4.0 - 1.0  # quarter turns from the zero; rises where the cosine does
    x = v * 1.5707963267948966
    q = x * x
    s = 1.0 - q * (1.0 / 42) * (1.0 - q * (1.0 / 72) * (1.0 - q * (1.0 / 110) * (1.0 - q * (1.0 / 156))))
    return x * (1.0 - q * (1.0 / 6) * (1.0 - q * (1.0 / 20) * s))


@inlined
def _exp_decay(x):
    """e^-x for x >= 0, to 1e-9."""
    if x > 40.0:
        return 0.0
    small, n = x, 0
    while small > 0.03125:
        small, n = small * 0.5, n + 1
    e = 1.0 - small * (1.0 - small * 0.5 * (1.0 - small * (1.0 / 3) * (1.0 - small * 0.25 * (1.0 - small * 0.2))))
    for _ in range(n):
        e = e * e
    return e


@inlined
def _walk(key0, key1, steps):
    """Random walk of unit variance per step: octaves of straight lines between random nodes, each twice as long."""
    total, size, n = 0.0, 0.5, int(steps)
    for m in range(OCTAVES):
        part = (float(n & ((1 << m) - 1)) + (steps - n)) / (1 << m)
        first = noise.ih12(key0, key1, (n >> m) * 32 + m)
        second = noise.ih12(key0, key1, ((n >> m) + 1) * 32 + m)
        total = total + size * (first + part * (second - first))
        size = size * 1.4142135623730951
    return total


@inlined
def _in_time(kind, argument, t_s, key0, key1):
    if kind == 1 or kind == 2:
        turns = argument * t_s - (0.25 if kind == 2 else 0.0)
        return _cosine(turns - np.floor(turns))
    if kind == 3:
        return 1.0 - _exp_decay(t_s / argument)
    if kind == 5:
        return _walk(key0, key1, t_s / argument)
    if kind == 6:
        return 1.0 if noise.ih12(key0, key1, int(t_s / argument)) > 0.0 else -1.0
    return 1.0 if t_s >= argument else 0.0


@outlined
def gains(force, cv, temp_ref_degc, table, numbers, rate_rad_s, temp_degc, t_s, out):
    """Gains of all laws in a frame that begins at `t_s`: coefficient times what surrounds the plant. Mutates `out`."""
    for k in range(force + cv):
        g = numbers[k, GAIN]
        for _ in range(table[k, RATE_POWER]):
            g = g * apply_dress(rate_rad_s, table[k, RATE_DRESS])
        for _ in range(table[k, TEMP_POWER]):
            g = g * apply_dress(temp_degc - temp_ref_degc, table[k, TEMP_DRESS])
        if table[k, TIME]:
            keys = table[k, KEY0], table[k, KEY1]
            g = g * _in_time(table[k, TIME], numbers[k, TIME_ARGUMENT], t_s, keys[0], keys[1])
        out[k] = g


@inlined
def value(table, gain, k, w, state_offsets, at):
    """Law `k` from the states at w[state_offsets[state] + at]."""
    v = gain[k]
    for j in range(FIRST, FIRST + table[k, COUNT]):
        code = table[k, j]
        v = v * apply_dress(w[state_offsets[code & 15] + at], code & 48)
    return v


@inlined
def start_state(w, state_offsets, state, at, end, leads):
    """A state at a tick's first instant; of an electrode its mean about that instant."""
    v = w[state_offsets[state] + at]
    if state == U:
        return v + leads[0] * (w[state_offsets[U] + end] - v)
    if state == W:
        return v + leads[1] * (w[state_offsets[W] + end] - v)
    return v


@inlined
def impulses(force, table, gain, w, state_offsets, at, end, leads):
    """Impulses on vx/W and vy/W (m) of all force laws in one tick; `end` is the place of its last instant."""
    x, y = 0.0, 0.0
    for k in range(force):
        v = gain[k]
        for j in range(FIRST, FIRST + table[k, COUNT]):
            v = v * apply_dress(start_state(w, state_offsets, table[k, j] & 15, at, end, leads), table[k, j] & 48)
        if table[k, AT_PORT] == 0:
            x = x + v
        else:
            y = y + v
    return x, y


@inlined
def volts(force, cv, table, numbers, gain, w, state_offsets, at, end):
    """What all C/V laws add in one tick at the two outputs (V), from the states at both of its ends."""
    x, y = 0.0, 0.0
    for k in range(force, force + cv):
        share = numbers[k, END]
        v = (1.0 - share) * value(table, gain, k, w, state_offsets, at) + share * value(
            table, gain, k, w, state_offsets, end
        )
        if table[k, AT_PORT] == 2:
            x = x + v
        else:
            y = y + v
    return x, y
