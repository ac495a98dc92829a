"""GHW dumps of GHDL say what the VCD of the same run says; damaged ones are one clear line."""

import random
import shutil
import struct
import subprocess
import time

import numpy as np
import pytest

from fpga_model.fixed import Fmt, bits, signed_bits
from testbench.errors import FileError
from testbench.golden.check import ghw, waves

SHAPES = """library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
package shapes is
    type mode_t is (IDLE, RUN, STOP);
    type pair_t is record
        code : signed(5 downto 0);
        valid : std_logic;
        count : integer range 0 to 100;
    end record;
    type words_t is array (natural range <>) of std_logic_vector(3 downto 0);
    type open_t is array (natural range <>) of std_logic_vector;
    type frame_t is record
        head : std_logic_vector;
        mode : mode_t;
    end record;
end package;

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.shapes.all;
entity part is
    generic (N : natural := 3);
    port (
        clk : in std_logic;
        rst : in std_logic;
        word : in std_logic_vector(N - 1 downto 0);
        q : out std_logic_vector(0 to N - 1)
    );
end entity;
architecture rtl of part is
    signal pair : pair_t := (code => (others => '0'), valid => '0', count => 0);
    signal copy_code : signed(5 downto 0);
    signal copy_valid : std_logic;
    signal copy_count : integer;
    signal mode : mode_t := IDLE;
    signal mode_bits : unsigned(1 downto 0);
    signal flag : boolean := false;
    signal b : bit := '0';
    signal bv : bit_vector(2 downto 0) := "000";
    signal u : unsigned(7 downto 0) := (others => '0');
    signal n_int : integer := -5;
    signal words : words_t(0 to 2) := (others => "0000");
    signal word_1 : std_logic_vector(3 downto 0);
    signal opened : open_t(0 to 1)(4 downto 0) := (others => "00000");
    signal opened_1 : std_logic_vector(4 downto 0);
    signal frame : frame_t(head(2 downto 0)) := (head => "000", mode => IDLE);
    signal frame_head : std_logic_vector(2 downto 0);
    signal level : real := 0.5;
    signal span : time := 1 ns;
begin
    copy_code <= pair.code;
    copy_valid <= pair.valid;
    copy_count <= pair.count;
    mode_bits <= to_unsigned(mode_t'pos(mode), 2);
    word_1 <= words(1);
    opened_1 <= opened(1);
    frame_head <= frame.head;
    process (clk)
    begin
        if rising_edge(clk) then
            if rst = '1' then
                u <= (others => '0');
                q <= (others => 'U');
            else
                u <= u + 5;
                pair.code <= pair.code + 3;
                pair.valid <= not pair.valid;
                pair.count <= (pair.count + 7) mod 100;
                mode <= mode_t'val((mode_t'pos(mode) + 1) mod 3);
                flag <= not flag;
                b <= not b;
                bv <= bv xor "101";
                n_int <= n_int * 3 mod 1000 - 400;
                words(to_integer(u) mod 3) <= std_logic_vector(u(4 downto 1));
                opened(to_integer(u) mod 2) <= std_logic_vector(u(5 downto 1));
                frame.head <= std_logic_vector(u(2 downto 0));
                level <= level * 1.5;
                span <= span + 2 ns;
                q <= word when u(0) = '1' else (others => 'Z');
            end if;
        end if;
    end process;
end architecture;

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
entity tb is end entity;
architecture bench of tb is
    signal clk : std_logic := '0';
    signal now_bus : std_logic_vector(11 downto 0) := (others => '0');
    signal got : std_logic_vector(5 downto 0);
    signal strong : std_ulogic_vector(3 downto 0);
    signal \\odd name\\ : std_logic := 'W';
begin
    -- ports on slices of one vector
    first : entity work.part
        port map (clk => clk, rst => now_bus(11), word => now_bus(4 downto 2), q => got(5 downto 3));
    copies : for k in 0 to 1 generate
        inner : entity work.part
            generic map (N => 1 + k)
            port map (clk => clk, rst => now_bus(11 - k), word => now_bus(2 * k + k downto 2 * k), q => open);
    end generate;
    named : if true generate
        signal local : std_logic_vector(1 downto 0) := "LH";
    begin
        local <= now_bus(1 downto 0) after 3 ns;
    end generate;
    holder : block
        signal held : unsigned(2 downto 0) := "000";
    begin
        held <= unsigned(now_bus(6 downto 4));
    end block;
    strong <= now_bus(3 downto 0);
    \\odd name\\ <= clk;
    process
    begin
        now_bus(11) <= '1';
        now_bus(10) <= '1';
        for n in 0 to 99 loop
            wait for 5 ns;
            clk <= '1';
            wait for 5 ns;
            clk <= '0';
            now_bus <= std_logic_vector(to_unsigned((n * 37) mod 1024, 12));
            if n = 50 then
                now_bus(2) <= 'X';
            end if;
            if n = 60 then
                now_bus(3) <= 'H';
            end if;
        end loop;
        wait;
    end process;
end architecture;
"""
# What the VCD of GHDL shows too, and width; then what only the GHW has, with its copy that the VCD shows
PART = {"clk": 1, "rst": 1, "flag": 1, "b": 1, "bv": 3, "u": 8, "n_int": 32, "copy_code": 6, "mode_bits": 2}
SAME = {f"{at}.{name}": width for at in ("tb.first", "tb.copies(0).inner", "tb.copies(1).inner")
        for name, width in PART.items()}  # fmt: skip
