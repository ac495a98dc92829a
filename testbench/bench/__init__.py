"""Speed of the engines and of comparators on the same machine in the same run.

kernels    what is timed of ours: both engines, firmware alone, plant alone, the source without compiler
peers      the reference RTL (Verilator, Icarus) around chips and plant in C++, and the peak of the CPU
c_firmware the firmware in C around the plant in C++, against the clocked engine
measure    rounds in which all take turns, tables, build/bench.json, docs/speed.md
"""
