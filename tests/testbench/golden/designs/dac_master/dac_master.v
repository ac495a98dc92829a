// SPI master as one counter: bits are taken from the word by index, nothing shifts
module dac_master #(parameter [4:0] BITS = 24, parameter [1:0] LEAD = 0, parameter LDAC = 0) (
  input wire clk, input wire areset, input wire start, input wire [23:0] data,
  output wire cs_n, output wire sck_gate, output wire mosi, output reg load_n
);
  reg [5:0] count;   // 0 idle; counts lead + bits down
  reg [23:0] held;
  reg pending;
  wire running = count != 0;
  wire [5:0] total = BITS + LEAD;
  assign cs_n = ~running;
  assign sck_gate = running && count <= BITS;
  wire [5:0] index = count <= BITS ? count - 6'd1 : BITS - 6'd1;
  reg last;
  assign mosi = running ? held[index] : 1'b0;
  always @(posedge clk or posedge areset)
    if (areset) begin count <= 0; held <= 0; pending <= 0; load_n <= 1; end
    else if (start) begin count <= total; held <= data; pending <= 0; load_n <= 1; end
    else begin
      load_n <= ~pending; pending <= 0;
      if (running) begin count <= count - 1; if (count == 1) pending <= LDAC; end
    end
endmodule