SAME |= {"tb.clk": 1, "tb.now_bus": 12, "tb.got": 6, "tb.strong": 4, "tb.\\odd name\\": 1, "tb.named.local": 2,
         "tb.holder.held": 3, "tb.first.word": 3, "tb.first.q": 3, "tb.copies(1).inner.word": 2,
         "tb.copies(1).inner.q": 2, "tb.now_bus[7:4]": 4}  # fmt: skip
COPIES = {"pair.code": "copy_code", "pair.valid": "copy_valid", "pair.count": "copy_count", "mode": "mode_bits",
          "words(1)": "word_1", "opened(1)": "opened_1", "frame.head": "frame_head"}  # fmt: skip
WIDTHS = PART | {"copy_valid": 1, "copy_count": 32, "word_1": 4, "opened_1": 5, "frame_head": 3}


@pytest.fixture(scope="module")
def dumps(tmp_path_factory):
    if shutil.which("ghdl") is None:
        pytest.skip("ghdl is not installed: GHW was NOT read")
    folder = tmp_path_factory.mktemp("ghw")
    (folder / "a.vhd").write_text(SHAPES)
    for command in (
        "-a --std=08 a.vhd",
        "-e --std=08 tb",
        "-r --std=08 tb --wave=a.ghw --vcd=a.vcd --ieee-asserts=disable",
    ):
        subprocess.run(["ghdl", *command.split()], cwd=folder, check=True, capture_output=True, timeout=120)
    return folder


def columns(path, ports, rising=True):
    """Columns of {path: width}, unsigned, sampled by tb.clk."""
    names = {f"p{k}": place for k, place in enumerate(ports)}
    fmts = {port: bits(ports[place]) for port, place in names.items()}
    found = waves.read_log(path, waves.Map(names, "tb.clk", rising, None, 0), fmts)
    return {place: found[port] for port, place in names.items()}


@pytest.mark.parametrize("rising", [True, False])
def test_every_signal_is_that_of_the_vcd(dumps, rising):
    got, want = (columns(dumps / f"a.{kind}", SAME, rising) for kind in ("ghw", "vcd"))
    for name in SAME:
        np.testing.assert_array_equal(got[name].valid, want[name].valid, name)
        np.testing.assert_array_equal(got[name].values, want[name].values, name)
    assert len(got["tb.clk"].values) == 100
    assert not got["tb.now_bus"].valid.all()
    assert got["tb.first.u"].values.max() > 200


def test_records_arrays_and_enumerations_are_what_their_copies_are(dumps):
    for at in ("tb.first", "tb.copies(1).inner"):
        inside = {f"{at}.{name}": WIDTHS[copy] for name, copy in COPIES.items()}
        outside = {f"{at}.{copy}": WIDTHS[copy] for copy in COPIES.values()}
        got, want = columns(dumps / "a.ghw", inside), columns(dumps / "a.vcd", outside)
        for name, copy in COPIES.items():
            np.testing.assert_array_equal(got[f"{at}.{name}"].values, want[f"{at}.{copy}"].values, name)
            assert len(np.unique(got[f"{at}.{name}"].values)) > 1, name


