"""The paper's experiments and analysis (docs/paper.md): equations, loops, calibration, what is measured."""
