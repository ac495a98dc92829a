-- Port of the host beside gyro_top, whose registers it reads: SPI slave, bus, and the words of the registers.
--   r_bus_bank_write, r_bus_bank_address, r_bus_bank_data    to write, address, data of gyro_top
--   a register of the firmware is a port with the name of its register port of gyro_top, without r_
-- Latency: 2 clocks from the end of a frame on the SPI port's registers to write; a sample 1 clock behind the last
-- slot.
-- VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_host is
    generic (
        DDS_BITS : natural := 48  -- width of the phase, 24 .. 48
    );
    port (
        clk                            : in  std_logic;
        rst                            : in  std_logic;  -- synchronous, active high
        cs_n                           : in  std_logic;  -- pins of the host, asynchronous
        sck                            : in  std_logic;
        sdi                            : in  std_logic;
        registers_control              : in  std_logic_vector(8 downto 0);
        control_sequencer_faults_latch : in  std_logic_vector(7 downto 0);
        registers_phase_drive_sine     : in  std_logic_vector(DDS_BITS - 1 downto 0);
        registers_phase_sense_sine     : in  std_logic_vector(DDS_BITS - 1 downto 0);
        registers_phase_drive_ref      : in  std_logic_vector(DDS_BITS - 1 downto 0);
        registers_phase_sense_ref      : in  std_logic_vector(DDS_BITS - 1 downto 0);
        registers_amplitude_setpoint   : in  std_logic_vector(23 downto 0);
        registers_frequency_fixed      : in  std_logic_vector(DDS_BITS - 1 downto 0);
        registers_amplitude_fixed      : in  std_logic_vector(23 downto 0);
        registers_rate_fixed           : in  std_logic_vector(23 downto 0);
        registers_quadrature_fixed     : in  std_logic_vector(31 downto 0);
        registers_rate_bias            : in  std_logic_vector(31 downto 0);
        registers_rate_bias_t1         : in  std_logic_vector(31 downto 0);
        registers_rate_bias_t2         : in  std_logic_vector(31 downto 0);
        registers_rate_scale           : in  std_logic_vector(29 downto 0);
        registers_rate_scale_t1        : in  std_logic_vector(23 downto 0);
        registers_rate_scale_t2        : in  std_logic_vector(23 downto 0);
        registers_decimation           : in  std_logic_vector(2 downto 0);
        control_sequencer_state        : in  std_logic_vector(3 downto 0);
        control_sequencer_lock_locked  : in  std_logic_vector(3 downto 0);
        control_sequencer_faults_flags : in  std_logic_vector(7 downto 0);
        control_sequencer_attempts     : in  std_logic_vector(7 downto 0);
        control_frequency_tracker_word : in  std_logic_vector(DDS_BITS - 1 downto 0);
        control_agc_loop_y             : in  std_logic_vector(35 downto 0);
        control_cordic_magnitude       : in  std_logic_vector(24 downto 0);
        control_cordic_phase           : in  std_logic_vector(23 downto 0);
        control_rate_loop_loop_y       : in  std_logic_vector(35 downto 0);
        control_quadrature_loop_root_y : in  std_logic_vector(15 downto 0);
        control_rate_output_y          : in  std_logic_vector(31 downto 0);
        control_rate_output_t          : in  std_logic_vector(15 downto 0);
        rates_slot                     : in  std_logic_vector(5 downto 0);
        control_rate_output_valid      : in  std_logic;
        control_rate_output_k          : in  std_logic_vector(2 downto 0);
        r_slave_cs_meta                : out std_logic;
        r_slave_cs_n                   : out std_logic;
        r_slave_active                 : out std_logic;
        r_slave_sck_meta               : out std_logic;
        r_slave_sck                    : out std_logic;
        r_slave_sck_seen               : out std_logic;
        r_slave_sdi_meta               : out std_logic;
        r_slave_sdi                    : out std_logic;
        r_slave_phase                  : out std_logic_vector(2 downto 0);
        r_slave_bit                    : out std_logic_vector(4 downto 0);
        r_slave_words                  : out std_logic_vector(2 downto 0);
        r_slave_read                   : out std_logic;
        r_slave_address                : out std_logic_vector(10 downto 0);
        r_slave_crc                    : out std_logic_vector(7 downto 0);
        r_slave_shift                  : out std_logic_vector(39 downto 0);
        r_slave_data                   : out std_logic_vector(31 downto 0);
        r_slave_second                 : out std_logic;
        r_slave_spoiled                : out std_logic;
        r_slave_refused                : out std_logic;
        r_slave_write                  : out std_logic;
        r_slave_done                   : out std_logic;
        r_slave_errors                 : out std_logic_vector(2 downto 0);
        r_bus_high                     : out std_logic_vector(15 downto 0);
        r_bus_high_of                  : out std_logic_vector(7 downto 0);
        r_bus_low                      : out std_logic_vector(31 downto 0);
        r_bus_low_of                   : out std_logic_vector(2 downto 0);
        r_bus_pending                  : out std_logic;
        r_bus_bank_write               : out std_logic;
        r_bus_bank_address             : out std_logic_vector(7 downto 0);
        r_bus_bank_data                : out std_logic_vector(47 downto 0);
        r_bus_clear                    : out std_logic_vector(2 downto 0);
        r_bus_frames                   : out std_logic_vector(11 downto 0);
        r_bus_fresh                    : out std_logic;
        r_bus_rate                     : out std_logic_vector(31 downto 0);
        r_bus_temperature              : out std_logic_vector(15 downto 0);
        r_bus_status                   : out std_logic_vector(18 downto 0);
        r_bus_number                   : out std_logic_vector(11 downto 0);
        r_bus_held_temperature         : out std_logic_vector(15 downto 0);
        r_bus_held_status              : out std_logic_vector(20 downto 0);
        r_bus_held_number              : out std_logic_vector(11 downto 0);
        r_bus_unread                   : out std_logic_vector(1 downto 0);
        r_bus_unread_after             : out std_logic_vector(1 downto 0);
        r_bus_reading                  : out std_logic;
        o_sdo                          : out std_logic;
        o_data_ready                   : out std_logic
    );