def test_a_negative_integer_and_a_slice_of_it(dumps):
    ports = {"a": "tb.first.n_int", "b": "tb.first.n_int[9:0]"}
    found = waves.read_log(
        dumps / "a.ghw", waves.Map(ports, "tb.clk", True, None, 0), {"a": signed_bits(32), "b": bits(10)}
    )
    assert found["a"].values.min() < 0
    np.testing.assert_array_equal(found["b"].values, found["a"].values & 1023)


@pytest.mark.parametrize(
    ("path", "fmt", "said"),
    [
        ("tb.first.level", bits(64), "signal tb.first.level is not bits"),
        ("tb.first.span", bits(64), "is not bits"),
        ("tb.word", bits(3), r"no signal tb\.word; similar: tb\.copies\(0\)\.inner\.word"),
        ("tb.first.word", bits(4), "3 bits in the dump, 4 in the manifest"),
        ("tb.first.mode", Fmt(0, 3, 0), "2 bits in the dump"),
    ],
)
def test_a_wrong_map_is_one_clear_line(dumps, path, fmt, said):
    with pytest.raises(FileError, match=said):
        waves.read_log(dumps / "a.ghw", waves.Map({"p": path}, "tb.clk", True, None, 0), {"p": fmt})


def everything(path):
    return ghw.read(path, lambda widths: [name for name, width in widths.items() if width])


def outcome(path):
    """What is said against a file, or nothing; any other exception than FileError is one of the test."""
    try:
        everything(path)
    except FileError as problem:
        return str(problem)
    return ""


def test_a_file_that_is_cut_off_is_refused_wherever_it_is_cut(dumps, tmp_path):
    data, path = (dumps / "a.ghw").read_bytes(), tmp_path / "cut.ghw"
    places = sorted(
        {*range(0, 400, 9), *random.Random(1).sample(range(len(data)), 20), *range(len(data) - 10, len(data))}
    )
    for place in places:
        path.write_bytes(data[:place])
        with pytest.raises(FileError) as problem:
            everything(path)
        assert len(str(problem.value).splitlines()) == 1
        assert "cut.ghw" in str(problem.value)


def test_a_damaged_file_gives_one_clear_line_or_other_values_but_never_anything_else(dumps, tmp_path):
    """A flipped bit of a value cannot be seen; whatever breaks the structure is a FileError, soon."""
    data, path, rng = (dumps / "a.ghw").read_bytes(), tmp_path / "bad.ghw", random.Random(13)
    body = data.index(b"SNP\0")
    refused = 0
    for n in range(80):
        bad = bytearray(data)
        # half of the damage to the description of the signals, which is a small part of the file
        for _ in range(rng.choice([1, 1, 2, 8])):
            bad[rng.randrange(body if n % 2 else len(data))] = rng.choice([0, 255, rng.randrange(256)])
        path.write_bytes(bad)
        begun = time.monotonic()
        said = outcome(path)
        refused += bool(said)
        assert len(said.splitlines()) <= 1
        assert time.monotonic() - begun < 5
    assert refused > 40


def test_sizes_that_are_lies_are_refused_before_memory_is_taken(dumps, tmp_path):
    data, path = (dumps / "a.ghw").read_bytes(), tmp_path / "big.ghw"
    for tag, offset in ((b"STR\0", 8), (b"TYP\0", 8)):
        place = data.index(tag) + offset
        path.write_bytes(data[:place] + struct.pack("<i", 2**31 - 1) + data[place + 4 :])
        with pytest.raises(FileError, match="damaged"):
            everything(path)


def test_what_is_no_ghw_file_is_refused(tmp_path):
    path = tmp_path / "a.ghw"
    with pytest.raises(FileError, match="cannot be read"):
        everything(path)
    path.write_text("$date $end")
    with pytest.raises(FileError, match="not a GHW file"):
        everything(path)
    path.write_bytes(ghw.MAGIC + bytes([16, 1, 0, 1, 4, 1, 0]))
    with pytest.raises(FileError, match="version"):
        everything(path)


def test_types_of_types_are_not_walked_for_ever():
    """A record of two records of two records ..., sixty deep: the number of its elements is known, not counted."""
    kind = ghw.Scalar(ghw.E8, ("'0'", "'1'"))
    for _ in range(60):
        kind = ghw.sized_record((("a", kind), ("b", kind)))
    assert kind.count == 1 << 60
    empty = ghw.sized_array(kind, 1, (0,))
    assert list(ghw.leaf_signals("x", ghw.sized_record((("a", empty), ("b", empty))), ())) == []
