// An AXI4-Lite master in the gyroscope's clock: one request at a time, READY as soon as a response can come
#include "gyro_loop.h"
#include "loop.h"

enum { EVERY_BYTE = 15 };

Loop &loop() {
    struct Port : Loop {
        Port() : Loop("state.bin") { top.awvalid = top.wvalid = top.bready = top.arvalid = top.rready = 0; }
    };
    static Port only;
    return only;
}

int gyro_loop_read(uint16_t address, uint32_t *word) {
    Vgyro_board &top = loop().top;
    int response = 0;
    top.araddr = address;
    top.arvalid = top.rready = 1;
    for (bool answered = false; !answered;) {
        bool asked = top.o_arready;
        answered = top.o_rvalid;
        *word = top.o_rdata;
        response = top.o_rresp;
        loop().clock();
        if (asked) top.arvalid = 0;
    }
    top.rready = 0;
    return response;
}

int gyro_loop_write(uint16_t address, uint32_t word) {
    Vgyro_board &top = loop().top;
    int response = 0;
    top.awaddr = address;
    top.wdata = word;
    top.wstrb = EVERY_BYTE;
    top.awvalid = top.wvalid = top.bready = 1;
    for (bool answered = false; !answered;) {
        bool addressed = top.o_awready, given = top.o_wready;
        answered = top.o_bvalid;
        response = top.o_bresp;
        loop().clock();
        if (addressed) top.awvalid = 0;
        if (given) top.wvalid = 0;
    }
    top.bready = 0;
    return response;
}
