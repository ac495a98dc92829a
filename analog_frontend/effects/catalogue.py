"""The catalogue's laws: every module of this folder that has `terms`. Nothing lists them, so an effect is one file.

    INFO         `ports.Info`; its name is that of the module and of the key in [effects]
    IDS          id of its own, "E30" or "E12b", then those of other rows that it belongs to, with commas
    LIMIT        largest size of the key;   EXAMPLE: size in its table;   SIGN: 1 if the size cannot be negative
    DOC          what the key's size is, for docs/configuration.md
    PHYSICS      (low, high, reason) of the size, where its law alone does not say it (closed_loop/loop_limits.py)
    terms        (value, device) -> texts of `law.parse`; off is a size of 0, and then no law at all

No module with kernels imports an effect of the catalogue, so that a new or changed one compiles nothing.
The three effects with kernels of their own (duffing, drive_cubic, feedthrough_y) stand in effects.EFFECTS.
Source    docs/effects.md
"""

import importlib
import pkgutil

from analog_frontend import effects
from analog_frontend.effects import law

# impulses of a port are added, and keys of a configuration written, in this order; other effects follow by name
FIRST = (
    "damping_cubic damping_quadratic coulomb_friction pickoff_cubic_x feedthrough_x damping_coupling coupling_warm_up "
    "softening_drive softening_sense sense_cubic centrifugal dispersive quadrature_cubic bias_cubic pickoff_drift "
    "pickoff_warm_up carrier_ripple carrier_beat thermoelastic_bias frequency_walk burst_noise sid_absorption "
    "parasitic_mode acceleration"
).split()


def _effect_sort_key(module):
    name = module.INFO.name
    return (FIRST.index(name), "") if name in FIRST else (len(FIRST), name)


def _effect_modules():
    names = (module_info.name for module_info in pkgutil.iter_modules(effects.__path__, f"{effects.__name__}."))
    modules = [importlib.import_module(name) for name in names if name != __name__]
    return tuple(sorted((m for m in modules if hasattr(m, "terms")), key=_effect_sort_key))


LAWS = _effect_modules()


def laws(effect, value, device):
    """`law.Law`s of a module of LAWS at a size, for a plant; none for 0."""
    return [law.parse(text) for text in effect.terms(float(value), device)] if value else []