end entity;

architecture rtl of gyro_host is
    constant SLOTS : natural := 60;

    function pairs return std_logic_vector is
    begin
        if DDS_BITS > 32 then
            return x"BC";
        end if;
        return x"00";
    end function;

    signal fetch, start, frame : std_logic;
    signal rdata               : std_logic_vector(31 downto 0);
    signal bus_status          : std_logic_vector(4 downto 0);
    signal value               : std_logic_vector(47 downto 0);
begin
    frame <= '1' when unsigned(rates_slot) = SLOTS else '0';

    -- what the host reads: the word of the register at the slave's address
    words : entity work.gyro_host_words
        generic map (DDS_BITS => DDS_BITS)
        port map (
            address                        => r_slave_address(10 downto 3),
            registers_control              => registers_control,
            control_sequencer_faults_latch => control_sequencer_faults_latch,
            registers_phase_drive_sine     => registers_phase_drive_sine,
            registers_phase_sense_sine     => registers_phase_sense_sine,
            registers_phase_drive_ref      => registers_phase_drive_ref,
            registers_phase_sense_ref      => registers_phase_sense_ref,
            registers_amplitude_setpoint   => registers_amplitude_setpoint,
            registers_frequency_fixed      => registers_frequency_fixed,
            registers_amplitude_fixed      => registers_amplitude_fixed,
            registers_rate_fixed           => registers_rate_fixed,
            registers_quadrature_fixed     => registers_quadrature_fixed,
            registers_rate_bias            => registers_rate_bias,
            registers_rate_bias_t1         => registers_rate_bias_t1,
            registers_rate_bias_t2         => registers_rate_bias_t2,
            registers_rate_scale           => registers_rate_scale,
            registers_rate_scale_t1        => registers_rate_scale_t1,
            registers_rate_scale_t2        => registers_rate_scale_t2,
            registers_decimation           => registers_decimation,
            control_sequencer_state        => control_sequencer_state,
            control_sequencer_lock_locked  => control_sequencer_lock_locked,
            control_sequencer_faults_flags => control_sequencer_faults_flags,
            control_sequencer_attempts     => control_sequencer_attempts,
            control_frequency_tracker_word => control_frequency_tracker_word,
            control_agc_loop_y             => control_agc_loop_y,
            control_cordic_magnitude       => control_cordic_magnitude,
            control_cordic_phase           => control_cordic_phase,
            control_rate_loop_loop_y       => control_rate_loop_loop_y,
            control_quadrature_loop_root_y => control_quadrature_loop_root_y,
            control_rate_output_y          => control_rate_output_y,
            control_rate_output_t          => control_rate_output_t,
            bus_rate                       => r_bus_rate,
            bus_held_temperature           => r_bus_held_temperature,
            bus_held_status                => r_bus_held_status,
            bus_held_number                => r_bus_held_number,
            errors                         => r_slave_errors,
            value                          => value
        );

    slave : entity work.gyro_spi_slave
        port map (
            clk        => clk,
            rst        => rst,
            cs_n       => cs_n,
            sck        => sck,
            sdi        => sdi,
            status     => bus_status,
            rdata      => rdata,
            clear      => r_bus_clear,
            r_cs_meta  => r_slave_cs_meta,
            r_cs_n     => r_slave_cs_n,
            r_active   => r_slave_active,
            r_sck_meta => r_slave_sck_meta,
            r_sck      => r_slave_sck,
            r_sck_seen => r_slave_sck_seen,
            r_sdi_meta => r_slave_sdi_meta,
            r_sdi      => r_slave_sdi,
            r_phase    => r_slave_phase,
            r_bit      => r_slave_bit,
            r_words    => r_slave_words,
            r_read     => r_slave_read,
            r_address  => r_slave_address,
            r_crc      => r_slave_crc,
            r_shift    => r_slave_shift,
            r_data     => r_slave_data,
            r_second   => r_slave_second,
            r_spoiled  => r_slave_spoiled,
            r_refused  => r_slave_refused,
            r_write    => r_slave_write,
            r_done     => r_slave_done,
            r_errors   => r_slave_errors,
            o_sdo      => o_sdo,
            o_fetch    => fetch,
            o_start    => start
        );

    of_bus : entity work.gyro_host_bus
        generic map (pairs => pairs)
        port map (
            clk                => clk,
            rst                => rst,
            address            => r_slave_address,
            fetch              => fetch,
            start              => start,
            done               => r_slave_done,
            write              => r_slave_write,
            data               => r_slave_data,
            value              => value,
            frame              => frame,
            valid              => control_rate_output_valid,
            rate               => control_rate_output_y,
            temperature        => control_rate_output_t,
            k                  => control_rate_output_k,
            flags              => control_sequencer_faults_flags,
            state              => control_sequencer_state,
            lock               => control_sequencer_lock_locked,
            r_high             => r_bus_high,
            r_high_of          => r_bus_high_of,
            r_low              => r_bus_low,
            r_low_of           => r_bus_low_of,
            r_pending          => r_bus_pending,
            r_bank_write       => r_bus_bank_write,
            r_bank_address     => r_bus_bank_address,
            r_bank_data        => r_bus_bank_data,
            r_clear            => r_bus_clear,
            r_frames           => r_bus_frames,
            r_fresh            => r_bus_fresh,
            r_rate             => r_bus_rate,
            r_temperature      => r_bus_temperature,
            r_status           => r_bus_status,
            r_number           => r_bus_number,
            r_held_temperature => r_bus_held_temperature,
            r_held_status      => r_bus_held_status,
            r_held_number      => r_bus_held_number,
            r_unread           => r_bus_unread,
            r_unread_after     => r_bus_unread_after,
            r_reading          => r_bus_reading,
            o_rdata            => rdata,
            o_bus_status       => bus_status,
            o_data_ready       => o_data_ready
        );
end architecture;
