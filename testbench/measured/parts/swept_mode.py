"""A resonator under a frequency sweep: complex transmission S21 over frequency, one peak of it.

    S21 = path + K a,  path = b0 + b1 x + b2 x^2         quasi-static: a = 1 / (g/2 + 2 pi j (f - f0))
    swept: the source stays 1/r s on each frequency, a' = -(g/2 + 2 pi j (f - f0)) a + 1 from step to step exactly, the
    receiver takes the mean over the step: what rang at the last frequencies is still there, and beats
    nuisances   f0, ln g, K, b0 .. b2 of each fitted sweep       local unknowns of a judged sweep: the same
    second mode its f2, ln g2, K2 are nuisances and local unknowns as well, if `second_mode` finds one in the window
    laws        r (instrument); f0 and g that change with |K a|^2 (force_x: x^3, x^2 vx); receiver that waits first,
                source that kicks at each step (instrument); step of the path where S11 steps (instrument)
Envelope of one mode of `analog_frontend.parts.resonator`: a is its amplitude in the frame of the source.
Files become this problem in swept_resonator.py.   Source    docs/measured_results.md
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from fpga_model.jit import kernel
from testbench.measured.models.working import Working
from testbench.measured.parts.part import Part
from testbench.tracing.problem.problem import Law

SUBSTEPS = 4  # of a step, if the mode is not linear
SLOWEST = 1e-9  # points per s: below, the mode is always settled
LN_G2_SD = 0.3
TWO_PI = 2 * np.pi
PATH = ("b0", "b1", "b2")
PEAK_HALF_BAND_HZ = 1000.0  # of a peak, in the test of where the rest is
SPACINGS = 200
NUDGES = ((0.0, 0.0, 0.0), (1e-3, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-3))  # f0 (Hz), ln g, points per s
BINS = 4  # of a step, in the test of any waveform
STRONG = 0.1  # of the largest response: rows in which its phase is told from its size
BLOCK, TURNS = 4, 999  # rows that are turned together, and how often


class Sweep(NamedTuple):
    """Grid (Hz), abscissa -1 .. 1, and 1 where a step of the analyser is behind."""

    f_hz: np.ndarray
    x: np.ndarray
    step_mask: np.ndarray
    number: str


@kernel
def _envelope(f, f0, g, dwell, wait, kick, stiff, damp, substeps, out):
    """Mean of a over each step behind `wait` of it; stiff (Hz) and damp (1/s) per unit of |g a / 2|^2."""
    rate = g / 2 + 1j * TWO_PI * (f[0] - f0)
    a = 1.0 / rate
    for n in range(len(f)):
        a += kick
        total, h = 0.0j, dwell / substeps
        for k in range(substeps):
            rate = g / 2 + 1j * TWO_PI * (f[n] - f0)
            if stiff != 0.0 or damp != 0.0:  # amplitude in the middle of the substep: second order
                middle = a
                for _ in range(2):
                    size = abs(middle) * g / 2
                    rate = (g + damp * size * size) / 2 + 1j * TWO_PI * (f[n] - f0 - stiff * size * size)
                    middle = 1.0 / rate + (a - 1.0 / rate) * np.exp(-rate * h / 2)
                size = abs(middle) * g / 2
                rate = (g + damp * size * size) / 2 + 1j * TWO_PI * (f[n] - f0 - stiff * size * size)
            still = 1.0 / rate
            first = max(wait * substeps - k, 0.0)
            e = np.exp(-rate * h)
            if first < 1.0:
                total += still * (1.0 - first) + (a - still) * (np.exp(-rate * h * first) - e) / (rate * h)
            a = still + (a - still) * e
        out[n] = total / (substeps * (1.0 - wait))


@kernel
def _waveforms(f, frequency_shift_hz, f0, g, dwell, bins, out):
    """Column j bins + k: source on in bin j of each step alone, receiver in bin k alone; shift_hz: of f0."""
    h = dwell / bins
    for j in range(bins):
        a = 0.0j
        for n in range(len(f)):
            rate = g / 2 + 1j * TWO_PI * (f[n] - f0 - frequency_shift_hz[n])
            e = np.exp(-rate * h)
            for k in range(bins):
                still = 1.0 / rate if j == k else 0.0j
                out[n, j * bins + k] = still + (a - still) * (1.0 - e) / (rate * h)
                a = still + (a - still) * e


def _still(f_hz, f0_hz, g_per_s, stiff, damp):
    """a of a mode that is always settled: the fixed point of its own amplitude."""
    a = 1.0 / (g_per_s / 2 + 1j * TWO_PI * (f_hz - f0_hz))
    for _ in range(60 if stiff or damp else 0):
        square = (np.abs(a) * g_per_s / 2) ** 2
        a = 0.5 * a + 0.5 / ((g_per_s + damp * square) / 2 + 1j * TWO_PI * (f_hz - f0_hz - stiff * square))
    return a


def envelope(f_hz, f0_hz, g_per_s, effects):
    """a (n,) in s: quasi-static without the law `sweep_rate`."""
    rate = effects.get("sweep_rate", 0.0)
    stiff, damp = effects.get("duffing", 0.0), effects.get("damping_cubic", 0.0)
    if rate < SLOWEST:
        return _still(f_hz, f0_hz, g_per_s, stiff, damp)
    out = np.empty(len(f_hz), complex)
    dwell = 1.0 / rate
    kick = complex(effects.get("kick_re", 0.0), effects.get("kick_im", 0.0)) * 1e-6
    wait = float(np.clip(effects.get("receiver_wait", 0.0), 0.0, 0.95))
    substeps = SUBSTEPS if stiff or damp else 1
    _envelope(f_hz, f0_hz, g_per_s, dwell, wait, kick, stiff, damp, substeps, out)
    return out


def sweep_laws(has_steps, g, width_hz, level):
    def plant(name, text, unit, scale, sign=0):
        return Law(name, "force_x", text, unit, scale, sign, page=f"analog_frontend/effects/{name}.py")

    def analyser(name, text, unit, scale, sign=0):
        return Law(name, "instrument", text, unit, scale, sign, kind="instrument")

    laws = [
        analyser("sweep_rate", "sweep faster than the mode rings down", "points/s", 1000.0, 1),
        plant("duffing", "f0 that changes with the square of the amplitude", "Hz at full response", width_hz),
        plant("damping_cubic", "damping that grows with the square of the amplitude", "1/s at full response", g, 1),
        analyser("receiver_wait", "part of a step before the receiver measures", "1", 0.1, 1),
        analyser("kick_re", "source that is interrupted at each step", "us", 1.0),
        analyser("kick_im", "phase of the source that jumps at each step", "us", 1.0),
    ]
    if has_steps:
        laws += [
            analyser("path_step_re", "direct path that steps where S11 steps, real part", "1", 0.01 * level),
            analyser("path_step_im", "direct path that steps where S11 steps, imaginary part", "1", 0.01 * level),
        ]
    return laws


class SweptResonator(Part, adds="offset response any_waveform columns second"):
    """The problem; `Piece.data` is a `Sweep`, rows are real parts, then imaginary parts, in 1e-3."""

    unit, observable = "1e-3", "s21"
    most_laws = 5
    second = None  # second_mode.Second, if the window has one

    def columns(self, piece, q, effects):
        """(n, 4 or 5) of the linear unknowns at q = (f0, ln g, those of a second mode), and the step of the path."""
        g, x, f = float(np.exp(q[1])), piece.data.x, piece.data.f_hz
        a = envelope(f, q[0], g, effects) * g / 2
        other = []
        if len(q) > 2:  # it has no laws of its own
            g2, laws = float(np.exp(q[3])), {k: v for k, v in effects.items() if k not in ("duffing", "damping_cubic")}
            other = [envelope(f, q[2], g2, laws) * g2 / 2]
        step = complex(effects.get("path_step_re", 0.0), effects.get("path_step_im", 0.0)) * piece.data.step_mask
        return np.column_stack([a, np.ones(len(x)), x, x * x, *other]), step

    def _stack_real_imaginary(self, piece, q, linear, effects):
        columns, step = self.columns(piece, q, effects)
        s = columns @ linear + step
        return 1e3 * np.concatenate([s.real, s.imag])

    def model(self, piece, values, effects, local):
        return self._stack_real_imaginary(piece, *local, effects)

    def abscissa(self, piece):
        f = piece.data.f_hz - piece.data.f_hz[0]
        step = f[1] - f[0]
        return np.concatenate(
            [f, f[-1] + step + f]
        ), f"Hz above {piece.data.f_hz[0]:.0f}; imaginary part after the real part"

    def where(self, piece, residual, values, laws):
        """Of the rest's power: its share near the peak, its share across the response, `images` of the peak."""
        n = len(residual) // 2
        f = piece.data.f_hz[piece.scored[:n]] - piece.data.f_hz[0] - self.offset(piece, values, laws)
        power = residual[:n] ** 2 + residual[n:] ** 2
        in_peak_band, rate = np.abs(f) < PEAK_HALF_BAND_HZ, float(laws.get("sweep_rate", 0.0))
        residual_measures = {"near_hz": PEAK_HALF_BAND_HZ, "near_power": float(power[in_peak_band].sum() / power.sum())}
        residual_measures["near_rows"] = float(in_peak_band.mean())
        words = f"{100 * residual_measures['near_power']:.0f} % of its power "
        words += f"within {PEAK_HALF_BAND_HZ / 1e3:g} kHz of the peak, in "
        words += f"{100 * residual_measures['near_rows']:.0f} % of the rows"
        response = 1e3 * self.response(piece, values, laws)[piece.scored[:n]]
        share, p, phase = across(residual[:n] + 1j * residual[n:], response)
        residual_measures |= {"across": share, "across_p": p, "phase_mrad": 1e3 * phase}
        words += f"; where the response is strong {100 * share:.0f} % of it is orthogonal to the response "
        words += f"(by chance: half; p {p:.2g})"
        words += f", the phase differs by {1e3 * phase:.1f} mrad rms" if p < 0.05 else ""
        if rate > 0:
            residual_measures["any_waveform"] = best = self.any_waveform(piece, values, laws)
            words += "; any waveform of source and receiver, equal in all steps and fitted to this sweep, "
            words += f"leaves {best:.3g}e-3, {best / piece.floor:.2g} times the noise: "
            words += "the residual changes from step to step"
        if rate > 0 and np.ptp(f) > 5 * rate:
            ratio, p = images(f, power, rate)
            residual_measures |= {"images_ratio": ratio, "images_p": p, "images_hz": rate}
            images_text = "images of the peak there" if p < 0.05 else "no images of it there"
            words += f"; every {rate:.0f} Hz from the peak {ratio:.2f} times the power next to these points "
            words += f"(p {p:.2g}): {images_text}"
        return residual_measures | {"words": words}

    def offset(self, piece, values, laws):
        """Hz of the peak above the first row of a piece."""
        return float(self.locate(piece, values, laws)[0][0] - piece.data.f_hz[0])

    def response(self, piece, values, laws):
        """The mode's own part of S21, all rows."""
        q, linear = self.locate(piece, values, laws)
        return self.columns(piece, q, laws)[0][:, 0] * linear[0]

    def repeatability(self, values, laws):
        """{judged sweep: rms of what it and the fitted one do not share}; none unless they have the same frequencies.

        One sweep from the other by a complex factor, a path, and the model's change with f0 and g: the only part of it
        that is the model's. What is left is shared out between the two.
        """
        first, out = next(p for p in self.pieces if p.role == "fit"), {}
        q, _ = self.locate(first, values, laws)
        f0, ln_g, other = q[0], q[1], self.columns(first, q, laws)[0][:, 4:]
        y = [_complex(p.rows) for p in self.pieces]
        for piece, mine in zip(self.pieces, y):
            is_repeat = piece is not first and np.array_equal(piece.data.f_hz, first.data.f_hz)
            if not is_repeat or np.array_equal(piece.rows, first.rows):
                continue
            at = [envelope(first.data.f_hz, f0 + a, float(np.exp(ln_g + b)), laws) for a, b, _ in NUDGES]
            x = first.data.x
            bent = [at[1] - at[0], at[2] - at[0]]
            columns = np.column_stack([y[0], np.ones(len(x)), x, x * x, first.data.step_mask, other, *bent])
            columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            c = np.linalg.lstsq(columns, mine, rcond=None)[0]
            factor = abs(c[0]) / np.linalg.norm(y[0])
            unshared_residual = (mine - columns @ c)[piece.scored[: len(piece.scored) // 2]]
            out[piece.name] = float(np.sqrt(np.mean(np.abs(unshared_residual) ** 2) / 2 / (1 + factor**2)))
        return out

    def any_waveform(self, piece, values, laws):
        """rms of the scored rows at a least-squares fit, to this sweep itself, of any waveforms within a step.

        BINS^2 columns (source in one bin, receiver in another), path, and changes of f0, g and the rate; per freedom.
        """
        q, linear = self.locate(piece, values, laws)
        f0, ln_g, other = q[0], q[1], self.columns(piece, q, laws)[0][:, 4:]
        f, x, rate = piece.data.f_hz, piece.data.x, laws["sweep_rate"]
        size = np.abs(self.response(piece, values, laws) / linear[0]) ** 2
        frequency_shift_hz = laws.get("duffing", 0.0) * size
        columns = np.empty((len(f), BINS * BINS), complex)
        _waveforms(f, frequency_shift_hz, f0, float(np.exp(ln_g)), 1.0 / rate, BINS, columns)
        at = [envelope(f, f0 + a, float(np.exp(ln_g + b)), laws | {"sweep_rate": rate + c}) for a, b, c in NUDGES]
        bent = [other - at[0] for other in at[1:]]
        columns = np.column_stack([columns, np.ones(len(x)), x, x * x, piece.data.step_mask, other, *bent])
        columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        y = _complex(piece.rows)
        c, _, rank, _ = np.linalg.lstsq(columns, y, rcond=1e-12)
        residual = (y - columns @ c)[piece.scored[: len(piece.scored) // 2]]
        return float(np.sqrt(np.mean(np.abs(residual) ** 2) / 2 * len(y) / (len(y) - rank)))

    def working_at(self, values):
        k, f0 = abs(complex(values["k_re_1"], values["k_im_1"])), self.pieces[0].data.f_hz[0] + values["f0_1"]
        return Working("swept", self.working.amplitude / k, f0, TWO_PI * f0 / float(np.exp(values["ln_g_1"])))

    def locate(self, piece, values, effects):
        """Nuisances of a fitted sweep; else least squares on the setup rows, linear unknowns eliminated."""
        n = piece.data.number
        if piece.role == "fit":
            names = ("k", *PATH, "k2") if self.second else ("k", *PATH)
            linear = [complex(values[f"{c}_re_{n}"], values[f"{c}_im_{n}"]) for c in names]
            base = piece.data.f_hz[0]
            q = [base + values[f"f0_{n}"], values[f"ln_g_{n}"]]
            q += [base + values[f"f2_{n}"], values[f"ln_g2_{n}"]] if self.second else []
            return q, np.array(linear)
        half = len(piece.rows) // 2
        used = piece.setup[piece.setup < half]
        s = 1e-3 * (piece.rows[:half] + 1j * piece.rows[half:])
        second_mode_start = () if self.second is None else (self.second.f_hz - self.second.q[0], self.second.ln_g)
        return locate_mode(self.columns, piece, s, used, effects, second_mode_start)


def _complex(rows):
    return rows[: len(rows) // 2] + 1j * rows[len(rows) // 2 :]


def across(residual, response):
    """(share of a rest's power across the response, p, rms phase in rad) in the rows where the response is strong.

    A source whose phase wanders turns a ringing mode and leaves its size. p: share of random turns of blocks of rows
    in which as much lies across.
    """
    strong = np.abs(response) > STRONG * np.abs(response).max()
    e = (residual * np.conj(response) / np.maximum(np.abs(response), 1e-300))[strong]
    rng, blocks = np.random.default_rng(0), -(-len(e) // BLOCK)
    total = float(np.sum(np.abs(e) ** 2))
    power, count = float(np.sum(e.imag**2)), 0
    for _ in range(TURNS):
        turn = np.repeat(np.exp(2j * np.pi * rng.random(blocks)), BLOCK)[: len(e)]
        count += np.sum((e * turn).imag ** 2) >= power
    return power / total, (count + 1) / (TURNS + 1), float(np.sqrt(power / np.sum(np.abs(response[strong]) ** 2)))


def images(f_hz, power, rate_hz):
    """(power of a rest at multiples of `rate_hz` from 0 over that between them, p): is it at images of a peak at 0?

    Power is divided by its mean within `rate_hz` around, as the rest falls with the distance from the peak; `at` is a
    fifth of the spacing, the peak's own fifth is left out. p: share of other spacings, half to double, 5 % and more
    away, whose ratio is as large.
    """
    level = np.array([power[np.abs(f_hz - f) < rate_hz].mean() for f in f_hz])
    local = power / level

    def ratio(spacing):
        phase = (f_hz / spacing + 0.5) % 1.0 - 0.5
        at, away = np.abs(phase) < 0.1, np.abs(f_hz) > spacing / 2
        return local[at & away].mean() / local[~at & away].mean()

    trial_spacings = np.exp(np.linspace(np.log(0.5), np.log(2.0), SPACINGS))
    trial_spacings = rate_hz * trial_spacings[np.abs(trial_spacings - 1) > 0.05]
    observed_ratio = ratio(rate_hz)
    count = sum(ratio(spacing) >= observed_ratio for spacing in trial_spacings)
    return float(observed_ratio), float((count + 1) / (len(trial_spacings) + 1))


def locate_mode(columns_of, piece, s, used, effects, second_mode_start=()):
    """((f0, ln g, ..), linear unknowns) that fit s at `used`, from the quasi-static peak.

    second_mode_start   Hz of a second mode from the first, and ln of its g: where its own two unknowns start,
                        and are drawn to weakly (one width, LN_G2_SD), so that a weak one stays
    """
    f = piece.data.f_hz

    def solve(q):
        columns, step = columns_of(piece, q, effects)
        c = np.linalg.lstsq(columns[used], (s - step)[used], rcond=None)[0]
        complex_residual = (columns[used] @ c) - (s - step)[used]
        return c, complex_residual

    def residual_function(q):
        _, complex_residual = solve(q)
        if not np.all(np.isfinite(complex_residual)):
            return np.full(2 * len(used) + len(second_mode_start), 1e3)
        rows = 1e3 * np.concatenate([complex_residual.real, complex_residual.imag])
        if not second_mode_start:
            return rows
        drawn = (
            (q[2] - q[0] - second_mode_start[0]) / (np.exp(second_mode_start[1]) / TWO_PI),
            (q[3] - second_mode_start[1]) / LN_G2_SD,
        )
        return np.concatenate([rows, piece.floor * np.array(drawn)])

    edge = np.linspace(s[0], s[-1], len(s))
    peak = f[int(np.argmax(np.abs(s - edge)))]
    step_hz = f[1] - f[0]
    best = None
    spread = np.sqrt(step_hz * effects["sweep_rate"]) if effects.get("sweep_rate", 0.0) > 0 else step_hz
    for shift in (0.0, -0.6 * spread, -1.2 * spread):
        for width in (2 * step_hz, 10 * step_hz, 40 * step_hz):
            q = [peak + shift, np.log(TWO_PI * width)]
            q += [q[0] + second_mode_start[0], second_mode_start[1]] if second_mode_start else []
            value = np.sum(residual_function(q) ** 2)
            if best is None or value < best[0]:
                best = (value, q)
    solution = least_squares(
        residual_function,
        best[1],
        x_scale=[step_hz, 0.1] * (len(best[1]) // 2),
        diff_step=[1e-10, 1e-7] * (len(best[1]) // 2),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=60,
    )
    c, _ = solve(solution.x)
    return solution.x, c
