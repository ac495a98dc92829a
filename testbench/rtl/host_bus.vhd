-- Bus of the host: words of 32 bits to registers of up to 48 bits, and a sample of the rate that is read as a whole.
--   fetch   rdata of address is read: a low word latches its high word; the word of SAMPLE_RATE takes the sample
--   write   a register of one word at once; of two words both when the high one comes, in one clock
--   frame   end of the 8 kHz work: a sample if the rate was new
-- Latency: 1 clock from write to r_bank_write and r_clear, from frame to a sample.   No rounding.   r_frames wraps.
-- VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_host_bus is
    generic (
        pairs : std_logic_vector(7 downto 0) := x"BC"          -- registers of two words, a bit each
    );
    port (
        clk                : in  std_logic;
        rst                : in  std_logic;                    -- synchronous, active high
        address            : in  std_logic_vector(10 downto 0);  -- of a byte
        fetch              : in  std_logic;
        start              : in  std_logic;                    -- of a frame on the host's port
        done               : in  std_logic;                    -- a frame with reads was right
        write              : in  std_logic;
        data               : in  std_logic_vector(31 downto 0);
        value              : in  std_logic_vector(47 downto 0);  -- of the register at address
        frame              : in  std_logic;
        valid              : in  std_logic;                    -- the rate is new
        rate               : in  std_logic_vector(31 downto 0);
        temperature        : in  std_logic_vector(15 downto 0);
        k                  : in  std_logic_vector(2 downto 0);
        flags              : in  std_logic_vector(7 downto 0);
        state              : in  std_logic_vector(3 downto 0);
        lock               : in  std_logic_vector(3 downto 0);
        r_high             : out std_logic_vector(15 downto 0);
        r_high_of          : out std_logic_vector(7 downto 0);
        r_low              : out std_logic_vector(31 downto 0);
        r_low_of           : out std_logic_vector(2 downto 0);
        r_pending          : out std_logic;                    -- a low word waits for its high word
        r_bank_write       : out std_logic;                    -- to the register bank
        r_bank_address     : out std_logic_vector(7 downto 0);
        r_bank_data        : out std_logic_vector(47 downto 0);
        r_clear            : out std_logic_vector(2 downto 0);  -- errors of the port
        r_frames           : out std_logic_vector(11 downto 0);
        r_fresh            : out std_logic;                    -- the rate was new in this frame
        r_rate             : out std_logic_vector(31 downto 0);  -- the newest sample
        r_temperature      : out std_logic_vector(15 downto 0);
        r_status           : out std_logic_vector(18 downto 0);
        r_number           : out std_logic_vector(11 downto 0);
        r_held_temperature : out std_logic_vector(15 downto 0);
        r_held_status      : out std_logic_vector(20 downto 0);
        r_held_number      : out std_logic_vector(11 downto 0);
        r_unread           : out std_logic_vector(1 downto 0);  -- samples since the last that was read, to 2
        r_unread_after     : out std_logic_vector(1 downto 0);  -- samples since the last that was taken, to 2
        r_reading          : out std_logic;                    -- a sample was taken in this frame of the port
        o_rdata            : out std_logic_vector(31 downto 0);
        o_bus_status       : out std_logic_vector(4 downto 0);
        o_data_ready       : out std_logic
    );
end entity;

architecture rtl of gyro_host_bus is
    constant SPI_ERRORS  : std_logic_vector(7 downto 0)  := x"54";
    constant SAMPLE_RATE : std_logic_vector(10 downto 0) := "01010000000";
    constant LOCKED      : std_logic_vector(3 downto 0)  := x"C";
    constant MANY        : std_logic_vector(1 downto 0)  := "10";

    function flag(x : boolean) return std_logic is
    begin
        if x then
            return '1';
        end if;
        return '0';
    end function;

    -- a count to 2
    function counted(x : std_logic_vector(1 downto 0); one : boolean) return std_logic_vector is
    begin
        if one and x /= MANY then
            return std_logic_vector(unsigned(x) + 1);
        end if;
        return x;
    end function;

    signal number        : std_logic_vector(7 downto 0);
    signal second        : std_logic;
    signal pair          : boolean;
    signal ready, overrun : std_logic;
begin
    number  <= address(10 downto 3);
    second  <= address(2);
    pair    <= unsigned(number) < 8 and pairs(to_integer(unsigned(number(2 downto 0)))) = '1';
    ready   <= flag(r_unread /= "00");
    overrun <= flag(r_unread = MANY);

    o_rdata      <= value(31 downto 0) when second = '0'
                    else x"0000" & r_high when r_high_of = number else (others => '0');
    o_bus_status <= ready & overrun & flag(unsigned(flags) /= 0) & flag(state = LOCKED) & r_pending;
    o_data_ready <= ready;

    process (clk)
        variable sample, take : boolean;
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_high             <= (others => '0');
                r_high_of          <= (others => '0');
                r_low              <= (others => '0');
                r_low_of           <= (others => '0');
                r_pending          <= '0';
                r_bank_write       <= '0';
                r_bank_address     <= (others => '0');
                r_bank_data        <= (others => '0');
                r_clear            <= (others => '0');
                r_frames           <= (others => '0');
                r_fresh            <= '0';
                r_rate             <= (others => '0');
                r_temperature      <= (others => '0');
                r_status           <= (others => '0');
                r_number           <= (others => '0');
                r_held_temperature <= (others => '0');
                r_held_status      <= (others => '0');
                r_held_number      <= (others => '0');
                r_unread           <= (others => '0');
                r_unread_after     <= (others => '0');
                r_reading          <= '0';
            else
                if fetch = '1' and second = '0' then
                    r_high    <= value(47 downto 32);
                    r_high_of <= number;
                end if;
                r_bank_write <= '0';
                r_clear      <= (others => '0');
                if write = '1' then
                    r_pending <= '0';
                    if second = '1' then
                        if r_pending = '1' and "00000" & r_low_of = number then
                            r_bank_write   <= '1';
                            r_bank_address <= number;
                            r_bank_data    <= data(15 downto 0) & r_low;
                        end if;
                    elsif pair then
                        r_low     <= data;
                        r_low_of  <= number(2 downto 0);
                        r_pending <= '1';
                    else
                        r_bank_write   <= '1';
                        r_bank_address <= number;
                        r_bank_data    <= x"0000" & data;
                        if number = SPI_ERRORS then
                            r_clear <= data(2 downto 0);
                        end if;
                    end if;
                end if;
                sample := frame = '1' and (r_fresh = '1' or valid = '1');
                take   := fetch = '1' and address = SAMPLE_RATE;
                if frame = '1' then
                    r_frames <= std_logic_vector(unsigned(r_frames) + 1);
                    r_fresh  <= '0';
                else
                    r_fresh <= r_fresh or valid;
                end if;
                if sample then
                    r_rate        <= rate;
                    r_temperature <= temperature;
                    r_status      <= k & lock & state & flags;
                    r_number      <= r_frames;
                end if;
                if take then
                    r_held_temperature <= r_temperature;
                    r_held_status      <= overrun & ready & r_status;
                    r_held_number      <= r_number;
                    r_unread_after     <= counted("00", sample);
                    r_reading          <= '1';
                else
                    r_unread_after <= counted(r_unread_after, sample);
                    if start = '1' or done = '1' then
                        r_reading <= '0';
                    end if;
                end if;
                if done = '1' and r_reading = '1' then
                    r_unread <= counted(r_unread_after, sample);
                else
                    r_unread <= counted(r_unread, sample);
                end if;
            end if;
        end if;
    end process;
end architecture;
