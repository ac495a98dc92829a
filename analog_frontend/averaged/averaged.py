"""Averaged plant, set-up: what a frame of n ticks (125) does to the slow amplitudes of the two modes, as tables.

    x = Re(X e^(i theta)), y likewise; theta the DDS phase.  A state is T (a_x, a_y, two slaved parts) e^(i theta)
    a     slow amplitudes (m) of the two modes; the two counter-rotating parts follow them: S(O, K) a + s F
    F     complex amplitude of each DAC's staircase (V), constant between two changes of its word

    tick     z' = M z + beta(phi) F e^(i theta)           M(O, K), beta: from the tick tables (propagator.py) alone
    slow     a' = L a + b F,   S D - D_- S = N_-+         N = T^-1 M T in blocks, second order in O and K
    frame    a(n) = rotor E(O, K) a + J(delta) F          E = (L e^(-i phi0))^n, J: sum over n ticks
    outputs  V = (alpha x + beta x'/W) T (a, S a + s F)   complex amplitude at the C/V outputs, exact at phi0

phi0      phase per tick of a fixed word, the drive mode's own; delta = phi - phi0, J a polynomial of degree 4 in it
Numbers   Python complex and MP (small_algebra.py). Knots of temperature as in propagator.py, linear in between, but for
          the diagonal of E, exponentials of interpolated logarithms
Source    docs/plant.md, docs/decisions/0014-baseband.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.exact import MP
from analog_frontend.numeric.small_algebra import exp, log, plus, solve_linear, times, unit
from analog_frontend.parts.propagator import F_X, F_Y, JETS, POWERS, U_DRIVE, U_SENSE

MODE = (6, 7, 8, 9)  # x, x'/W, y, y'/W among the states of a tick
DEGREE = 4
# of a turn a frame, 100 and 150 Hz at 8 kHz: nodes of the polynomials in delta, and where they are used no more
DELTA_TURNS, LIMIT_TURNS = 0.0125, 0.01875

# Places in a row of a knot. Pairs are (re, im); a matrix stands column by column, each (x or a_x, y or a_y)
ETA = 0  # 4: log of the tick's eigenvalues less i phi0, drive mode then sense mode
E = 4  # (6 jets, 8): E of a frame; the diagonal of jet 0 is not used
S = 52  # (2 jets, 8): slaved parts from a_x, from a_y; per rate, per stiffness
L = 68  # (2 jets, 8): generator per tick
PICK = 84  # (4, 4): C/V outputs of x and y from x+, y+, x-, y-
ROWS = 100  # (4, 8): of x+, y+, x-, y-: re of x, x'/W, y, y'/W, then im
SLAVED = 132  # (2, 4): slaved parts from F of the drive, of the sense DAC
RATES = 140  # (2, 4): growth per tick from F of the drive, of the sense DAC
OLD = 148  # (DEGREE + 1, 8): J of both DACs before their words change
NEW = 188  # the same after it
KXY, KQ, TICKS = 228, 229, 230  # k_xy (N/m), k_q (N/m/V^2), ticks to a frame: numbers
BACK = 232  # (2, 8): x+, y+ from x, x'/W, y, y'/W
CHAIN = 248  # (6, 2): output chain states from F of their DAC
LEVEL = 260  # (2, 2): DAC outputs from F
CV = 264  # (6, 2): C/V states from x, x'/W (numbers)
CROSS = 276  # (2 jets, 16): what rate and stiffness add to J of degree 0, before, after
LAWS = 308  # (2, 4): slaved parts from a velocity impulse of every tick at x, at y
SIZE = 316


class Lags(NamedTuple):
    """Rates, and lags of firmware and DACs from the phase register to an output; tuples: one value per DAC."""

    tick_clocks: int
    frame_ticks: int
    frame_hz: float
    code_ticks: tuple  # phase register to the tick in which the code acts, in ticks, whole and fraction
    cycle: tuple  # clock within that tick
    change_ticks: tuple  # when a changed word acts on the DAC's output, from the frame's first instant, in ticks
    turn_ticks: float  # when the frequency word changes


class Averaged(NamedTuple):
    """Tables of one gyroscope."""

    word0: int
    knots: np.ndarray  # (knots, SIZE)
    force: np.ndarray  # (ticks since a sample began, 4, samples, 2): `_noise_sample_growth`
    change_ticks: tuple  # when the modes see a changed word of each DAC, from the frame's first instant


def _real(values):
    return [part for v in values for part in (v.real, v.imag)]


def _columns(m):
    """Entries of a 2 x 2 matrix, column by column."""
    return [m[i][j] for j in range(2) for i in range(2)]


def _eigen(m):
    """Eigenvalues (x, y) of positive frequency and T with columns x+, y+, x-, y-, whose x (y) is 1; m real 4 x 4."""
    values, columns = [], []
    for mode in (0, 2):
        (a, b), (c, d) = (m[mode][mode], m[mode][mode + 1]), (m[mode + 1][mode], m[mode + 1][mode + 1])
        half = (a + d) / 2
        root = MP.sqrt(MP.mpc(half * half - (a * d - b * c)))
        value = complex(float(half.real), abs(float(root.imag)))
        vector = [[0j] for _ in range(4)]
        vector[mode][0], vector[mode + 1][0] = 1 + 0j, (value - a) / b
        # inverse iteration beside an eigenvalue loses all digits of doubles: in MP, rounded once at the end
        value = MP.mpc(value)
        for _ in range(5):
            eigenvalue_shift = value * (1 + MP.mpf(2) ** -80)
            shifted = [[m[i][j] - (eigenvalue_shift if i == j else 0) for j in range(4)] for i in range(4)]
            vector = solve_linear(shifted, vector)
            vector = [[v[0] / vector[mode][0]] for v in vector]
            value = sum(m[mode][k] * vector[k][0] for k in range(4))
        value, vector = complex(value), [[complex(v[0])] for v in vector]
        values.append(value)
        columns.append([v[0] for v in vector])
    columns += [[v.conjugate() for v in column] for column in columns]
    return values, [[columns[j][i] for j in range(4)] for i in range(4)]


def _steady(g, phi, excite):
    """Chain or C/V states driven at phase `phi` per tick: (z - A) c = excite; g (n, n) with the input first."""
    n = len(g)
    z = unit(phi)
    return solve_linear([[(z if i == j else 0) - g[j][i] for j in range(n)] for i in range(n)], [[v] for v in excite])


def _drive(g, step, first, dac_input_row, phi):
    """What a staircase of 1 V (new value e^(i phi k) in tick k) does: beta, the four modes per tick; and the chain."""
    lag = unit(-phi)
    chain = range(first, first + 3)
    u = [lag * g[dac_input_row][k] + (1 - lag) * step[k] for k in range(16)]
    c = _steady([[g[i][j] for j in chain] for i in chain], phi, [u[k] for k in chain])
    return [u[k] + sum(g[i][k] * c[i - first][0] for i in chain) for k in MODE], [v[0] for v in c]


def _dac_noise_response(g, first, dac_input_row, phi):
    """As `_drive` for a voltage added to the held output over whole ticks."""
    chain = range(first, first + 3)
    c = _steady([[g[i][j] for j in chain] for i in chain], phi, [g[dac_input_row][k] for k in chain])
    return [g[dac_input_row][k] + sum(g[i][k] * c[i - first][0] for i in chain) for k in MODE]


def _pick(g, q, first, phi, w_tick):
    """(alpha, beta) of the three C/V states: alpha x + beta x'/W, exact for a motion at phase `phi` per tick."""
    z = unit(phi)
    speed = 1j * float(phi) / w_tick
    chain = range(first, first + 3)
    excite = [(q[0][k] + q[1][k] * speed) + z * (q[2][k] + q[3][k] * speed) for k in range(3)]
    c = _steady([[g[i][j] for j in chain] for i in chain], phi, excite)
    return [(v[0].real, v[0].imag * w_tick / float(phi)) for v in c]


