library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

package rounding is
    subtype code_t is signed(19 downto 0);
    -- ties toward plus infinity, then limited
    function rounded(a : signed; shift : natural; lo, hi : code_t) return code_t;
end package;

package body rounding is
    function rounded(a : signed; shift : natural; lo, hi : code_t) return code_t is
        variable wide, half : signed(a'length downto 0);
    begin
        half := (others => '0');
        if shift > 0 then
            half(shift - 1) := '1';
        end if;
        wide := shift_right(resize(a, wide'length) + half, shift);
        if wide < lo then
            return lo;
        elsif wide > hi then
            return hi;
        end if;
        return resize(wide, code_t'length);
    end function;
end package body;
