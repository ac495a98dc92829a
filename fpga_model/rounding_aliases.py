"""What other tools call each rounding rule: "tool:name" -> the neutral name in `fixed.ROUNDINGS`.

The same word means different rules in different tools ("nearest", "trunc", "Convergent"), so the tool is part of the
key. A rule of another tool that is missing here has no twin among ours (APyTypes TO_AWAY, TIES_ODD, TRN_MAG, JAM and
the stochastic ones; cl_fix ConvOdd_s).

tests/fpga_model/test_truth_table.py tries Python, NumPy, APyTypes, Verilog and fixed_pkg at every run. Tried by hand:
fxpmath 0.4.10, fixedpoint 1.0.1 (`sel`), fpbinary 1.5.8, numfi 0.5.0. From documentation: cl_fix, ap_fixed, MATLAB fi.
"""

_NAMES = {
    "floor": {
        "apytypes": ("TO_NEG",),
        "cl_fix": ("Trunc_s",),
        "ap_fixed": ("AP_TRN",),
        "fixed_pkg": ("fixed_truncate",),
        "fpbinary": ("direct_neg_inf",),
        "sel": ("down",),
        "fxpmath": ("floor",),
        "numfi": ("Floor",),
        "matlab_fi": ("Floor",),
        "verilog": (">>>",),
        "python": ("//", ">>", "math.floor"),
    },
    "ceil": {
        "apytypes": ("TO_POS",),
        "sel": ("up",),
        "fxpmath": ("ceil",),
        "numfi": ("Ceiling",),
        "matlab_fi": ("Ceiling",),
        "python": ("math.ceil",),
    },
    "toward_zero": {
        "apytypes": ("TO_ZERO",),
        "ap_fixed": ("AP_TRN_ZERO",),
        "fpbinary": ("direct_zero",),
        "sel": ("in",),
        "fxpmath": ("trunc", "fix"),
        "numfi": ("Zero",),
        "matlab_fi": ("Zero",),
        "verilog": ("/", "$rtoi"),
        "python": ("int", "math.trunc", "astype(int)"),
    },
    "half_up": {
        "apytypes": ("TIES_POS",),
        "cl_fix": ("NonSymPos_s",),
        "ap_fixed": ("AP_RND",),
        "fpbinary": ("near_pos_inf",),
        "sel": ("nearest",),
        "matlab_fi": ("Nearest",),
    },
    "half_down": {
        "apytypes": ("TIES_NEG",),
        "cl_fix": ("NonSymNeg_s",),
        "ap_fixed": ("AP_RND_MIN_INF",),
    },
    "half_even": {
        "apytypes": ("TIES_EVEN",),
        "cl_fix": ("ConvEven_s",),
        "ap_fixed": ("AP_RND_CONV",),
        "fixed_pkg": ("fixed_round",),
        "fpbinary": ("near_even",),
        "sel": ("convergent",),
        "fxpmath": ("around",),
        "matlab_fi": ("Convergent",),
        "python": ("round", "numpy.round"),
    },
    "half_away": {
        "apytypes": ("TIES_AWAY",),
        "cl_fix": ("SymInf_s",),
        "ap_fixed": ("AP_RND_INF",),
        "sel": ("out",),
        "numfi": ("Nearest", "Round", "Convergent"),
        "matlab_fi": ("Round",),
        "verilog": ("real to integer",),
    },
    "half_zero": {
        "apytypes": ("TIES_ZERO",),
        "cl_fix": ("SymZero_s",),
        "ap_fixed": ("AP_RND_ZERO",),
        "fpbinary": ("near_zero",),
    },
}

ALIASES = {f"{tool}:{name}": rule for rule, tools in _NAMES.items() for tool, names in tools.items() for name in names}
