-- PI controller with a clamped integrator.
--   mode 0 OFF: prop = 0, acc = clamp(preset)   1 P_ONLY: prop = kp*e   2 RUN: prop and acc   3 HOLD; en = 0 holds too
--   both products are rounded to ACCUMULATOR_FRACTION_BITS;   every clock: y = clamp(round(prop + acc))
-- Latency: 2 clocks from an enabled e to y.   Rounding: ties toward +inf, at both products and y.
-- Overflow: acc and y saturate at lo and hi; prop holds every product. VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_pi is
    generic (
        ACCUMULATOR_FRACTION_BITS : natural := 24;       -- of prop and acc, 1 .. 24
        kp : std_logic_vector(33 downto 0);              -- [1,9,24]
        ki : std_logic_vector(33 downto 0);              -- [1,9,24]
        lo : std_logic_vector(35 downto 0);              -- [1,35,0]
        hi : std_logic_vector(35 downto 0)               -- [1,35,0]
    );
    port (
        clk    : in  std_logic;
        rst    : in  std_logic;                          -- synchronous, active high
        en     : in  std_logic;
        mode   : in  std_logic_vector(1 downto 0);
        e      : in  std_logic_vector(25 downto 0);      -- [1,25,0]
        preset : in  std_logic_vector(35 downto 0);      -- [1,35,0]
        r_prop : out std_logic_vector(ACCUMULATOR_FRACTION_BITS + 35 downto 0);  -- [1,35,24]
        r_acc  : out std_logic_vector(ACCUMULATOR_FRACTION_BITS + 35 downto 0);  -- [1,35,24]
        r_y    : out std_logic_vector(35 downto 0)       -- [1,35,0]
    );
end entity;

architecture rtl of gyro_pi is
    constant OFF    : std_logic_vector(1 downto 0) := "00";
    constant P_ONLY : std_logic_vector(1 downto 0) := "01";
    constant RUN    : std_logic_vector(1 downto 0) := "10";

    constant F : natural := ACCUMULATOR_FRACTION_BITS;
    constant A : natural := F + 36;

    constant Y_LO : signed(35 downto 0) := signed(lo);
    constant Y_HI : signed(35 downto 0) := signed(hi);

    function clamp(x : signed) return signed is
    begin
        if x < Y_LO then
            return Y_LO;
        elsif x > Y_HI then
            return Y_HI;
        end if;
        return resize(x, 36);
    end function;

    -- a product with its lower bits rounded away: the constant of 0 dropped bits is 0
    function near(product : signed) return signed is
    begin
        return resize(shift_right(product + shift_right(shift_left(to_signed(1, 60), 24 - F), 1), 24 - F), A);
    end function;

    -- the limits of acc are those of y with the fraction bits below
    constant ACC_LO : signed(A - 1 downto 0) := Y_LO & (F - 1 downto 0 => '0');
    constant ACC_HI : signed(A - 1 downto 0) := Y_HI & (F - 1 downto 0 => '0');
begin
    process (clk)
        variable kp_e    : signed(A - 1 downto 0);
        variable acc     : signed(A downto 0);
        variable rounded : signed(A + 1 downto 0);
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_prop <= (others => '0');
                r_acc  <= (others => '0');
                r_y    <= (others => '0');
            else
                kp_e := near(signed(kp) * signed(e));
                acc  := resize(signed(r_acc), A + 1) + resize(near(signed(ki) * signed(e)), A + 1);
                -- prop + acc takes one bit more, the rounding constant another
                rounded := resize(signed(r_prop), A + 2) + resize(signed(r_acc), A + 2) + to_signed(2**(F - 1), A + 2);
                r_y <= std_logic_vector(clamp(rounded(A + 1 downto F)));
                if en = '1' then
                    if mode = OFF then
                        r_prop <= (others => '0');
                        r_acc  <= std_logic_vector(clamp(signed(preset))) & (F - 1 downto 0 => '0');
                    elsif mode = P_ONLY then
                        r_prop <= std_logic_vector(kp_e);
                    elsif mode = RUN then
                        r_prop <= std_logic_vector(kp_e);
                        if acc < ACC_LO then
                            r_acc <= std_logic_vector(ACC_LO);
                        elsif acc > ACC_HI then
                            r_acc <= std_logic_vector(ACC_HI);
                        else
                            r_acc <= std_logic_vector(acc(A - 1 downto 0));
                        end if;
                    end if;
                end if;
            end if;
        end if;
    end process;
end architecture;
