-- PI controller with a clamped integrator.
--   mode 0 OFF: prop = 0, acc = clamp(preset)   1 P_ONLY: prop = kp*e   2 RUN: prop and acc   3 HOLD; en = 0 holds too
--   every clock: y = clamp(round(prop + acc))
-- Latency: 2 clocks from an enabled e to y.   Rounding: ties toward +inf, at y only.
-- Overflow: acc and y saturate at lo and hi; prop, [1,35,24], holds every product. VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_pi is
    generic (
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
        r_prop : out std_logic_vector(59 downto 0);      -- [1,35,24]
        r_acc  : out std_logic_vector(59 downto 0);      -- [1,35,24]
        r_y    : out std_logic_vector(35 downto 0)       -- [1,35,0]
    );
end entity;

architecture rtl of gyro_pi is
    constant OFF    : std_logic_vector(1 downto 0) := "00";
    constant P_ONLY : std_logic_vector(1 downto 0) := "01";
    constant RUN    : std_logic_vector(1 downto 0) := "10";

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

    -- the limits of acc are those of y with 24 fraction bits below
    constant ACC_LO : signed(59 downto 0) := Y_LO & (23 downto 0 => '0');
    constant ACC_HI : signed(59 downto 0) := Y_HI & (23 downto 0 => '0');
begin
    process (clk)
        variable kp_e    : signed(59 downto 0);
        variable acc     : signed(60 downto 0);
        variable rounded : signed(61 downto 0);
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_prop <= (others => '0');
                r_acc  <= (others => '0');
                r_y    <= (others => '0');
            else
                kp_e := signed(kp) * signed(e);
                acc  := resize(signed(r_acc), 61) + resize(signed(ki) * signed(e), 61);
                -- prop + acc takes one bit more, the rounding constant another
                rounded := resize(signed(r_prop), 62) + resize(signed(r_acc), 62) + to_signed(2**23, 62);
                r_y <= std_logic_vector(clamp(rounded(61 downto 24)));
                if en = '1' then
                    if mode = OFF then
                        r_prop <= (others => '0');
                        r_acc  <= std_logic_vector(clamp(signed(preset))) & (23 downto 0 => '0');
                    elsif mode = P_ONLY then
                        r_prop <= std_logic_vector(kp_e);
                    elsif mode = RUN then
                        r_prop <= std_logic_vector(kp_e);
                        if acc < ACC_LO then
                            r_acc <= std_logic_vector(ACC_LO);
                        elsif acc > ACC_HI then
                            r_acc <= std_logic_vector(ACC_HI);
                        else
                            r_acc <= std_logic_vector(acc(59 downto 0));
                        end if;
                    end if;
                end if;
            end if;
        end if;
    end process;
end architecture;
