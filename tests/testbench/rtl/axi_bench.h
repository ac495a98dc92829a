// A host at the AXI4-Lite port of gyro_board: random wait states on all five channels, reads and writes at the same time.
// Clocks are counted from 0. A Host is stepped before each edge, with what the slave's registers have.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

#include "gyro_spi.h"

// What the slave shows before an edge, and what the host answers
struct Slave {
    int64_t awready, wready, bvalid, bresp, arready, rvalid, rdata, rresp, data_ready;
};
struct Pins {
    int64_t awvalid = 0, awaddr = 0, wvalid = 0, wdata = 0, wstrb = 0, bready = 0, arvalid = 0, araddr = 0, rready = 0;
};

// One line per read or write that was answered: what a test looks at
struct Line {
    int64_t kind, begin, taken, end, response, address, word[7], lost, busy_e6;
};

enum Kind { SAMPLE, REGISTER, WRITE, SOME_STROBES, UNALIGNED, NO_STROBE, HALF_PAIR };

struct Operation {
    int64_t kind;
    std::vector<int64_t> address;  // of the words that are read, or the one that is written
    uint32_t data;
    int strobes;
};

struct Host {
    std::mt19937_64 random;
    int64_t clock = 0, broken = 0;
    Pins pins;
    Slave was = {};
    // the plan: share of clocks in which a channel goes on, log-uniform; share of other reads; whether it reads by itself
    double busiest = 1, slowest = 1, others = 0, read_busy = 1, write_busy = 1;
    bool free_running = false;
    std::vector<std::vector<int64_t>> list;  // kind, address, words or data, strobes
    size_t at = 0;
    bool reading = false, writing = false;
    Operation read_of, write_of;
    size_t asked = 0, answered = 0;
    bool address_gone = false, data_gone = false;
    Line read_line, write_line;
    std::vector<Line> lines;
    gyro_sample before_it = {};
    int64_t samples = 0;

    void plan(uint64_t seed, double busiest_of, double slowest_of, double others_of, bool free) {
        random.seed(seed);
        busiest = busiest_of; slowest = slowest_of; others = others_of; free_running = free;
    }

    // Requests that are not answered
    int64_t left() const { return (int64_t)(list.size() - at) + reading + writing; }

    double uniform() { return std::uniform_real_distribution<double>(0, 1)(random); }
    int64_t below(int64_t n) { return (int64_t)(uniform() * (double)n); }
    // share of clocks in which a channel does not wait, of one operation
    double drawn() { return busiest * std::pow(slowest / busiest, uniform()); }
    bool goes(double busy) { return uniform() < busy; }

    void begin_read(int64_t kind, const std::vector<int64_t> &address) {
        read_of = {kind, address, 0, 0};
        reading = true;
        asked = answered = 0;
        read_busy = drawn();
        read_line = Line();
        read_line.kind = kind;
        read_line.begin = clock;
        read_line.address = address[0];
        read_line.busy_e6 = (int64_t)(1e6 * read_busy);
    }

    void begin_write(int64_t kind, int64_t address, uint32_t data, int strobes) {
        write_of = {kind, {address}, data, strobes};
        writing = true;
        address_gone = data_gone = false;
        write_busy = drawn();
        write_line = Line();
        write_line.kind = kind;
        write_line.begin = clock;
        write_line.address = address;
        write_line.busy_e6 = (int64_t)(1e6 * write_busy);
    }

    void begin_sample() { begin_read(SAMPLE, {0x280, 0x288, 0x290, 0x298}); }

    // Writes that change nothing: refused, without a strobe, or half of a pair (never both halves of one register)
    void begin_void_write() {
        static const int64_t WIDE[] = {0x10, 0x18, 0x20, 0x28, 0x38};
        int kind = (int)(SOME_STROBES + below(4));
        int64_t address = 8 * below(18);
        int strobes = 15;
        if (kind == SOME_STROBES) strobes = (int)(1 + below(14));
        if (kind == NO_STROBE) strobes = 0;
        if (kind == UNALIGNED) address += 1 + below(3);
        if (kind == HALF_PAIR) address = below(2) ? WIDE[below(3)] : WIDE[3 + below(2)] + 4;
        begin_write(kind, address, (uint32_t)random(), strobes);
    }