def _polynomial(nodes, values):
    """Coefficients of the polynomial of degree len(nodes) - 1 through complex values."""
    rows = [[complex(x**k) for k in range(len(nodes))] for x in nodes]
    return [v[0] for v in solve_linear(rows, [[v] for v in values])]


def _jet_product(a, b):
    out = [[[0j] * 2 for _ in range(2)] for _ in range(JETS)]
    for i, (p, q) in enumerate(POWERS):
        for j, (r, s) in enumerate(POWERS):
            if p + q + r + s <= 2:
                k = POWERS.index((p + r, q + s))
                out[k] = plus(out[k], times(a[i], b[j]))
    return out


def _knot(t, n, w_tick, phi0, lags):
    """One row of `Averaged.knots`, and T^-1, the eigenvalues and `Averaged.change_ticks`, from knot `n` of `t`."""
    g = t.g_jet[n]
    jets = [[[complex(g[j][k][i]) for k in MODE] for i in MODE] for j in range(JETS)]
    values, basis = _eigen([[float(g[0][k][i]) for k in MODE] for i in MODE])
    inverse = solve_linear(basis, [[complex(i == j) for j in range(4)] for i in range(4)])
    jets = [times(inverse, times(m, basis)) for m in jets]
    row = np.zeros(SIZE)
    logs = [log(v) for v in values]
    eta = [w - 1j * float(phi0) for w in logs]
    row[ETA : ETA + 4] = _real(eta)

    # slow map: L = N++ + N+- S, where S D - D_- S = N_-+ to first order
    positive_blocks = [[r[:2] for r in m[:2]] for m in jets]
    minus = [v.conjugate() for v in values]
    follow = [[[jets[k][2 + i][j] / (values[j] - minus[i]) for j in range(2)] for i in range(2)] for k in range(3)]
    slow = [[list(r) for r in m] for m in positive_blocks]
    slow[0] = [[values[0], 0j], [0j, values[1]]]
    for a in (1, 2):
        row[S + 8 * (a - 1) : S + 8 * a] = _real(_columns(follow[a]))
        for b in (1, 2):
            at = POWERS.index((POWERS[a][0] + POWERS[b][0], POWERS[a][1] + POWERS[b][1]))
            slow[at] = plus(slow[at], times([r[2:] for r in jets[a][:2]], follow[b]))
        for i in range(2):
            for j in range(2):
                spread = values[j] if i == j else (values[i] - values[j]) / (logs[i] - logs[j])
                at = L + 8 * (a - 1) + 2 * (2 * j + i)
                row[at : at + 2] = _real([slow[a][i][j] / spread])
    turned = unit(-phi0)
    per_tick = [[[turned * v for v in r] for r in m] for m in slow]
    power = [[[complex(k == 0 and i == j) for j in range(2)] for i in range(2)] for k in range(JETS)]
    for bit in bin(lags.frame_ticks)[2:]:
        power = _jet_product(power, power)
        if bit == "1":
            power = _jet_product(power, per_tick)
    for k in range(JETS):
        row[E + 8 * k : E + 8 * k + 8] = _real(_columns(power[k]))

    picks = []
    for c, first in ((0, 10), (1, 13)):
        states = _pick(g[0], t.pickoff[n][c], first, phi0, w_tick)
        row[CV + 6 * c : CV + 6 * c + 6] = [v for pair in states for v in pair]
        alpha, beta = states[2]
        picks.append([alpha * basis[2 * c][j] + beta * basis[2 * c + 1][j] for j in range(4)])
    row[PICK : PICK + 16] = _real([picks[c][j] for j in range(4) for c in range(2)])
    for j in range(4):
        row[ROWS + 8 * j : ROWS + 8 * j + 4] = [basis[i][j].real for i in range(4)]
        row[ROWS + 8 * j + 4 : ROWS + 8 * j + 8] = [basis[i][j].imag for i in range(4)]
    across = [[r[2:] for r in m[:2]] for m in jets]
    modes = Modes(inverse, values, eta, phi0, slow, across)
    changes = _forces(row, t, n, g[0], lags, modes)
    row[BACK : BACK + 16] = _real([v for r in inverse[:2] for v in r])
    for j, speed in enumerate((1, 3)):
        # an impulse acts before the tick's step: beta is its column of M
        slaved = [w * inverse[2 + i][speed] / (unit(phi0) - w) for i, w in enumerate(minus)]
        row[LAWS + 4 * j : LAWS + 4 * j + 4] = _real(slaved)
    row[KXY], row[KQ], row[TICKS] = t.kxy_n_per_m[n], t.kq_n_per_m_per_v2[n], lags.frame_ticks
    return row, inverse, values, changes


