library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
library dsp;
use dsp.rounding.all;

entity modulator_core is
    generic (DROPPED : natural; LIMIT_LO, LIMIT_HI : signed(19 downto 0); DELAY : natural);
    port (
        clk, reset_n, multiply, convert : in std_logic;
        level : in signed(23 downto 0);
        carrier : in signed(17 downto 0);
        code : out signed(19 downto 0)
    );
end entity;

architecture rtl of modulator_core is
    type codes_t is array (0 to 2) of code_t;
    signal product : signed(41 downto 0);
    signal codes : codes_t;
begin
    product_of: entity dsp.multiplier port map (clk => clk, reset_n => reset_n, take => multiply, a => level,
                                                b => carrier, p => product);
    code <= codes(DELAY) when DELAY < 3 else codes(0);
    process (clk) begin
        if rising_edge(clk) then
            if reset_n = '0' then
                codes <= (others => (others => '0'));
            elsif convert = '1' then
                codes <= (rounded(product, DROPPED, LIMIT_LO, LIMIT_HI), codes(0), codes(1));
            end if;
        end if;
    end process;
end architecture;
