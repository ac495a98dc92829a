"""What any law puts into its port along a recorded trajectory, as two shares of what the port's own states are.

    v(theta) = Re(V e^(i theta))     phasors of x vx y vy u w cx cy, theta: phase of the DDS
    force    F = 2/N sum f e^(-i theta)
    C/V      as a square-wave demodulator sees it about its reference: (c1 - c3/3 + c5/5) - i (s1 + s3/3 + s5/5)
    shares   F = a B1 + b B2, a and b real     B: x and vx at the forces, cx and u at the C/V outputs
x, u, cx are those of the locked state; w follows the rate word, y the plant's own motion, cy the motion y.
Source    docs/measured.md
"""

import numpy as np

from analog_frontend.effects import law
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench.engines import engine
from testbench.measured.closed_loop import loop_runs
from testbench.measured.residual import features
from testbench.run import build

BASIS = {"force_x": ("x", "vx"), "force_y": ("x", "vx"), "cv_x": ("cx", "u"), "cv_y": ("cx", "u")}
POINTS = 64  # of a turn
PROBED_FRAMES, KICK_RAD_S = 512, 2.0  # of a step of the rate, which shows how w and cy follow word and motion
WINDOW_TICKS = 1000  # 11 turns
TURN = 1 << 48
FRAME_HZ = TICK_HZ / FRAME_TICKS
NODES = {"x": "x", "y": "y", "u": "d3", "w": "s3", "cx": "cv_x", "cy": "cv_y"}
MOTION = {"vx": "x", "vy": "y"}
FORCE, AMPLITUDE, FREQUENCY = (
    [name for name, _, _ in engine.FRAME_COLUMNS].index(name)
    for name in ("rate_word", "amplitude_word", "frequency_word")
)


def phasors(theta, values):
    """(windows,) phasors of a signal at phases theta (turns), by least squares with a constant."""
    out = []
    for first in range(0, len(values) - WINDOW_TICKS + 1, WINDOW_TICKS):
        span = slice(first, first + WINDOW_TICKS)
        angle = 2 * np.pi * theta[span]
        design = np.stack([np.cos(angle), -np.sin(angle), np.ones(WINDOW_TICKS)], axis=1)
        re, im, _ = np.linalg.lstsq(design, values[span], rcond=None)[0]
        out.append(re + 1j * im)
    return np.array(out)


def _word_block_means(words, step):
    """(2, blocks) means of words and of their changes a frame: an electrode follows its word by some frames."""
    words = words.astype(float)
    return np.stack([words, np.gradient(words)]).reshape(2, -1, step).mean(axis=2)


def probe(bench, run):
    """{state: phasor} of x cx, of `u` `w` per LSB of words and their changes, of `cy` per y, after a kick."""
    rate = np.deg2rad(loop_runs.before_dps(run.condition)) + KICK_RAD_S
    out = bench.probe_run(run, PROBED_FRAMES, rate)
    theta = out.probe_ints[:, 0] / TURN
    nodes = {name: phasors(theta, out.probe_floats[:, engine.PROBE_FLOATS.index(node)]) for name, node in NODES.items()}
    step = WINDOW_TICKS // FRAME_TICKS
    states = {name: nodes[name].mean() for name in ("x", "cx")}
    config, tick_turns = run.model.config, np.mean(np.diff(theta) % 1.0)
    leads = build.electrode_leads(config, config.device())
    for name, column, lead in (("u", AMPLITUDE, leads[0]), ("w", FORCE, leads[1])):
        words = _word_block_means(out.frames[: step * len(nodes[name]), column], step)
        # a port takes the mean of a staircase, which is that much further on
        states[name] = np.linalg.lstsq(words.T, nodes[name], rcond=None)[0] * np.exp(2j * np.pi * lead * tick_turns)
    states["cy"] = np.vdot(nodes["y"], nodes["cy"]) / np.vdot(nodes["y"], nodes["y"])
    return states


def trajectory(run, states, rows):
    """{state: (blocks,) phasors} of a run's rows, rate (rad/s), temperature and s from power-on; states: `probe`."""
    first, settle = loop_runs.settling(run) % loop_runs.BLOCK, loop_runs.settling(run)
    end = settle + loop_runs.frame_count(run.condition.seconds)
    end -= (end - first) % loop_runs.BLOCK

    def mean(values):
        return values[first:end].reshape(-1, loop_runs.BLOCK).mean(axis=1)

    x, vx, y, vy, temp, rate = rows.truth[:end].T
    quarter = np.sqrt(np.mean(x[first:] ** 2) / np.mean(vx[first:] ** 2))
    out = {"y": states["x"] * mean((y - 1j * quarter * vy) / (x - 1j * quarter * vx))}
    words = {"u": AMPLITUDE, "w": FORCE}
    out |= {
        name: states[name] @ _word_block_means(rows.frames[first:end, column], loop_runs.BLOCK)
        for name, column in words.items()
    }
    out |= {name: np.full(len(out["y"]), states[name]) for name in ("x", "cx")}
    w_rad_s = 2 * np.pi * features.HZ * rows.frames[end - 1, FREQUENCY]
    out |= {"vx": 1j * w_rad_s * out["x"], "vy": 1j * w_rad_s * out["y"], "cy": states["cy"] * out["y"]}
    t_s = (
        loop_runs.begin_tick(run) / FRAME_TICKS + first + loop_runs.BLOCK * (np.arange(len(out["y"])) + 0.5)
    ) / FRAME_HZ
    return out | {"rate": mean(rate), "temp": mean(temp), "s": t_s}


def _apply_sign_or_abs(values, dress):
    return np.sign(values) if dress == law.SGN else np.abs(values) if dress == law.ABS else values


def envelope(one, states, temp_ref_degc):
    """(blocks,) phasors of what a `law.Law` puts into its port."""
    # zeros of a state whose sign is taken stand midway between points
    dressed = [f.name for f in one.factors if f.dress and f.name in NODES | MOTION]
    crest = np.exp(-1j * np.angle(states[(dressed or ["x"])[0]]))[:, None]
    turn = crest * np.exp(2j * np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    value = np.full(turn.shape, one.coefficient)
    for f in one.factors:
        if f.name == "lag":
            v = 1 - np.exp(-states["s"][:, None] / f.argument)
        elif f.name in ("rate", "temp"):
            v = (states[f.name] - (temp_ref_degc if f.name == "temp" else 0.0))[:, None]
        else:
            v = np.real(states[f.name][:, None] * turn)
        value = value * _apply_sign_or_abs(v, f.dress) ** f.power
    # the reference of the demodulators stands where the loop holds cx
    about = np.exp(1j * np.angle(states["cx"][0])) if one.port in law.CV_PORTS else 1.0
    turn = turn * about
    first, third, fifth = (2 / POINTS * np.sum(value * np.conj(turn) ** n, axis=1) for n in (1, 3, 5))
    if one.port in law.FORCE_PORTS:
        return first
    in_phase_component = np.real(first) - np.real(third) / 3 + np.real(fifth) / 5
    return (in_phase_component + 1j * (np.imag(first) + np.imag(third) / 3 + np.imag(fifth) / 5)) * about


def shares(one, states, temp_ref_degc):
    """Two (blocks,) shares of a law in the `BASIS` of its port."""
    f, (b1, b2) = envelope(one, states, temp_ref_degc), (states[name] for name in BASIS[one.port])
    return [np.imag(np.conj(q) * f) / np.imag(np.conj(q) * b) for b, q in ((b1, b2), (b2, b1))]
