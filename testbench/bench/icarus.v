// Clock and pins of gyro_core for an event-driven simulator; the board is the system task of vpi.cpp.
`timescale 1ns / 1ns

module icarus;
    reg clk = 1'b0;
    reg [1:0] back;
    wire [15:0] pins;
    gyro_core core (
        clk, back[1], back[0], pins[0], pins[1], pins[5:2], pins[6], pins[7], pins[8], pins[9], pins[10], pins[11],
        pins[12], pins[13], pins[14], pins[15]);
    initial begin
        $board_begin(pins, back);
        forever begin
            #19 clk = 1'b1;
            #19 clk = 1'b0;
            $board(pins, back);
        end
    end
endmodule
