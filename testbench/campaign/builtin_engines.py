"""The engines of a campaign: `gyro run` without its files, one point to a call.

`lanes` is a name of the frame engine: runs in lanes gained nothing, and their points have the same bytes.
Source  docs/campaigns.md, docs/decisions/0013-runs-side-by-side.md
"""

from testbench.campaign.plan.engines import Engine

# of the clock on the wall, or of the configuration alone
EXCLUDED_KEYS = ("real_time_factor", "wall_s", "paper_deg", "paper_verdict", "amplifier_use", "window_missing", "seed")


def flatten_summary(summary):
    """{name: number, text or None} of the summary of a run; nested names are joined by a dot."""
    out = {}
    for name, value in summary.items():
        if name in EXCLUDED_KEYS:
            continue
        if isinstance(value, dict):
            out |= {f"{name}.{key}": item for key, item in value.items()}
        elif isinstance(value, (list, tuple)):
            out[name] = " ".join(value)
        else:
            out[name] = value
    return out


def _run_on_engine(name, configs, sinks):
    from testbench import config
    from testbench.run import simulate

    engine_configs = [config.changed(one, {"scenario.engine": name}) for one in configs]
    return [flatten_summary(simulate.run(one, sinks=(sink,)).summary) for one, sink in zip(engine_configs, sinks)]


def run_frame_points(configs, sinks):
    """As `engines` says, by the frame engine."""
    return _run_on_engine("frame", configs, sinks)


def run_clocked_points(configs, sinks):
    """As `engines` says, by the clocked engine."""
    return _run_on_engine("clocked", configs, sinks)


def run_baseband_points(configs, sinks):
    """As `engines` says, by the baseband engine; a point outside its validity fails with its ConfigError."""
    return _run_on_engine("baseband", configs, sinks)


def _compile():
    from testbench.run import warmup

    warmup.warm_up()


MODULES = ("testbench.campaign.builtin_engines", "testbench.run.simulate")
FRAME = Engine(run_frame_points, 1, MODULES, _compile)
CLOCKED = Engine(run_clocked_points, 1, MODULES)
BASEBAND = Engine(run_baseband_points, 1, MODULES, _compile)
LANES = FRAME._replace(equivalent_to="frame")