    void begin(bool ready) {
        if (at < list.size()) {
            if (reading || writing) return;
            const std::vector<int64_t> &item = list[at++];
            if (item[0] == SAMPLE) begin_sample();
            else if (item[0] == REGISTER && item[2] == 2) begin_read(REGISTER, {item[1], item[1] + 4});
            else if (item[0] == REGISTER) begin_read(REGISTER, {item[1]});
            else begin_write(item[0], item[1], (uint32_t)item[2], (int)item[3]);
        } else if (free_running) {
            if (!writing && uniform() < 0.01 * others) begin_void_write();
            if (!reading && ready) {
                if (uniform() < others) {
                    int64_t address = 0x200 + 8 * below(13);
                    begin_read(REGISTER, {address, address + 4});
                } else begin_sample();
            }
        }
    }

    void close_read() {
        uint32_t word[GYRO_SPI_SAMPLE_WORDS];
        for (int k = 0; k < GYRO_SPI_SAMPLE_WORDS; k++) word[k] = (uint32_t)read_line.word[k];
        read_line.end = clock;
        if (read_of.kind == SAMPLE) {
            gyro_sample found = gyro_sample_of(word);
            read_line.lost = samples++ ? gyro_samples_lost(before_it, found) : 0;
            before_it = found;
        }
        lines.push_back(read_line);
        reading = false;
    }

    // What a slave must keep: VALID and what goes with it stay until READY
    void judge(const Slave &s) {
        if (was.bvalid && !pins.bready) broken += !s.bvalid || s.bresp != was.bresp;
        if (was.rvalid && !pins.rready) broken += !s.rvalid || s.rdata != was.rdata || s.rresp != was.rresp;
        if (s.bvalid && !(writing && address_gone && data_gone)) broken++;
        if (s.rvalid && !(reading && asked > answered)) broken++;
        was = s;
    }

    // Before an edge: levels of the host at it, and what passes there
    const Pins &before(const Slave &s) {
        if (clock++ < 4) return pins;  // reset
        judge(s);
        begin(s.data_ready);
        if (reading && !pins.arvalid && asked < read_of.address.size() && goes(read_busy)) {
            pins.arvalid = 1;
            pins.araddr = read_of.address[asked];
        }
        if (writing && !pins.awvalid && !address_gone && goes(write_busy)) {
            pins.awvalid = 1;
            pins.awaddr = write_of.address[0];
        }
        if (writing && !pins.wvalid && !data_gone && goes(write_busy)) {
            pins.wvalid = 1;
            pins.wdata = write_of.data;
            pins.wstrb = write_of.strobes;
        }
        if (reading && answered == 0 && s.rvalid && !read_line.taken) read_line.taken = clock - 1;
        pins.rready = goes(read_busy);
        pins.bready = goes(write_busy);
        return pins;
    }

    // Behind the edge: what has passed; where nothing is valid the other pins are noise
    void behind() {
        const Slave &s = was;
        if (clock <= 4) return;
        if (pins.arvalid && s.arready) {
            pins.arvalid = 0;
            asked++;
        }
        if (pins.awvalid && s.awready) {
            pins.awvalid = 0;
            address_gone = true;
        }
        if (pins.wvalid && s.wready) {
            pins.wvalid = 0;
            data_gone = true;
        }
        if (s.rvalid && pins.rready && reading) {
            bool sample = read_of.kind == SAMPLE;
            read_line.word[sample ? 2 * answered : answered] = s.rdata;
            read_line.response |= s.rresp;
            if (++answered == read_of.address.size()) close_read();
        }
        if (s.bvalid && pins.bready && writing) {
            write_line.response = s.bresp;
            write_line.end = clock;
            lines.push_back(write_line);
            writing = false;
        }
        if (!pins.arvalid) pins.araddr = below(2048);
        if (!pins.awvalid) pins.awaddr = below(2048);
        if (!pins.wvalid) {
            pins.wdata = (int64_t)(random() & 0xFFFFFFFFu);
            pins.wstrb = below(16);
        }
    }

    // Both at the ports of a verilated board
    template <class Top> void drive(Top &top) {
        const Pins &p = before(Slave{top.o_awready, top.o_wready, top.o_bvalid, top.o_bresp, top.o_arready, top.o_rvalid,
                                     top.o_rdata, top.o_rresp, top.o_data_ready});
        top.awvalid = p.awvalid; top.awaddr = p.awaddr; top.wvalid = p.wvalid; top.wdata = p.wdata; top.wstrb = p.wstrb;
        top.bready = p.bready; top.arvalid = p.arvalid; top.araddr = p.araddr; top.rready = p.rready;
    }
    template <class Top> void hear(Top &) { behind(); }
};
