"""The analog plant around real RTL: somebody's `gyro_top` in place of the firmware's model, which runs beside it.

Source  docs/rtl.md
"""
