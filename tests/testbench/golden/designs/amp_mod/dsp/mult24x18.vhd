-- 24 x 18 bits from two 18 x 18 multipliers, each with its register; the sum is not registered.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity mult24x18 is
    port (clk, rst_n, ce : in std_logic;
          a : in signed(23 downto 0);
          b : in signed(17 downto 0);
          p : out signed(41 downto 0));
end entity;

architecture rtl of mult24x18 is
    signal upper : signed(24 downto 0);
    signal lower : signed(35 downto 0);
begin
    process (clk) begin
        if rising_edge(clk) then
            if rst_n = '0' then
                upper <= (others => '0');
                lower <= (others => '0');
            elsif ce = '1' then
                upper <= a(23 downto 17) * b;
                lower <= signed('0' & a(16 downto 0)) * b;
            end if;
        end if;
    end process;
    p <= (upper & to_signed(0, 17)) + lower;
end architecture;
