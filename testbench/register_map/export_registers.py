"""The register map in every format, in one folder that is whole or absent.

    gyro_registers.rdl            SystemRDL, from which the others are made
    c/gyro_registers.h            masks, places and reset values of fields, struct of the words: PeakRDL-cheader
    c/gyro_formats.h              address, format, unit and reset value of registers
    c/gyro_driver.h, .c           packing, CRC, conversion
    c/gyro_spi.h, .c              frames of the SPI port
    uvm/gyro_registers_pkg.sv     register model: PeakRDL-uvm
    ipxact/gyro_registers.xml     IEEE 1685-2014: PeakRDL-ipxact
    html/index.html               pages: PeakRDL-html

Nothing in them depends on time or place.
Source  docs/register_map.md
"""

import importlib
import re
import shutil
from pathlib import Path

from testbench.config import Config
from testbench.errors import ConfigError
from testbench.register_map import c_header, systemrdl
from testbench.register_map.systemrdl import NAME
from testbench.storage.files import replace_folder
from testbench.version import VERSION

RDL = f"{NAME}.rdl"
DRIVER = Path(__file__).with_name("driver")
DOC_PROPERTIES = ("gyro_format", "gyro_signed", "gyro_unit", "gyro_lsb", "gyro_low_bit")


def _package(name):
    """A package of the extra `registers`."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ConfigError(f"{name}: not installed; run pip install '.[registers]' in the clone") from None


def compiled(path):
    """Root of the register map in a SystemRDL file, by systemrdl-compiler."""
    compiler = _package("systemrdl").RDLCompiler()
    compiler.compile_file(str(path))
    return compiler.elaborate().top


def _c(top, folder, vref_v):
    cheader = _package("peakrdl_cheader.exporter")
    standard = _package("peakrdl_cheader.c_standards").CStandard.gnu99
    cheader.CHeaderExporter().export(top, str(folder / f"{NAME}.h"), std=standard)
    (folder / "gyro_formats.h").write_text(c_header.text(top, vref_v))
    for path in sorted(DRIVER.glob("*.[ch]")):
        shutil.copyfile(path, folder / path.name)


def _uvm(top, folder):
    exporter = _package("peakrdl_uvm").UVMExporter()
    # classes by the names of registers: those of a type would be anonymous
    exporter.export(top, str(folder / f"{NAME}_pkg.sv"), reuse_class_definitions=False)


def _ipxact(top, folder):
    exporter = _package("peakrdl_ipxact").IPXACTExporter(vendor="ftr-gyro", library="ftr-gyro", version=VERSION)
    exporter.export(top, str(folder / f"{NAME}.xml"))


def _html(top, folder):
    exporter = _package("peakrdl_html").HTMLExporter(
        generate_source_links=False, extra_doc_properties=list(DOC_PROPERTIES), user_context={"build_ts": 0}
    )
    exporter.export(top, str(folder))
    # MathJax from the network; no text of the map has a formula
    index = folder / "index.html"
    index.write_text(re.sub(r"\s*<script[^>]*mathjax.*?</script>", "", index.read_text(), flags=re.S | re.I))


FORMATS = {"uvm": _uvm, "ipxact": _ipxact, "html": _html}


def export(folder, config=None):
    """Write the folder; one that was written before is replaced. Paths of what to open first.

    config  checked `Config` of the board: its design and reference voltage; the default board if None

    ConfigError if a package is missing; FileError if the folder holds anything else or cannot be written
    """
    config, folder = config or Config(), Path(folder)
    with replace_folder(folder, RDL) as new:
        (new / RDL).write_text(systemrdl.text(config.design_record()))
        top = compiled(new / RDL)
        (new / "c").mkdir()
        _c(top, new / "c", config.device().adc_vref_v)
        for name, write in FORMATS.items():
            (new / name).mkdir()
            write(top, new / name)
    return [
        folder / RDL,
        *sorted((folder / "c").iterdir()),
        folder / "uvm" / f"{NAME}_pkg.sv",
        folder / "ipxact" / f"{NAME}.xml",
        folder / "html" / "index.html",
    ]
