"""`gyro golden export --c DIR`: the firmware as C99, and what runs golden bundles through it.

    DIR/Makefile     make check, make sanitize, make lib, make size, make instructions
    DIR/model/       a header and a source for each module of the firmware; blocks.h has all blocks by name
    DIR/check/       the program that reads bundles
    DIR/embedded/    the firmware on a small processor, and a program that counts its instructions
    DIR/dpi/         scoreboards in SystemVerilog
    DIR/golden/      bundles

Nothing in it needs Python or this repository.
Source  docs/c_model.md
"""

from pathlib import Path

from analog_frontend.parts import adc_serial
from testbench.errors import ConfigError
from testbench.golden.bundles import design_entry
from testbench.golden.c_model import dpi, flat_ports
from testbench.golden.c_model.c_kinds import NUMBER, infer_kind
from testbench.golden.recording import recording
from testbench.storage.files import replace_folder

TEMPLATES = Path(__file__).with_name("templates")
GOLDEN = "golden"
FOLDER_BY_STEM = {"gyro_dpi": "dpi"}
MODEL = ("integers.h", "integers.c", "blocks.h", "blocks.c")


def firmware(config=None):
    """`top.Params` of a configuration file, or those of the shipped golden vectors."""
    return recording.load("power_on").params if config is None else design_entry.read_board_config(config)[1]


def model(params, extend=None):
    """{name: text} of headers and sources of a firmware (`top.Params`).

    extend(program, c_block)  writes more functions; `c_block` is the whole design
    """
    program, c_blocks = flat_ports.translate_firmware(params)
    return _model(program, c_blocks, extend)


def _model(program, c_blocks, extend=None):
    # the digital side of the converter, which answers the firmware in the runner
    chip = infer_kind(adc_serial.State())
    program.declare(chip)
    codes = infer_kind((0,) * adc_serial.CHANNELS)
    program.function(adc_serial.step, (NUMBER, chip, NUMBER, NUMBER, NUMBER, NUMBER, codes))
    for name in program.design._fields:
        program.key(name)
    if extend:
        extend(program, c_blocks[-1])
    files = {name: (TEMPLATES / name).read_text() for name in MODEL}
    for stem in program.parts:
        files[f"{stem}.h"] = program.header(stem)
        files[f"{stem}.c"] = program.source(stem)
    return files | {"blocks_of_design.c": flat_ports.text(program, c_blocks)}


def c_folder_texts(params):
    """{path: text} of a folder of C for a firmware (`top.Params`)."""
    program, c_blocks = flat_ports.translate_firmware(params)
    files = {"Makefile": (TEMPLATES / "Makefile").read_text()}
    for path in sorted(TEMPLATES.iterdir()):
        if path.suffix in (".c", ".h", ".sv") and path.name not in MODEL:
            files[f"{FOLDER_BY_STEM.get(path.stem, 'check')}/{path.name}"] = path.read_text()
    files |= {f"embedded/{path.name}": path.read_text() for path in sorted((TEMPLATES / "embedded").iterdir())}
    files |= {f"model/{name}": text for name, text in _model(program, c_blocks).items()}
    return files | dpi.dpi_texts(c_blocks)


def export(folder, config=None, fill=None):
    """Write the C of a configuration's firmware to `folder`; returns the paths. What else is there stays.

    fill  function that writes more into the new folder, which takes its place as a whole
    """
    folder, files = Path(folder), c_folder_texts(firmware(config))
    for path in sorted(folder.glob("*/*.[ch]")):
        if path.relative_to(folder).as_posix() not in files:
            raise ConfigError(
                f"{path} is not part of this model, but make would compile it; move it, or choose another folder"
            )
    with replace_folder(folder, keep=True) as new:
        for name, text in files.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)
        if fill:
            fill(new)
    return [folder / name for name in files]
