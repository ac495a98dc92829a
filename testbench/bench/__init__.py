"""Speed of the engines and of comparators on the same machine in the same run.

kernels    what is timed of ours: both engines, firmware alone, plant alone, the source without compiler
peers      the same firmware core and plant as RTL (Verilator, Icarus) and as C, and the peak of the CPU
measure    rounds in which all take turns, tables, build/bench.json, docs/speed.md
"""
