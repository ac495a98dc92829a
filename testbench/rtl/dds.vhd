-- One phase accumulator and four outputs with a phase offset each.
--   phase[n+1] = phase[n] + word,  output[n+1] = phase[n] + offset   (mod 1 turn)
-- Formats: all [0,0,DDS_BITS], unsigned turns.   Latency: 1 clock, word to phase and phase to output.
-- Reset 0. Every sum wraps on purpose: phase arithmetic is modular. VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_dds is
    generic (
        DDS_BITS : natural := 48  -- width of the phase, 24 .. 48
    );
    port (
        clk            : in  std_logic;
        rst            : in  std_logic;                                -- synchronous, active high
        word           : in  std_logic_vector(DDS_BITS - 1 downto 0);  -- [0,0,DDS_BITS] turns per clock
        off_drive_sine : in  std_logic_vector(DDS_BITS - 1 downto 0);  -- [0,0,DDS_BITS] positive advances
        off_sense_sine : in  std_logic_vector(DDS_BITS - 1 downto 0);
        off_drive_ref  : in  std_logic_vector(DDS_BITS - 1 downto 0);
        off_sense_ref  : in  std_logic_vector(DDS_BITS - 1 downto 0);
        r_phase        : out std_logic_vector(DDS_BITS - 1 downto 0);  -- [0,0,DDS_BITS]
        r_drive_sine   : out std_logic_vector(DDS_BITS - 1 downto 0);
        r_sense_sine   : out std_logic_vector(DDS_BITS - 1 downto 0);
        r_drive_ref    : out std_logic_vector(DDS_BITS - 1 downto 0);
        r_sense_ref    : out std_logic_vector(DDS_BITS - 1 downto 0)
    );
end entity;

architecture rtl of gyro_dds is
    -- numeric_std's sum of equal widths keeps that width, which is the wrap at one turn
    function turns(a, b : std_logic_vector(DDS_BITS - 1 downto 0)) return std_logic_vector is
    begin
        return std_logic_vector(unsigned(a) + unsigned(b));
    end function;
begin
    process (clk)
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_phase      <= (others => '0');
                r_drive_sine <= (others => '0');
                r_sense_sine <= (others => '0');
                r_drive_ref  <= (others => '0');
                r_sense_ref  <= (others => '0');
            else
                r_phase      <= turns(r_phase, word);
                r_drive_sine <= turns(r_phase, off_drive_sine);
                r_sense_sine <= turns(r_phase, off_sense_sine);
                r_drive_ref  <= turns(r_phase, off_drive_ref);
                r_sense_ref  <= turns(r_phase, off_sense_ref);
            end if;
        end if;
    end process;
end architecture;
