-- SPI slave of the host, mode 0, SCK sampled by clk: a command of 16 bits, up to 7 words of 32 bits and a CRC of 8.
--   command       15 read   14..12 words   11 zero   10..0 byte address      a read has a CRC behind its command too
--   CS_N rises    a frame of the right length, CRC and command: r_write for a clock per word, or r_done; else r_errors
--   o_fetch       rdata of r_address is taken
-- Latency: 3 clocks from the edge that sees SCK high to the next bit on SDO; 3 from CS_N high to r_write and r_done.
-- SDO of a chip without the bus (CS_N high) must be released by the pin itself. VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_spi_slave is
    port (
        clk        : in  std_logic;
        rst        : in  std_logic;                      -- synchronous, active high
        cs_n       : in  std_logic;                      -- asynchronous, as are sck and sdi
        sck        : in  std_logic;
        sdi        : in  std_logic;
        status     : in  std_logic_vector(4 downto 0);   -- of the bus: the high bits of the status byte
        rdata      : in  std_logic_vector(31 downto 0);  -- word at r_address
        clear      : in  std_logic_vector(2 downto 0);   -- of r_errors
        r_cs_meta  : out std_logic;
        r_cs_n     : out std_logic;
        r_active   : out std_logic;
        r_sck_meta : out std_logic;
        r_sck      : out std_logic;
        r_sck_seen : out std_logic;
        r_sdi_meta : out std_logic;
        r_sdi      : out std_logic;
        r_phase    : out std_logic_vector(2 downto 0);   -- 0 COMMAND, 1 CHECK, 2 DATA, 3 TAIL, 4 COMPLETE, 5 TOO_LONG
        r_bit      : out std_logic_vector(4 downto 0);   -- of the phase
        r_words    : out std_logic_vector(2 downto 0);   -- still to come
        r_read     : out std_logic;
        r_address  : out std_logic_vector(10 downto 0);
        r_crc      : out std_logic_vector(7 downto 0);
        r_shift    : out std_logic_vector(39 downto 0);
        r_data     : out std_logic_vector(31 downto 0);
        r_second   : out std_logic;                      -- a second word is in the shift register
        r_spoiled  : out std_logic;                      -- wrong CRC
        r_refused  : out std_logic;                      -- wrong command
        r_write    : out std_logic;
        r_done     : out std_logic;
        r_errors   : out std_logic_vector(2 downto 0);   -- 0 CRC, 1 LENGTH, 2 COMMAND
        o_sdo      : out std_logic;
        o_fetch    : out std_logic;
        o_start    : out std_logic
    );
end entity;

architecture rtl of gyro_spi_slave is
    subtype phase_t is std_logic_vector(2 downto 0);
    constant COMMAND       : phase_t := "000";
    constant CHECK         : phase_t := "001";
    constant DATA          : phase_t := "010";
    constant TAIL          : phase_t := "011";
    constant COMPLETE      : phase_t := "100";
    constant TOO_LONG      : phase_t := "101";
    constant WRONG_CRC     : std_logic_vector(2 downto 0) := "001";
    constant WRONG_LENGTH  : std_logic_vector(2 downto 0) := "010";
    constant WRONG_COMMAND : std_logic_vector(2 downto 0) := "100";

    function flag(x : boolean) return std_logic is
    begin
        if x then
            return '1';
        end if;
        return '0';
    end function;

    -- the CRC register after one more bit
    function divided(crc : std_logic_vector(7 downto 0); x : std_logic) return std_logic_vector is
    begin
        if crc(7) /= x then
            return (crc(6 downto 0) & '0') xor x"1D";
        end if;
        return crc(6 downto 0) & '0';
    end function;

    signal rises, last, fetches : boolean;
