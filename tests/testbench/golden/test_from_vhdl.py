"""Verilog of a design in VHDL: GHDL runs the VHDL, Icarus what is made of it, and both show the same."""

import random
import shutil

import pytest

from testbench.errors import FileError
from testbench.golden.foreign.rtl_sources import Sources
from testbench.golden.loop import from_vhdl
from tests.testbench.rtl.test_rtl import ran

BOTH = pytest.mark.skipif(
    not (shutil.which("ghdl") and shutil.which("iverilog")), reason="no ghdl, or no iverilog: synthesis was NOT tried"
)
# `others` is a constant, another net and the register itself; one constant has 48 bits
DESIGN = """library ieee;
use ieee.std_logic_1164.all;
entity chooser is
    port (
        clk : in  std_logic;
        x   : in  std_logic_vector(2 downto 0);
        a   : out std_logic_vector(47 downto 0);
        b   : out std_logic;
        c   : out std_logic_vector(1 downto 0)
    );
end entity;
architecture rtl of chooser is
begin
    with x select a <= x"4759524F0001" when "001", x"000000000007" when "010", x"800000000000" when others;
    process (clk)
    begin
        if rising_edge(clk) then
            case x is
                when "000"  => b <= '0';
                when "011"  => b <= x(0);
                when others => null;
            end case;
            case x is
                when "100"  => c <= "01";
                when "101"  => c <= "10";
                when others => c <= x(1) & b;
            end case;
        end if;
    end process;
end architecture;
"""
VHDL_BENCH = """library ieee;
use ieee.std_logic_1164.all;
entity bench is end entity;
architecture sim of bench is
    type words is array (natural range <>) of std_logic_vector(2 downto 0);
    constant GIVEN : words := ({given});
    signal clk, b : std_logic := '0';
    signal x, y : std_logic_vector(2 downto 0) := "000";
    signal a : std_logic_vector(47 downto 0);
    signal c : std_logic_vector(1 downto 0);
begin
    dut : entity work.chooser port map (clk => clk, x => x, a => a, b => b, c => c);
    process
    begin
        for k in GIVEN'range loop
            x <= GIVEN(k);
            wait for 1 ns;
            report to_string(a) & to_string(b) & to_string(c);
            clk <= '1';
            wait for 1 ns;
            clk <= '0';
        end loop;
        wait;
    end process;
end architecture;
"""
VERILOG_BENCH = """module bench;
    reg clk = 0;
    reg [2:0] x, given [0:{last}];
    wire [47:0] a;
    wire b;
    wire [1:0] c;
    integer k;
    chooser dut (.clk(clk), .x(x), .a(a), .b(b), .c(c));
    initial begin
        $readmemb("given.txt", given);
        for (k = 0; k <= {last}; k = k + 1) begin
            x = given[k];
            #1 $display("%b%b%b", a, b, c);
            clk = 1;
            #1 clk = 0;
        end
    end
endmodule
"""


def made(folder):
    (folder / "chooser.vhd").write_text(DESIGN)
    return from_vhdl.synthesise_vhdl(Sources((folder / "chooser.vhd",), ("",)), "chooser", folder, "test")


@BOTH
def test_the_verilog_is_the_vhdl(tmp_path):
    draw = random.Random(1)
    given = ["000", "100", *(f"{draw.randrange(8):03b}" for _ in range(200))]
    path = made(tmp_path)
    (tmp_path / "bench.vhd").write_text(VHDL_BENCH.format(given=", ".join(f'"{word}"' for word in given)))
    ran(["ghdl", "-a", "--std=08", "chooser.vhd", "bench.vhd"], tmp_path)
    said = ran(["ghdl", "--elab-run", "--std=08", "bench"], tmp_path).splitlines()
    expected = [line.rsplit(" ", 1)[1] for line in said]
    (tmp_path / "given.txt").write_text("\n".join(given))
    (tmp_path / "bench.v").write_text(VERILOG_BENCH.format(last=len(given) - 1))
    ran(["iverilog", "-g2005", "-o", "bench.vvp", str(path), "bench.v"], tmp_path)
    found = ran(["vvp", "-n", "bench.vvp"], tmp_path).split()
    assert found[2:] == expected[2:], "the registers have values behind two edges"
    assert len({row[:48] for row in found}) == 3
    assert len(found) == len(given)


VERILOG = """    case (n4_o)
      2'b10: n5_o <= n1_o;
      2'b01: n5_o <= "010";
    endcase
"""
VHDL = """  with n4_o select n5_o <=
    n1_o when "10",
    "010" when "01",
    {others} when others;
"""


@pytest.mark.parametrize(("others", "value"), [('"1X-"', "3'b1XX"), ("'Z'", "1'bZ"), ("n9_o", "n9_o")])
def test_a_case_gets_its_default_and_a_constant_its_size(others, value):
    found = from_vhdl.repair_netlist(VERILOG, VHDL.format(others=others))
    text = VERILOG.replace('"010"', "3'b010")
    assert found == text.replace("    endcase", f"      default: n5_o <= {value};\n    endcase")
    assert from_vhdl.repair_netlist(found, "") == found, "a GHDL that writes both"


@pytest.mark.parametrize("vhdl", ["", VHDL.format(others="f(n1_o)"), VHDL.format(others="n1_o").replace("n5", "n6")])
def test_a_case_without_a_known_default_is_refused(vhdl):
    with pytest.raises(ValueError, match="no `when others` of n5_o is known"):
        from_vhdl.repair_netlist(VERILOG, vhdl)


@BOTH
def test_the_refusal_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(from_vhdl, "SELECT_PATTERN", from_vhdl.re.compile("nothing(x)(y)(z)"))
    with pytest.raises(
        FileError, match=r"^test: chooser: the Verilog of GHDL's synthesis has a case without default: no"
    ):
        made(tmp_path)
