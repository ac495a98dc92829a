"""Single parts against recordings: each module states the model of a part as a problem that the tracing core reads.

Source  docs/measured_results.md
"""
