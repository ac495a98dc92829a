-- What a host reads: the word of each register of gyro_top, or of the port itself; 0 where no register is.
--   a register of the firmware is a port with the name of its register port of gyro_top, without r_
-- Latency: none, no clock.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_host_words is
    generic (
        DDS_BITS : natural := 48  -- width of the phase, 24 .. 48
    );
    port (
        address                        : in  std_logic_vector(7 downto 0);   -- of the register
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
        bus_rate                       : in  std_logic_vector(31 downto 0);  -- registers of the port itself
        bus_held_temperature           : in  std_logic_vector(15 downto 0);
        bus_held_status                : in  std_logic_vector(20 downto 0);
        bus_held_number                : in  std_logic_vector(11 downto 0);
        errors                         : in  std_logic_vector(2 downto 0);
        value                          : out std_logic_vector(47 downto 0)
    );
end entity;

architecture rtl of gyro_host_words is
    function word(x : std_logic_vector) return std_logic_vector is
    begin
        return std_logic_vector(resize(unsigned(x), 48));
    end function;
begin
    with address select value <=
        word(registers_control)                     when x"00",
        word(control_sequencer_faults_latch)        when x"01",
        word(registers_phase_drive_sine)            when x"02",
        word(registers_phase_sense_sine)            when x"03",
        word(registers_phase_drive_ref)             when x"04",
        word(registers_phase_sense_ref)             when x"05",
        word(registers_amplitude_setpoint)          when x"06",
        word(registers_frequency_fixed)             when x"07",
        word(registers_amplitude_fixed)             when x"08",
        word(registers_rate_fixed)                  when x"09",
        word(registers_quadrature_fixed)            when x"0A",
        word(registers_rate_bias)                   when x"0B",
        word(registers_rate_bias_t1)                when x"0C",
        word(registers_rate_bias_t2)                when x"0D",
        word(registers_rate_scale)                  when x"0E",
        word(registers_rate_scale_t1)               when x"0F",
        word(registers_rate_scale_t2)               when x"10",
        word(registers_decimation)                  when x"11",
        x"4759524F0002"                             when x"40",
        word(control_sequencer_state)               when x"41",
        word(control_sequencer_lock_locked)         when x"42",
        word(control_sequencer_faults_flags)        when x"43",
        word(control_sequencer_attempts)            when x"44",
        word(control_frequency_tracker_word)        when x"45",
        word(control_agc_loop_y(23 downto 0))       when x"46",
        word(control_cordic_magnitude)              when x"47",
        word(control_cordic_phase)                  when x"48",
        word(control_rate_loop_loop_y(23 downto 0)) when x"49",
        word(control_quadrature_loop_root_y)        when x"4A",
        word(control_rate_output_y)                 when x"4B",
        word(control_rate_output_t)                 when x"4C",
        word(bus_rate)                              when x"50",
        word(bus_held_temperature)                  when x"51",
        word(bus_held_status)                       when x"52",
        word(bus_held_number)                       when x"53",
        word(errors)                                when x"54",
        (others => '0')                             when others;
end architecture;
