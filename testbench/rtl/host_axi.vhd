-- Port of the host beside gyro_top, whose registers it reads: AXI4-Lite slave, bus, and the words of the registers.
--   r_bus_bank_write, r_bus_bank_address, r_bus_bank_data    to write, address, data of gyro_top
--   a register of the firmware is a port with the name of its register port of gyro_top, without r_
-- Latency: a register of gyro_top has a word 3 clocks behind the edge that takes its write; a sample 1 clock behind the
-- last slot.
-- VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity gyro_host_axi is
    generic (
        DDS_BITS : natural := 48  -- width of the phase, 24 .. 48
    );
    port (
        clk                            : in  std_logic;
        rst                            : in  std_logic;  -- synchronous, active high: !ARESETn
        awvalid                        : in  std_logic;
        awaddr                         : in  std_logic_vector(10 downto 0);
        wvalid                         : in  std_logic;
        wdata                          : in  std_logic_vector(31 downto 0);
        wstrb                          : in  std_logic_vector(3 downto 0);
        bready                         : in  std_logic;
        arvalid                        : in  std_logic;
        araddr                         : in  std_logic_vector(10 downto 0);
        rready                         : in  std_logic;
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
        r_slave_awready                : out std_logic;
        r_slave_awaddr                 : out std_logic_vector(10 downto 0);
        r_slave_wready                 : out std_logic;
        r_slave_wdata                  : out std_logic_vector(31 downto 0);
        r_slave_wstrb                  : out std_logic_vector(3 downto 0);
        r_slave_bvalid                 : out std_logic;
        r_slave_bresp                  : out std_logic_vector(1 downto 0);
        r_slave_arready                : out std_logic;
        r_slave_araddr                 : out std_logic_vector(10 downto 0);
        r_slave_rvalid                 : out std_logic;
        r_slave_rdata                  : out std_logic_vector(31 downto 0);
        r_slave_rresp                  : out std_logic_vector(1 downto 0);
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
        o_awready                      : out std_logic;
        o_wready                       : out std_logic;
        o_bvalid                       : out std_logic;
        o_bresp                        : out std_logic_vector(1 downto 0);
        o_arready                      : out std_logic;
        o_rvalid                       : out std_logic;
        o_rdata                        : out std_logic_vector(31 downto 0);
        o_rresp                        : out std_logic_vector(1 downto 0);
        o_data_ready                   : out std_logic
    );
end entity;

architecture rtl of gyro_host_axi is
    constant SLOTS : natural := 60;

    function pairs return std_logic_vector is
    begin
        if DDS_BITS > 32 then
            return x"BC";
        end if;
        return x"00";
    end function;

    signal fetch, write, done, frame : std_logic;
    signal address                   : std_logic_vector(10 downto 0);
    signal rdata                     : std_logic_vector(31 downto 0);
    signal value                     : std_logic_vector(47 downto 0);
begin
    o_awready <= r_slave_awready;
    o_wready  <= r_slave_wready;
    o_bvalid  <= r_slave_bvalid;
    o_bresp   <= r_slave_bresp;
    o_arready <= r_slave_arready;
    o_rvalid  <= r_slave_rvalid;
    o_rdata   <= r_slave_rdata;
    o_rresp   <= r_slave_rresp;
    frame     <= '1' when unsigned(rates_slot) = SLOTS else '0';

    -- what the host reads: the word of the register at the slave's address; this port has no frames to be wrong
    words : entity work.gyro_host_words
        generic map (DDS_BITS => DDS_BITS)
        port map (
            address                        => address(10 downto 3),
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
            errors                         => "000",
            value                          => value
        );

    slave : entity work.gyro_axi_slave
        port map (
            clk       => clk,
            rst       => rst,
            awvalid   => awvalid,
            awaddr    => awaddr,
            wvalid    => wvalid,
            wdata     => wdata,
            wstrb     => wstrb,
            bready    => bready,
            arvalid   => arvalid,
            araddr    => araddr,
            rready    => rready,
            word      => rdata,
            r_awready => r_slave_awready,
            r_awaddr  => r_slave_awaddr,
            r_wready  => r_slave_wready,
            r_wdata   => r_slave_wdata,
            r_wstrb   => r_slave_wstrb,
            r_bvalid  => r_slave_bvalid,
            r_bresp   => r_slave_bresp,
            r_arready => r_slave_arready,
            r_araddr  => r_slave_araddr,
            r_rvalid  => r_slave_rvalid,
            r_rdata   => r_slave_rdata,
            r_rresp   => r_slave_rresp,
            o_address => address,
            o_write   => write,
            o_fetch   => fetch,
            o_done    => done
        );

    of_bus : entity work.gyro_host_bus
        generic map (pairs => pairs)
        port map (
            clk                => clk,
            rst                => rst,
            address            => address,
            fetch              => fetch,
            start              => '0',
            done               => done,
            write              => write,
            data               => r_slave_wdata,
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
            o_bus_status       => open,  -- of a frame of SPI
            o_data_ready       => o_data_ready
        );
end architecture;
