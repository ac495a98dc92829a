library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

package fx is
    -- v / 2**n, ties up, then limited
    function scaled(v : signed; n : natural; lo, hi : signed) return signed;
end package;

package body fx is
    function scaled(v : signed; n : natural; lo, hi : signed) return signed is
        variable r : signed(v'length downto 0) := resize(v, v'length + 1);
    begin
        if n > 0 then
            r := shift_right(r, n - 1) + 1;
            r := shift_right(r, 1);
        end if;
        if r < lo then return lo; end if;
        if r > hi then return hi; end if;
        return resize(r, lo'length);
    end function;
end package body;
