-- SPI master for the DACs: a bit every gap + 1 clocks, MSB first; SCLK is clk gated by r_sclk_en, SDIN the MSB of the
-- register. r_lead counts the clocks before the first bit and those between bits.
-- Latency: lead + bits (gap + 1) + ldac clocks from the load edge to the edge that changes the DAC's output.
-- A load restarts a frame in progress. The word comes ready: flip, header, control, data_mask and tail, of which it is
-- built, are generics so that the list is that of the block. VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_spi_dac is
    generic (
        bits      : std_logic_vector(4 downto 0);         -- of a frame
        lead      : std_logic_vector(1 downto 0);         -- clocks between SYNC low and the first SCLK
        ldac      : std_logic;                            -- 1: the part wants an LDAC pulse
        flip      : std_logic_vector(19 downto 0);
        header    : std_logic_vector(23 downto 0);
        control   : std_logic_vector(23 downto 0);
        data_mask : std_logic_vector(19 downto 0);
        tail      : std_logic_vector(3 downto 0) := "0000";
        gap       : std_logic_vector(1 downto 0) := "00";  -- clocks without SCLK behind each bit
        strobe    : std_logic := '0'                       -- 1: LDAC falls with the next load
    );
    port (
        clk         : in  std_logic;
        rst         : in  std_logic;                      -- synchronous, active high
        load        : in  std_logic;
        word        : in  std_logic_vector(23 downto 0);  -- [0,24,0]
        r_shift     : out std_logic_vector(23 downto 0);  -- [0,24,0]
        r_left      : out std_logic_vector(4 downto 0);   -- [0,5,0]
        r_lead      : out std_logic_vector(1 downto 0);   -- [0,2,0]
        r_sync_n    : out std_logic;
        r_sclk_en   : out std_logic;
        r_ldac_n    : out std_logic;
        r_ldac_wait : out std_logic;
        o_sdin      : out std_logic
    );
end entity;

architecture rtl of gyro_spi_dac is
    constant LENGTH : natural := to_integer(unsigned(bits));
    constant GAPS   : boolean := to_integer(unsigned(gap)) /= 0;

    -- a frame of fewer than 24 bits uses the low end of the register
    function kept(x : std_logic_vector(23 downto 0)) return std_logic_vector is
    begin
        return std_logic_vector(resize(unsigned(x(LENGTH - 1 downto 0)), 24));
    end function;

    -- the last clock of the last bit
    signal ends : boolean;
begin
    o_sdin <= r_shift(LENGTH - 1);

    ends <= not GAPS and unsigned(r_left) = 1 when r_sclk_en = '1'
            else unsigned(r_lead) = 1 and unsigned(r_left) = 0;

    process (clk)
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_shift     <= (others => '0');
                r_left      <= (others => '0');
                r_lead      <= (others => '0');
                r_sync_n    <= '1';
                r_sclk_en   <= '0';
                r_ldac_n    <= '1';
                r_ldac_wait <= '0';
            elsif load = '1' then
                r_shift     <= word;
                r_left      <= bits;
                r_lead      <= lead;
                r_sync_n    <= '0';
                r_sclk_en   <= '1' when unsigned(lead) = 0 else '0';
                r_ldac_n    <= not strobe;
                r_ldac_wait <= '0';
            else
                -- LDAC falls one clock after SYNC has risen, for one clock
                r_ldac_n    <= not r_ldac_wait;
                r_ldac_wait <= '0';
                if r_sclk_en = '1' then
                    r_shift <= kept(r_shift(22 downto 0) & '0');
                    r_left  <= std_logic_vector(unsigned(r_left) - 1);
                    r_lead  <= gap;
                    if GAPS then
                        r_sclk_en <= '0';
                    end if;
                elsif unsigned(r_lead) /= 0 then
                    r_lead    <= std_logic_vector(unsigned(r_lead) - 1);
                    r_sclk_en <= '1' when unsigned(r_lead) = 1 else '0';
                end if;
                if ends then
                    r_sync_n    <= '1';
                    r_sclk_en   <= '0';
                    r_ldac_wait <= ldac;
                end if;
            end if;
        end if;
    end process;
end architecture;