def _share(change, k):
    """Part of tick `k` before a change at `change` ticks."""
    return min(max(change - k, 0.0), 1.0)


def _crossing(b, pull, m, coupling, phi0, shares, d):
    """Growth in a frame of the mode that is not that of DAC `d`, per rate or stiffness: by F before, by F after."""
    turned, i = unit(-phi0), 1 - d
    out = []
    for new in (False, True):
        a, c = b[d] * 0, b[d] * 0
        for share in shares:
            f = 1 - share if new else share
            a, c = turned * (m[d][d] * a + b[d] * f), turned * (m[i][i] * c + coupling[i][d] * a + pull[i] * f)
        out.append(c)
    return out


class Modes(NamedTuple):
    """Modes of one knot: rows into them, their multipliers a tick, what a frame makes of them, the drive's angle."""

    inverse: list
    values: list
    eta: object
    phi0: object
    slow: list
    across: list


def _forces(row, t, n, g, lags, modes):
    """Places SLAVED, RATES, OLD and NEW of a row: what the two DACs do; returns `Averaged.change_ticks`."""
    inverse, values, eta, phi0, slow, across = modes
    changes = []
    ticks, nodes = lags.frame_ticks, [DELTA_TURNS * lags.frame_hz * k / 2 for k in range(-2, 3)]
    tick = t.tick_s[n]
    steps = (t.drive_step[n][0][lags.cycle[0]], t.sense_step[n][0][lags.cycle[1]])
    for d, (first, dac_input_row) in enumerate(((0, U_DRIVE), (3, U_SENSE))):
        # what a chain gives a mode after its input has gone is its delay's part of a whole tick
        speed = MODE[1 + 2 * d]
        chain_velocity_gain = sum(g[i][speed] for i in range(first, first + 3))
        change = lags.change_ticks[d] + float(chain_velocity_gain / (g[dac_input_row][speed] + chain_velocity_gain))
        changes.append(change)
        shares = [_share(change, k) for k in range(ticks)]
        olds, news = [[], []], [[], []]
        for hz in nodes:
            delta = 2 * MP.pi * MP.mpf(hz) * MP.mpf(tick)
            phi = phi0 + delta
            # the sine of the DDS phase: Re(-i e^(i theta)), `code_ticks` late
            sine = -1j * unit(-phi * MP.mpf(lags.code_ticks[d]))
            beta, chain = ([sine * v for v in part] for part in _drive(g, steps[d], first, dac_input_row, phi))
            b = [sum(inverse[i][k] * beta[k] for k in range(4)) for i in range(4)]
            if hz == 0:
                row[CHAIN + 6 * d : CHAIN + 6 * d + 6] = _real(chain)
                row[LEVEL + 2 * d : LEVEL + 2 * d + 2] = _real([sine * unit(-phi0)])
                slaved = [b[2 + i] / (unit(phi0) - values[i].conjugate()) for i in range(2)]
                row[SLAVED + 4 * d : SLAVED + 4 * d + 4] = _real(slaved)
                for jet in (1, 2):
                    pull = [sum(across[jet][i][k] * slaved[k] for k in range(2)) for i in range(2)]
                    growths = _crossing(b, pull, slow[0], slow[jet], phi0, shares, d)
                    for piece, value in enumerate(growths):
                        at = CROSS + 16 * (jet - 1) + 8 * piece + 4 * d + 2 * (1 - d)
                        row[at : at + 2] = _real([value])
                for i in range(2):
                    rate = b[i] * unit(-phi0) * (1 - eta[i] / 2)
                    row[RATES + 4 * d + 2 * i : RATES + 4 * d + 2 * i + 2] = _real([rate])
            back = unit(delta * (ticks - MP.mpf(lags.turn_ticks)))
            for i in range(2):
                old = new = 0j
                grown, per_tick = b[i] * unit(-phi), values[i] * unit(-phi)
                for share in reversed(shares):
                    old += share * grown
                    new += (1 - share) * grown
                    grown *= per_tick
                olds[i].append(old * back)
                news[i].append(new)
        scaled = [2 * float(MP.pi) * hz * tick for hz in nodes]
        for polynomial_offset, growths in ((OLD, olds), (NEW, news)):
            for i in range(2):
                for degree, value in enumerate(_polynomial(scaled, growths[i])):
                    at = polynomial_offset + 8 * degree + 4 * d + 2 * i
                    row[at : at + 2] = _real([value])
    return tuple(changes)


