"""The engines of a campaign: `gyro run` without its files, one point to a call.

`lanes` is a name of the frame engine: runs in lanes gained nothing, and their points have the same bytes.
Source  docs/campaigns.md, docs/decisions/0013-runs-side-by-side.md
"""

from testbench.campaign.plan.engines import Engine

# of the clock on the wall, or of the configuration alone
LEFT_OUT = ("real_time_factor", "wall_s", "paper_deg", "paper_verdict", "amplifier_use", "window_missing", "seed")


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
    from testbench import config
    from testbench.run import simulate

    played = [config.changed(one, {"scenario.engine": name}) for one in configs]
    return [flat(simulate.run(one, sinks=(sink,)).summary) for one, sink in zip(played, sinks)]


def play_frame(configs, sinks):
    """As `engines` says, by the frame engine."""
    return _play("frame", configs, sinks)


def play_clocked(configs, sinks):
    """As `engines` says, by the clocked engine."""
    return _play("clocked", configs, sinks)


def play_baseband(configs, sinks):
    """As `engines` says, by the baseband engine; a point outside its validity fails with its ConfigError."""
    return _play("baseband", configs, sinks)


def _compile():
    from testbench.run import warmup

    warmup.warm_up()


MODULES = ("testbench.campaign.played", "testbench.run.simulate")
FRAME = Engine(play_frame, 1, MODULES, _compile)
CLOCKED = Engine(play_clocked, 1, MODULES)
BASEBAND = Engine(play_baseband, 1, MODULES, _compile)
LANES = FRAME._replace(twin="frame")
