library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
library dsp;
use dsp.fx.all;

entity amp_mod is
    generic (SHIFT_BITS : natural := 25; CODE_MIN : signed(19 downto 0); CODE_MAX : signed(19 downto 0); FRAMES : natural range 0 to 2 := 0);
    port (clk, rst_n, mul_ce, out_ce : in std_logic;
          gain : in signed(23 downto 0);
          wave : in signed(17 downto 0);
          dac : out signed(19 downto 0));
end entity;

architecture rtl of amp_mod is
    type chain_t is array (0 to FRAMES) of signed(19 downto 0);
    signal chain : chain_t;
    signal product : signed(41 downto 0);
begin
    u_mult : entity dsp.mult24x18 port map (clk => clk, rst_n => rst_n, ce => mul_ce, a => gain, b => wave, p => product);
    process (clk) begin
        if rising_edge(clk) then
            if rst_n = '0' then
                chain <= (others => (others => '0'));
            elsif out_ce = '1' then
                chain(0) <= scaled(product, SHIFT_BITS, CODE_MIN, CODE_MAX);
                for k in 1 to FRAMES loop
                    chain(k) <= chain(k - 1);
                end loop;
            end if;
        end if;
    end process;
    dac <= chain(FRAMES);
end architecture;
