library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity multiplier is
    port (clk, reset_n, take : in std_logic; a : in signed(23 downto 0); b : in signed(17 downto 0);
          p : out signed(41 downto 0));
end entity;

architecture rtl of multiplier is
begin
    process (clk) begin
        if rising_edge(clk) then
            if reset_n = '0' then
                p <= (others => '0');
            elsif take = '1' then
                p <= a * b;
            end if;
        end if;
    end process;
end architecture;
