"""The engines of a campaign: `gyro run` without its files. All but lanes take one point to a call, lanes eight.

Points in lanes have the bytes of the frame engine's, so they are kept as such: one is found where the other has run.
Source  docs/campaigns.md, docs/decisions/0012-lanes.md
"""

import functools
import math

from testbench.campaign.plan.engines import Engine

# of the clock on the wall, or the same for every point
LEFT_OUT = ("real_time_factor", "wall_s", "paper_deg", "window_missing", "seed")


def flat(summary):
    """{name: number, text or None} of the summary of a run; nested names are joined by a dot."""
    out = {}
    for name, value in summary.items():
        if name in LEFT_OUT:
            continue
        if isinstance(value, dict):
            out |= {f"{name}.{key}": item for key, item in value.items()}
        elif isinstance(value, (list, tuple)):
            out[name] = " ".join(value)
        else:
            out[name] = value
    return out


def _play(name, configs, sinks):
    return [_one(name, one, sink) for one, sink in zip(configs, sinks)]


def _one(name, one, sink, engine_run=None):
    from testbench import config
    from testbench.run import simulate

    result = simulate.run(config.changed(one, {"scenario.engine": name}), sinks=(sink,), engine_run=engine_run)
    return flat(result.summary)


def play_frame(configs, sinks):
    """As `engines` says, by the frame engine."""
    return _play("frame", configs, sinks)


def play_clocked(configs, sinks):
    """As `engines` says, by the clocked engine."""
    return _play("clocked", configs, sinks)


def play_baseband(configs, sinks):
    """As `engines` says, by the baseband engine; a point outside its validity fails with its ConfigError."""
    return _play("baseband", configs, sinks)


def play_lanes(configs, sinks):
    """As `engines` says, by the lanes engine; what it cannot do the frame engine does."""
    from testbench.run import side_by_side

    return side_by_side.play([functools.partial(_one, "frame", *point) for point in zip(configs, sinks)])


def alike(config):
    """What points should have in common to be worth a call of the lanes engine: one start, lengths within twofold."""
    s = config.scenario
    return config.firmware.board, s.resume, s.origin, s.diagnose, math.frexp(s.seconds)[1]


def _compile():
    from testbench.run import warmup

    warmup.warm_up()


def _compile_lanes():
    from testbench.run import warmup

    warmup.warm_up(lanes=True)
    warmup.compile_lanes()


MODULES = ("testbench.campaign.played", "testbench.run.simulate")
FRAME = Engine(play_frame, 1, MODULES, _compile)
CLOCKED = Engine(play_clocked, 1, MODULES)
BASEBAND = Engine(play_baseband, 1, MODULES, _compile)
LANES = Engine(play_lanes, 8, MODULES, _compile_lanes, alike, twin="frame")
