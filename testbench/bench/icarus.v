// Clock and pins of the firmware for an event-driven simulator; the board is the system task of vpi.cpp.
`timescale 1ns / 1ns

module icarus;
    reg clk = 1'b0;
    reg [1:0] back;
    wire [15:0] pins;
    gyro_board core (
        .clk(clk), .rst(1'b0), .drdy_n(back[1]), .dout(back[0]),
        .sample_x(18'd0), .sample_y(18'd0), .write(1'b0), .address(8'd0), .data(48'd0),
        .o_adc_cs_n(pins[0]), .o_adc_sclk(pins[1]), .o_refs(pins[5:2]), .o_drive_sync_n(pins[6]),
        .o_drive_sclk_en(pins[7]), .o_drive_sdin(pins[8]), .o_sense_sync_n(pins[9]), .o_sense_sclk_en(pins[10]),
        .o_sense_sdin(pins[11]), .o_sense_ldac_n(pins[12]), .o_quadrature_sync_n(pins[13]),
        .o_quadrature_sclk_en(pins[14]), .o_quadrature_sdin(pins[15]));
    initial begin
        $board_begin(pins, back);
        forever begin
            #19 clk = 1'b1;
            #19 clk = 1'b0;
            $board(pins, back);
        end
    end
endmodule