def design(tables, word0, lags, hold, w_rad_per_s):
    """`Averaged` of the stacked tables of propagator.py.

    word0        frequency word (turns per clock / 2^48) whose phase per tick is phi0
    lags         Lags
    hold         ticks over which a noise sample of force or DAC is held
    w_rad_per_s  W of x'/W
    """
    phi0 = 2 * MP.pi * lags.tick_clocks * MP.mpf(word0) / 2**48
    rows = []
    for n in range(len(tables.tick_s)):
        w_tick = w_rad_per_s * float(tables.tick_s[n])
        row, inverse, values, changes = _knot(tables, n, w_tick, phi0, lags)
        rows.append(row)
        if n == len(tables.tick_s) // 2:
            middle = (tables.g_jet[n][0], inverse, values, changes)
    g, inverse, values, changes = middle
    exciting = (
        [g[F_X][k] for k in MODE],
        [g[F_Y][k] for k in MODE],
        _dac_noise_response(g, 0, U_DRIVE, phi0),
        _dac_noise_response(g, 3, U_SENSE, phi0),
    )
    gains = [2 * sum(inverse[s % 2][k] * vector[k] for k in range(4)) for s, vector in enumerate(exciting)]
    return Averaged(word0, np.array(rows), _noise_sample_growth(gains, values, lags.frame_ticks, hold), changes)


def _noise_sample_growth(gains, values, ticks, hold):
    """Growth in a frame per N or V of each sample of noise: x by force, y by force, x by DAC, y by DAC; re, im.

    A frame may begin `since` ticks behind the first tick of a sample, if no whole number of them fills it.
    """
    grown = [[exp(growth * (ticks - 1 - k)) for k in range(ticks)] for growth in map(log, values[:2])]
    begins = range(hold if ticks % hold else 1)
    out = np.zeros((len(begins), 4, -(-(begins[-1] + ticks) // hold), 2))
    for since in begins:
        for s, gain in enumerate(gains):
            for j in range(-(-(since + ticks) // hold)):
                part = slice(max(hold * j - since, 0), hold * (j + 1) - since)
                out[since, s, j] = _real([gain * sum(grown[s % 2][part], 0j)])
    return out
