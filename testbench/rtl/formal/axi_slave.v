// Protocol checker of gyro_axi_slave: what AXI4-Lite asks of a slave, whatever the host does.
//   aw, w, b, ar, r   a transfer of that channel at this edge
//   owed_*            transfers of a request without one of the response
//   asked_*           what the last transfer of a request had
//   *_of_the_past     an output is a function of the clock before: no input leads to it in the same clock
module prove_axi_slave (
    input wire clk,
    input wire rst,
    input wire awvalid,
    input wire [10:0] awaddr,
    input wire wvalid,
    input wire [31:0] wdata,
    input wire [3:0] wstrb,
    input wire bready,
    input wire arvalid,
    input wire [10:0] araddr,
    input wire rready,
    input wire [31:0] word,
    input wire r_awready,
    input wire [10:0] r_awaddr,
    input wire r_wready,
    input wire [31:0] r_wdata,
    input wire [3:0] r_wstrb,
    input wire r_bvalid,
    input wire [1:0] r_bresp,
    input wire r_arready,
    input wire [10:0] r_araddr,
    input wire r_rvalid,
    input wire [31:0] r_rdata,
    input wire [1:0] r_rresp,
    input wire [10:0] o_address,
    input wire o_write,
    input wire o_fetch,
    input wire o_done
);

    reg begun = 1'b0;
    reg was_rst, was_awready, was_wready, was_arready, was_bvalid, was_rvalid, was_aw, was_w, was_b, was_ar, was_r;
    reg was_write, was_fetch, was_waiting;
    reg [1:0] was_bresp, was_rresp, owed_aw, owed_w, owed_ar;
    reg [31:0] was_rdata, was_word, asked_data;
    reg [10:0] asked_write, asked_read;
    reg [3:0] asked_strobes;

    wire aw = awvalid && r_awready;
    wire w = wvalid && r_wready;
    wire b = r_bvalid && bready;
    wire ar = arvalid && r_arready;
    wire r = r_rvalid && rready;

    // both parts of a write, or a read, wait for an access, and their response has room
    wire was_write_due = !was_awready && !was_wready && !was_bvalid;
    wire was_read_due = !was_arready && !was_rvalid;
    wire read_due = !r_arready && !r_rvalid;
    wire served = was_read_due && r_rvalid;
    wire whole_write = asked_write[1:0] == 2'd0 && asked_strobes == 4'hF;
    wire right_write = asked_write[1:0] == 2'd0 && (asked_strobes == 4'hF || asked_strobes == 4'h0);

    always @(posedge clk) begin
        begun       <= 1'b1;
        was_rst     <= rst;
        was_awready <= r_awready;
        was_wready  <= r_wready;
        was_arready <= r_arready;
        was_bvalid  <= r_bvalid;
        was_rvalid  <= r_rvalid;
        was_bresp   <= r_bresp;
        was_rresp   <= r_rresp;
        was_rdata   <= r_rdata;
        was_word    <= word;
        was_aw      <= aw;
        was_w       <= w;
        was_b       <= b;
        was_ar      <= ar;
        was_r       <= r;
        was_write   <= o_write;
        was_fetch   <= o_fetch;
        was_waiting <= read_due && was_read_due && !was_rst && !rst;
        if (rst) begin
            owed_aw <= 2'd0;
            owed_w  <= 2'd0;
            owed_ar <= 2'd0;
        end else begin
            owed_aw <= owed_aw + {1'b0, aw} - {1'b0, b};
            owed_w  <= owed_w + {1'b0, w} - {1'b0, b};
            owed_ar <= owed_ar + {1'b0, ar} - {1'b0, r};
        end
        if (aw)
            asked_write <= awaddr;
        if (w) begin
            asked_data    <= wdata;
            asked_strobes <= wstrb;
        end
        if (ar)
            asked_read <= araddr;
    end

    always @* begin
        if (!begun)
            assume (rst);
        else if (was_rst)
            resets: assert (!r_bvalid && !r_rvalid && r_awready && r_wready && r_arready);
        else begin
            bvalid_stays: assert (!was_bvalid || was_b || r_bvalid);
            bresp_stays: assert (!was_bvalid || was_b || r_bresp == was_bresp);
            rvalid_stays: assert (!was_rvalid || was_r || r_rvalid);
            word_stays: assert (!was_rvalid || was_r || (r_rdata == was_rdata && r_rresp == was_rresp));
            response_after_both: assert (!r_bvalid || (owed_aw != 2'd0 && owed_w != 2'd0));
            word_after_request: assert (!r_rvalid || owed_ar != 2'd0);
            one_response_per_address: assert (owed_aw == {1'b0, !r_awready} + {1'b0, r_bvalid});
            one_response_per_data: assert (owed_w == {1'b0, !r_wready} + {1'b0, r_bvalid});
            one_word_per_request: assert (owed_ar == {1'b0, !r_arready} + {1'b0, r_rvalid});
            awready_of_the_past: assert (r_awready == (was_write_due || (was_awready && !was_aw)));
            wready_of_the_past: assert (r_wready == (was_write_due || (was_wready && !was_w)));
            arready_of_the_past: assert (r_arready == (served || (was_arready && !was_ar)));
            bvalid_of_the_past: assert (r_bvalid == (was_write_due || (was_bvalid && !was_b)));
            rvalid_of_the_past: assert (r_rvalid == ((was_read_due && !was_write_due) || (was_rvalid && !was_r)));
            responses_known: assert (!r_bresp[0] && !r_rresp[0]);
            address_is_kept: assert (r_awready || r_awaddr == asked_write);
            data_is_kept: assert (r_wready || (r_wdata == asked_data && r_wstrb == asked_strobes));
            read_address_is_kept: assert (r_arready || r_araddr == asked_read);
            write_as_asked: assert (!o_write || (o_address == asked_write && r_wdata == asked_data));
            write_once: assert (!o_write || (owed_aw == 2'd1 && owed_w == 2'd1 && !r_bvalid));
            refused_changes_nothing: assert (!o_write || whole_write);
            response_is_right: assert (!was_write_due || r_bresp == (right_write ? 2'd0 : 2'd2));
            okay_is_written: assert (!was_write_due || was_write == whole_write);
            fetch_as_asked: assert (!o_fetch || (o_address == asked_read && owed_ar == 2'd1 && !r_rvalid));
            word_of_the_access: assert (!served || r_rdata == (was_fetch ? was_word : 32'd0));
            unaligned_is_refused: assert (!served || (r_rresp == 2'd0) == was_fetch);
            one_access: assert (!o_write || !o_fetch);
            read_waits_one_clock: assert (!(was_waiting && read_due));
            done_is_taken: assert (o_done == r);
        end
    end

endmodule
