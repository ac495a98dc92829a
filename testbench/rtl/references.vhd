-- The four reference pins sgn(sin), sgn(cos) of drive and sense, optionally held on the 1 MHz grid.
--   bit 0 drive sgn(sin), bit 1 drive sgn(cos), bit 2 sense sgn(sin), bit 3 sense sgn(cos)
-- Latency: 1 + align clocks from a phase to its pin; retimed: 1 more, after waiting for ce_1m.
-- VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;

entity gyro_references is
    generic (
        DDS_BITS : natural := 48;                 -- width of a phase
        align    : std_logic_vector(1 downto 0);  -- further registers, 0 .. 3
        retimed  : std_logic                      -- 1: pins change on the 1 MHz grid only
    );
    port (
        clk         : in  std_logic;
        rst         : in  std_logic;                                -- synchronous, active high
        drive_ref   : in  std_logic_vector(DDS_BITS - 1 downto 0);  -- [0,0,DDS_BITS] turns
        sense_ref   : in  std_logic_vector(DDS_BITS - 1 downto 0);  -- [0,0,DDS_BITS] turns
        ce_1m       : in  std_logic;
        r_signs     : out std_logic_vector(3 downto 0);             -- [0,4,0]
        r_aligned_0 : out std_logic_vector(3 downto 0);
        r_aligned_1 : out std_logic_vector(3 downto 0);
        r_aligned_2 : out std_logic_vector(3 downto 0);
        r_retimed   : out std_logic_vector(3 downto 0);
        o_pins      : out std_logic_vector(3 downto 0)
    );
end entity;

architecture rtl of gyro_references is
    signal picked : std_logic_vector(3 downto 0);
begin
    with align select picked <=
        r_signs     when "00",
        r_aligned_0 when "01",
        r_aligned_1 when "10",
        r_aligned_2 when others;

    o_pins <= r_retimed when retimed = '1' else picked;

    process (clk)
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_signs     <= (others => '0');
                r_aligned_0 <= (others => '0');
                r_aligned_1 <= (others => '0');
                r_aligned_2 <= (others => '0');
                r_retimed   <= (others => '0');
            else
                -- half a turn: sin < 0; the second and the third quarter: cos < 0
                r_signs     <= (sense_ref(DDS_BITS - 1) xnor sense_ref(DDS_BITS - 2)) & (not sense_ref(DDS_BITS - 1))
                               & (drive_ref(DDS_BITS - 1) xnor drive_ref(DDS_BITS - 2)) & (not drive_ref(DDS_BITS - 1));
                r_aligned_0 <= r_signs;
                r_aligned_1 <= r_aligned_0;
                r_aligned_2 <= r_aligned_1;
                if ce_1m = '1' then
                    r_retimed <= picked;
                end if;
            end if;
        end if;
    end process;
end architecture;
