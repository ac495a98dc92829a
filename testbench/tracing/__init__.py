"""From a residual to its cause: calibration, alarms, ranking, refit, evidence, hold-out, discovery, report.

Pure linear algebra on what a `Problem` predicts: no engine, no recording, no physics.
Source    docs/tracing.md
"""
