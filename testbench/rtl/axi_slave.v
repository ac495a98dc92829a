// AXI4-Lite slave of the host: single words of 32 bits in the clock clk, one write and one read under way.
//   a request that was taken waits in its registers, its READY is 0 meanwhile; a write goes before a read
//   o_write, o_fetch   access at o_address, for one clock; a write has r_wdata, a read takes word
//   o_done             the host takes the word of a read
//   SLVERR, and no access: address no multiple of 4, or some strobes but not all. No strobe: OKAY, and no access
// Latency: 2 clocks from the edge that takes a request to the one that sees its response valid.
// Every output to the host is a register. ARESETn is !rst; the host's AWPROT and ARPROT are not looked at.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_axi_slave (
    input  wire        clk,
    input  wire        rst,        // synchronous, active high
    input  wire        awvalid,
    input  wire [10:0] awaddr,     // of a byte
    input  wire        wvalid,
    input  wire [31:0] wdata,
    input  wire  [3:0] wstrb,
    input  wire        bready,
    input  wire        arvalid,
    input  wire [10:0] araddr,
    input  wire        rready,
    input  wire [31:0] word,       // at o_address
    output reg         r_awready,
    output reg  [10:0] r_awaddr,
    output reg         r_wready,
    output reg  [31:0] r_wdata,
    output reg   [3:0] r_wstrb,
    output reg         r_bvalid,
    output reg   [1:0] r_bresp,    // 0 OKAY, 2 SLVERR
    output reg         r_arready,
    output reg  [10:0] r_araddr,
    output reg         r_rvalid,
    output reg  [31:0] r_rdata,
    output reg   [1:0] r_rresp,
    output wire [10:0] o_address,
    output wire        o_write,
    output wire        o_fetch,
    output wire        o_done
);

    localparam [1:0] OKAY = 2'b00, SLVERR = 2'b10;

    wire writes = !r_awready && !r_wready && !r_bvalid;
    wire reads = !r_arready && !r_rvalid && !writes;
    wire aligned = o_address[1:0] == 2'd0;
    wire every = r_wstrb == 4'hF;

    assign o_address = writes ? r_awaddr : r_araddr;
    assign o_write = writes && aligned && every;
    assign o_fetch = reads && aligned;
    assign o_done = r_rvalid && rready;

    always @(posedge clk) begin
        if (rst) begin
            r_awready <= 1'b1;
            r_awaddr  <= 11'd0;
            r_wready  <= 1'b1;
            r_wdata   <= 32'd0;
            r_wstrb   <= 4'd0;
            r_bvalid  <= 1'b0;
            r_bresp   <= OKAY;
            r_arready <= 1'b1;
            r_araddr  <= 11'd0;
            r_rvalid  <= 1'b0;
            r_rdata   <= 32'd0;
            r_rresp   <= OKAY;
        end else begin
            if (r_awready && awvalid) begin
                r_awready <= 1'b0;
                r_awaddr  <= awaddr;
            end
            if (r_wready && wvalid) begin
                r_wready <= 1'b0;
                r_wdata  <= wdata;
                r_wstrb  <= wstrb;
            end
            if (bready)
                r_bvalid <= 1'b0;
            if (writes) begin
                r_awready <= 1'b1;
                r_wready  <= 1'b1;
                r_bvalid  <= 1'b1;
                r_bresp   <= aligned && (every || r_wstrb == 4'h0) ? OKAY : SLVERR;
            end
            if (r_arready && arvalid) begin
                r_arready <= 1'b0;
                r_araddr  <= araddr;
            end
            if (rready)
                r_rvalid <= 1'b0;
            if (reads) begin
                r_arready <= 1'b1;
                r_rvalid  <= 1'b1;
                r_rdata   <= aligned ? word : 32'd0;
                r_rresp   <= aligned ? OKAY : SLVERR;
            end
        end
    end

endmodule
