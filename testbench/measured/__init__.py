"""Measured data: one record format for bench and simulation, its validator, and the residuals that locate a misfit.

Source  docs/measured.md
"""