begin
    rises   <= r_cs_n = '0' and r_sck = '1' and r_sck_seen = '0';
    last    <= unsigned(r_words) <= 1;
    fetches <= rises and r_read = '1' and ((r_phase = CHECK and unsigned(r_bit) = 7)
                                           or (r_phase = DATA and unsigned(r_bit) = 31 and not last));

    o_sdo   <= r_shift(39);
    o_fetch <= flag(fetches);
    o_start <= not r_cs_n and not r_active;

    process (clk)
        variable shifted : std_logic_vector(39 downto 0);
        variable crc     : std_logic_vector(7 downto 0);
        variable wrong   : std_logic_vector(2 downto 0);
        variable told    : std_logic_vector(7 downto 0);
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_cs_meta  <= '1';
                r_cs_n     <= '1';
                r_active   <= '0';
                r_sck_meta <= '0';
                r_sck      <= '0';
                r_sck_seen <= '0';
                r_sdi_meta <= '0';
                r_sdi      <= '0';
                r_phase    <= COMMAND;
                r_bit      <= (others => '0');
                r_words    <= (others => '0');
                r_read     <= '0';
                r_address  <= (others => '0');
                r_crc      <= (others => '1');
                r_shift    <= (others => '0');
                r_data     <= (others => '0');
                r_second   <= '0';
                r_spoiled  <= '0';
                r_refused  <= '0';
                r_write    <= '0';
                r_done     <= '0';
                r_errors   <= (others => '0');
            else
                r_cs_meta  <= cs_n;
                r_cs_n     <= r_cs_meta;
                r_active   <= not r_cs_n;
                r_sck_meta <= sck;
                r_sck      <= r_sck_meta;
                r_sck_seen <= r_sck;
                r_sdi_meta <= sdi;
                r_sdi      <= r_sdi_meta;
                r_write    <= '0';
                r_done     <= '0';
                wrong      := "000";
                if r_write = '1' and r_second = '1' then
                    r_write   <= '1';
                    r_data    <= r_shift(39 downto 8);
                    r_address <= std_logic_vector(unsigned(r_address) + 4);
                    r_second  <= '0';
                end if;
                if r_cs_n = '1' then
                    r_phase   <= COMMAND;
                    r_bit     <= (others => '0');
                    r_crc     <= (others => '1');
                    r_spoiled <= '0';
                    r_refused <= '0';
                    if r_active = '0' then
                        told    := status & r_errors;
                        r_shift <= told & not told & x"000000";
                    elsif r_phase = COMPLETE and r_spoiled = '0' and r_refused = '0' then
                        if r_read = '1' then
                            r_done <= '1';
                        else
                            r_write <= '1';
                        end if;
                        if r_second = '0' then
                            r_data <= r_shift(39 downto 8);
                        end if;
                    else
                        r_second <= '0';
                        if r_phase = COMPLETE then
                            wrong := WRONG_CRC when r_spoiled = '1' else WRONG_COMMAND;
                        elsif r_phase /= COMMAND or unsigned(r_bit) /= 0 then
                            wrong := WRONG_LENGTH;
                        end if;
                    end if;
                elsif rises then
                    shifted := r_shift(38 downto 0) & r_sdi;
                    r_shift <= shifted;
                    r_bit   <= std_logic_vector(unsigned(r_bit) + 1);
                    case r_phase is
                        when COMMAND =>
                            r_crc <= divided(r_crc, r_sdi);
                            if unsigned(r_bit) = 15 then
                                r_phase   <= CHECK when shifted(15) = '1' else DATA;
                                r_bit     <= (others => '0');
                                r_read    <= shifted(15);
                                r_words   <= shifted(14 downto 12);
                                r_address <= shifted(10 downto 0);
                                r_refused <= flag(unsigned(shifted(14 downto 12)) = 0
                                                  or (shifted(15) = '0' and unsigned(shifted(14 downto 12)) > 2)
                                                  or shifted(11) = '1' or shifted(1 downto 0) /= "00");
                            end if;
                        when CHECK =>
                            if unsigned(r_bit) = 7 then
                                r_phase   <= DATA;
                                r_bit     <= (others => '0');
                                r_spoiled <= flag(shifted(7 downto 0) /= not r_crc);
                            end if;
                        when DATA =>
                            crc   := divided(r_crc, r_shift(39)) when r_read = '1' else divided(r_crc, r_sdi);
                            r_crc <= crc;
                            if unsigned(r_bit) = 31 then
                                if last then
                                    r_phase <= TAIL;
                                    if r_read = '1' then
                                        r_shift <= not crc & x"00000000";
                                    end if;
                                else
                                    r_words <= std_logic_vector(unsigned(r_words) - 1);
                                    if r_read = '0' then
                                        r_data   <= shifted(31 downto 0);
                                        r_second <= '1';
                                    end if;
                                end if;
                            end if;
                        when TAIL =>
                            if unsigned(r_bit) = 7 then
                                r_phase <= COMPLETE;
                                r_bit   <= (others => '0');
                                if r_read = '0' then
                                    r_spoiled <= flag(shifted(7 downto 0) /= not r_crc);
                                end if;
                            end if;
                        when COMPLETE =>
                            r_phase <= TOO_LONG;
                        when others =>
                            null;
                    end case;
                    if fetches then
                        r_shift   <= rdata & x"00";
                        r_address <= std_logic_vector(unsigned(r_address) + 4);
                    end if;
                end if;
                r_errors <= (r_errors and not clear) or wrong;
            end if;
        end if;
    end process;
end architecture;
