"""The Verilog of control and top: heads and instances are what declarations and wires say."""

import re
import shutil

import pytest

from fpga_model import delay
from testbench.errors import FileError
from testbench.golden import rtl_wiring
from tests.testbench.rtl.test_rtl import RTL


def copied(folder, name="", change=lambda text: text):
    for each in rtl_wiring.FILES:
        shutil.copy(RTL / each, folder)
    if name:
        text = (folder / name).read_text()
        assert change(text) != text
        (folder / name).write_text(change(text))
    return folder


def test_nothing_is_stale():
    assert rtl_wiring.stale() == {}
    assert rtl_wiring.main(["--check"]) == 0


WRONG = [
    ("top.v", "[DDS_BITS-1:0] r_dds_phase,  ", "[DDS_BITS-2:0] r_dds_phase,  "),
    ("top.v", ".off_sense_ref (r_registers_phase_sense_ref)", ".off_sense_ref (r_registers_phase_drive_ref)"),
    ("top.v", ".depth    (pipe_depth)", ".depth    (4'd3)"),
    ("top.v", ".amplitude (r_control_rate_loop_loop_y[23:0])", ".amplitude (r_control_rate_loop_loop_y)"),
    ("control.v", "        .adjust     (adjust),\n", ""),
    ("control.v", "output wire signed [35:0] r_agc_loop_y", "output wire        [35:0] r_agc_loop_y"),
    ("control.v", "parameter signed [23:0] agc_kick", "parameter signed [22:0] agc_kick"),
]


@pytest.mark.parametrize(("name", "right", "wrong"), WRONG)
def test_a_slip_is_stale_and_written_right(tmp_path, name, right, wrong):
    copied(tmp_path, name, lambda text: text.replace(right, wrong, 1))
    assert {path.name: text for path, text in rtl_wiring.stale(tmp_path).items()} == {name: (RTL / name).read_text()}


def test_an_instance_grows_from_its_name(tmp_path):
    """All but the nets that are named by hand."""
    whole = re.compile(r"gyro_watchdog #.*? watchdog \(.*?\n    \);", re.S)
    copied(tmp_path, "top.v", lambda text: whole.sub("gyro_watchdog watchdog ();", text))
    text = rtl_wiring.stale(tmp_path)[tmp_path / "top.v"]
    assert text == (RTL / "top.v").read_text()


def test_a_missing_instance_is_one_clear_line(tmp_path):
    copied(tmp_path, "control.v", lambda text: text.replace(" cordic (\n", " turner (\n"))
    with pytest.raises(FileError, match=r"control\.v: no instance cordic; write `gyro_cordic cordic \(\);` where it"):
        rtl_wiring.stale(tmp_path)


def test_ports_follow_the_declaration(monkeypatch, tmp_path):
    """Another width of the delay's words is another width in all ports of top that carry them."""
    hints = {"taps": [delay.X._replace(f=19)] * delay.MAX_DEPTH}
    monkeypatch.setattr(delay.State, "__annotations__", hints)
    rtl_wiring.wiring.trace.cache_clear()
    text = rtl_wiring.Design(rtl_wiring.top, copied(tmp_path) / "top.v").regenerate_text()
    rtl_wiring.wiring.trace.cache_clear()
    assert len(re.findall(r"output wire signed \[19:0\] r_\w+_pipe_taps_\d, +// \[1,0,19\]", text)) == 16


def test_usage(capsys):
    assert rtl_wiring.main(["--now"]) == 2
    assert "usage" in capsys.readouterr().err
