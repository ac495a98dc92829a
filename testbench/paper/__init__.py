"""The paper's experiments and analysis: equations, loops, calibration, what is measured."""
