"""The VHDL-2008 bench.

Source  docs/golden.md (the whole design), testbench/golden/recording/signature.py
"""

from testbench.golden.bundles import benches
from testbench.golden.bundles.benches import SHOWN
from testbench.golden.bundles.top_benches.layout import CLOCK_BITS, ROM_PARAMETERS, SHOWN_ROWS, chunks
from testbench.golden.recording import signature
from testbench.golden.stimulus.blocks import params_of


def vhdl_bench(block, case, counts):
    """The same in VHDL-2008; `finished` and `errors` are for a surrounding bench."""
    inputs, found = [(p.name, p) for p in block.columns], benches.results(block)
    given, title, name = params_of(block, case), f"{block.stem}/{case}", f"tb_{block.stem}"
    generics = [f"            {key} : {benches.vhdl_type(fmt.width)}" for key, _, fmt in given]
    generics += [f"            {key} : string" for key in ROM_PARAMETERS]
    maps = [f"            {key} => P_{key}" for key, _, _ in given]
    maps += [f'            {key} => DIR & "{path}"' for key, path in ROM_PARAMETERS.items()]
    ports = ["            clk : in std_logic"]
    ports += [f"            {n} : in {benches.vhdl_type(p.width)}" for n, p in inputs]
    ports += [f"            {n} : out {benches.vhdl_type(p.width)}" for n, p in found]
    port_maps = ["                clk => clk"]
    for signal_name, named in (("feed", inputs), ("got", found)):
        port_maps += [
            f"                {n} => {signal_name}{benches.vhdl_slice(p.width, hi, lo)}"
            for n, p, hi, lo in benches.slices(named)
        ]
    place = {n: (hi, lo) for n, _, hi, lo in benches.slices(inputs)}
    pins = {n: hi for n, _, hi, _ in benches.slices(found)}
    shows = [
        f'                    tell("{n}", n, {got}({hi} downto {lo}), {want}({hi} downto {lo}));'
        for got, want, named in (("feed", "fed", inputs), ("got", "want", found))
        for n, p, hi, lo in benches.slices(named)
    ]
    size, row_bits = 64 * signature.WORDS, signature.padded(counts["out_width"])
    first, more = chunks(size)

    def span(key):
        return f"({place[key][0]} downto {place[key][1]})"

    backs = " xor\n            ".join(
        f"shift_left(resize(leaving, {size}), {64 * back})" if back else f"resize(leaving, {size})"
        for back in signature.BACK
    )
    return f"""-- Self-checking bench of {title}: replays recorded inputs, compares rows and signatures.
-- Generic FRAMES stops after so many frames; 0 runs them all. A model of the ADS1298 feeds the ADC master.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.textio.all;
use work.{block.module}_params.all;

entity {name} is
    generic (
        NO_DESIGN : boolean := false;
        FRAMES : natural := 0;
        DIR : string := ""  -- folder of the bundle, with a slash at its end
    );
    port (
        finished : out boolean := false;
        errors : out natural := 0
    );
end entity;

architecture bench of {name} is
    component {block.module} is
        generic (
{(";" + chr(10)).join(generics)}
        );
        port (
{(";" + chr(10)).join(ports)}
        );
    end component;

    signal clk : std_logic := '0';
    signal feed : std_logic_vector(IN_WIDTH - 1 downto 0) := (others => '0');
    signal got : std_logic_vector(OUT_WIDTH - 1 downto 0);

    procedure tell(port_name : string; n : natural; found, expected : std_logic_vector) is
        variable text_line : line;
    begin
        if found /= expected then
            write(text_line, string'("clock ") & integer'image(n) & ": " & port_name & ": expected "
                & to_hstring(expected) & ", got " & to_hstring(found) & " (hex)");
            writeline(output, text_line);
        end if;
    end procedure;

    -- one chunk of {signature.CHUNK} bits; the remainder is modulo x^64 + x^4 + x^3 + x + 1
    function folded(old, chunk : unsigned) return unsigned is
        variable high : unsigned(63 downto 0) := resize(old(63 downto {64 - signature.CHUNK}), 64);
    begin
        high := high xor shift_left(high, 1);
        return shift_left(old, {signature.CHUNK}) xor resize(chunk, 64) xor high xor shift_left(high, 3);
    end function;

    function reduced(rest : unsigned) return unsigned is
        variable sig : unsigned(63 downto 0) := resize(rest({size - 1} downto {size - first}), 64);
    begin
        for j in {more - 1} downto 0 loop
            sig := folded(sig, rest({signature.CHUNK} * j + {signature.CHUNK - 1} downto {signature.CHUNK} * j));
        end loop;
        return sig;
    end function;

    -- a row is appended modulo x^{size} + ...; what leaves on the left comes back on the right
    function appended(rest : unsigned; row : std_logic_vector) return unsigned is
        variable leaving : unsigned({row_bits - 1} downto 0) := rest({size - 1} downto {size - row_bits});
    begin
        return (shift_left(rest, {row_bits}) or resize(unsigned(row), {size})) xor
            {backs};
    end function;
begin
    given: if not NO_DESIGN generate
        dut: {block.module}
            generic map (
    {("," + chr(10) + "    ").join(maps)}
            )
            port map (
{("," + chr(10)).join(port_maps)}
            );
    end generate;

    main: process
        file at_file, stim_file, exp_file, sig_file, adc_file, host_file, sar_file : text;
        variable text_line : line;
        variable at_word : std_logic_vector({CLOCK_BITS - 1} downto 0);
        variable stim_word : std_logic_vector((IN_WIDTH + 3) / 4 * 4 - 1 downto 0);
        variable exp_word : std_logic_vector((OUT_WIDTH + 3) / 4 * 4 - 1 downto 0);
        variable sig_word : std_logic_vector(63 downto 0);
        variable adc_word : std_logic_vector(ADC_BITS - 1 downto 0);
        variable host_word : std_logic_vector(HOST_BITS - 1 downto 0);
        variable sar_word : std_logic_vector(SAR_BITS - 1 downto 0);
        variable fed : std_logic_vector(IN_WIDTH - 1 downto 0);
        variable want : std_logic_vector(OUT_WIDTH - 1 downto 0);
        variable rest : unsigned({size - 1} downto 0) := (others => '0');
        variable sig : unsigned(63 downto 0);
        variable result, shift : std_logic_vector(215 downto 0) := (others => '0');
        variable cs_n, cs_n_was, drdy_n, drdy_n_was : std_logic := '1';
        variable sclk, sclk_was, dout : std_logic := '0';
        variable pulse, pulse_was : natural := 0;
        variable loaded : boolean;
        variable row_at, conversion_at, event_at : integer := -1;
        variable rows, conversions, events, samples : natural := 0;
        variable frame, bad_rows, bad_clock, bad_frames, bad_frame, last_frame : natural := 0;

        procedure next_row is
        begin
            row_at := -1;
            if rows < N_ROWS then
                readline(at_file, text_line);
                hread(text_line, at_word);
                row_at := to_integer(unsigned(at_word));
                rows := rows + 1;
            end if;
        end procedure;

        procedure next_conversion is
        begin
            conversion_at := -1;
            if conversions < N_ADC then
                readline(adc_file, text_line);
                hread(text_line, adc_word);
                conversion_at := to_integer(unsigned(adc_word(ADC_BITS - 1 downto ADC_BITS - 32)));
                conversions := conversions + 1;
            end if;
        end procedure;

        procedure next_event is
        begin
            event_at := -1;
            if events < N_HOST then
                readline(host_file, text_line);
                hread(text_line, host_word);
                event_at := to_integer(unsigned(host_word(HOST_BITS - 1 downto HOST_BITS - 32)));
                events := events + 1;
            end if;
        end procedure;
    begin
        if NO_DESIGN then
            write(text_line, string'("NO DESIGN {title}: the bench elaborates, no design was given"));
            writeline(output, text_line);
            finished <= true;
            wait;
        end if;
        file_open(at_file, DIR & "at.hex", read_mode);
        file_open(stim_file, DIR & "stim.hex", read_mode);
        file_open(exp_file, DIR & "exp.hex", read_mode);
        file_open(sig_file, DIR & "sig.hex", read_mode);
        file_open(adc_file, DIR & "adc.hex", read_mode);
        file_open(host_file, DIR & "host.hex", read_mode);
        file_open(sar_file, DIR & "sar.hex", read_mode);
        next_row;
        next_conversion;
        next_event;
        last_frame := N_FRAMES;
        if FRAMES > 0 and FRAMES < N_FRAMES then
            last_frame := FRAMES;
        end if;
        feed({place["rst"][0]}) <= '1';
        for n in 1 to RESET_CYCLES loop
            wait for HALF_PS * 1 ps;
            clk <= '1';
            wait for HALF_PS * 1 ps;
            clk <= '0';
        end loop;
        for n in 0 to last_frame * FRAME_CYCLES - 1 loop
            -- the converter, after edge n - 1, with the pins as they are then
            if n /= 0 then
                cs_n := got({pins["o_adc_cs_n"]});
                sclk := got({pins["o_adc_sclk"]});
                loaded := conversion_at = n - 1;
                drdy_n_was := drdy_n;
                pulse_was := pulse;
                if pulse_was /= 0 then
                    pulse := pulse_was - 1;
                    if pulse_was = 1 then
                        drdy_n := '0';
                    end if;
                end if;
                if loaded then
                    result := adc_word(215 downto 0);
                    next_conversion;
                    if drdy_n_was = '0' then
                        drdy_n := '1';
                        pulse := ADC_PULSE;
                    elsif pulse_was = 0 then
                        drdy_n := '0';
                    end if;
                end if;
                if cs_n /= cs_n_was then
                    dout := '0';
                    shift := (others => '0');
                    if cs_n = '0' then
                        shift := result;
                    end if;
                elsif cs_n = '0' and sclk /= sclk_was then
                    if sclk = '1' then
                        dout := shift(215);
                        shift := shift(214 downto 0) & '0';
                    elsif not loaded and pulse_was = 0 then
                        drdy_n := '1';
                    end if;
                end if;
                cs_n_was := cs_n;
                sclk_was := sclk;
            end if;
            -- host and samples
            feed({place["rst"][0]}) <= '0';
            feed({place["write"][0]}) <= '0';
            if event_at = n then
                if host_word(56) = '1' then
                    feed({place["rst"][0]}) <= '1';
                else
                    feed({place["write"][0]}) <= '1';
                    feed{span("address")} <= host_word(55 downto 48);
                    feed{span("data")} <= host_word(47 downto 0);
                end if;
                next_event;
            end if;
            if n mod TICK_CYCLES = 0 and samples < N_SAR then
                readline(sar_file, text_line);
                hread(text_line, sar_word);
                feed{span("sample_x")} <= sar_word(35 downto 18);
                feed{span("sample_y")} <= sar_word(17 downto 0);
                samples := samples + 1;
            end if;
            feed({place["drdy_n"][0]}) <= drdy_n;
            feed({place["dout"][0]}) <= dout;
            wait for (HALF_PS - 1) * 1 ps;
            rest := appended(rest, got);
            if row_at = n then
                readline(stim_file, text_line);
                hread(text_line, stim_word);
                readline(exp_file, text_line);
                hread(text_line, exp_word);
                fed := stim_word(IN_WIDTH - 1 downto 0);
                want := exp_word(OUT_WIDTH - 1 downto 0);
                if got /= want or feed /= fed then
                    if bad_rows = 0 then
                        bad_clock := n;
                    end if;
                    if bad_rows < {SHOWN_ROWS} then
{chr(10).join(shows)}
                    end if;
                    bad_rows := bad_rows + 1;
                end if;
                next_row;
            end if;
            if n mod FRAME_CYCLES = FRAME_CYCLES - 1 then
                sig := reduced(rest);
                rest := (others => '0');
                readline(sig_file, text_line);
                hread(text_line, sig_word);
                if std_logic_vector(sig) /= sig_word then
                    if bad_frames = 0 then
                        bad_frame := frame;
                    end if;
                    if bad_frames < {SHOWN} then
                        write(text_line, string'("frame ") & integer'image(frame) & " (clocks "
                            & integer'image(n + 1 - FRAME_CYCLES) & " .. " & integer'image(n)
                            & "): signature: expected " & to_hstring(sig_word) & ", got " & to_hstring(sig));
                        writeline(output, text_line);
                    end if;
                    bad_frames := bad_frames + 1;
                end if;
                frame := frame + 1;
            end if;
            wait for 1 ps;
            clk <= '1';
            wait for HALF_PS * 1 ps;
            clk <= '0';
        end loop;
        if row_at >= 0 then
            rows := rows - 1;  -- one was read ahead
        end if;
        if bad_rows = 0 and bad_frames = 0 then
            write(text_line, string'("PASS {title}: ") & integer'image(last_frame * FRAME_CYCLES) & " clocks, "
                & integer'image(rows) & " rows of {len(found)} ports, " & integer'image(last_frame) & " of "
                & integer'image(N_FRAMES) & " frames");
        elsif bad_rows = 0 then
            write(text_line, string'("FAIL {title}: ") & integer'image(bad_frames) & " of " & integer'image(last_frame)
                & " frames differ, all " & integer'image(rows)
                & " rows agree; gyro golden window --frame " & integer'image(bad_frame));
        else
            write(text_line, string'("FAIL {title}: ") & integer'image(bad_rows) & " of " & integer'image(rows)
                & " rows differ, the first is at clock " & integer'image(bad_clock) & "; "
                & integer'image(bad_frames) & " of " & integer'image(last_frame) & " frames differ");
        end if;
        writeline(output, text_line);
        errors <= bad_rows + bad_frames;
        finished <= true;
        wait;
    end process;
end architecture;
"""
