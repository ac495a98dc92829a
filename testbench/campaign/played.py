"""The frame and the clocked engine for campaigns: `gyro run` without its files, one point to a call.

Source  docs/campaigns.md
"""

from testbench.campaign.engines import Engine

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
    from testbench import config, simulate

    out = []
    for one, sink in zip(configs, sinks):
        result = simulate.run(config.changed(one, {"scenario.engine": name}), sinks=(sink,))
        out.append(flat(result.summary))
    return out


def play_frame(configs, sinks):
    """As `engines` says, by the frame engine."""
    return _play("frame", configs, sinks)


def play_clocked(configs, sinks):
    """As `engines` says, by the clocked engine."""
    return _play("clocked", configs, sinks)


def _compile():
    from testbench import warmup

    warmup.warm_up()


MODULES = ("testbench.campaign.played", "testbench.simulate")
FRAME = Engine(play_frame, 1, MODULES, _compile)
CLOCKED = Engine(play_clocked, 1, MODULES)
