// A host at the SPI pins of gyro_board in time, with the C driver's frames: any SCK and phase, old or new at flip-flops.
// Times are in clocks. `board` gives what the pins have; a Host is stepped before and behind each edge.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

#include "gyro_spi.h"

struct Event {
    double time;
    int pin, level;  // 0 CS_N, 1 SCK, 2 SDI
};

// One line per frame that was sent: what a test looks at
struct Line {
    int64_t kind, begin, taken, end, result, status, words, address, word[7], ready, period_e6;
};
static const int LINE = sizeof(Line) / sizeof(int64_t);

enum Kind { SAMPLE, ABORTED, BAD_READ_CRC, BAD_WRITE_CRC, HALF_PAIR, REGISTER, WRITE };

struct Host {
    std::mt19937_64 random, first_flops;  // two: the times of frames do not depend on their bits
    std::vector<Event> events;  // those to come, by time
    size_t next_event = 0;
    int level[3] = {1, 0, 0}, was[3] = {1, 0, 0};
    bool changed[3] = {false, false, false};
    std::vector<uint8_t> sent, received;
    std::vector<double> rises;
    std::vector<int> sdo;  // of the last clocks, by clock modulo its size
    double busy_until = 0;
    int64_t clock = 0, broken = 0;  // broken: SDO does not stand around a rise of SCK
    size_t heard = 0;
    Line line;
    std::vector<Line> lines;
    bool open = false;
    // the plan: least and greatest period of SCK (clocks), share of frames that are wrong, whether it reads each sample
    // by itself; and what a list asks for
    double fastest = 5, slowest = 5, wrong = 0;
    std::vector<std::vector<int64_t>> list;  // kind, address, words, word ..: after each other
    size_t at = 0;
    bool free_running = false;

    void plan(uint64_t seed, double fastest_of, double slowest_of, double wrong_of, bool free) {
        random.seed(seed);
        first_flops.seed(seed);
        fastest = fastest_of; slowest = slowest_of; wrong = wrong_of; free_running = free;
    }

    // Requests that are not answered
    int64_t left() const { return (int64_t)(list.size() - at) + open; }

    double uniform() { return std::uniform_real_distribution<double>(0, 1)(random); }
    int below(int n) { return (int)(uniform() * n); }

    void send(int64_t kind, const uint8_t *frame, size_t bytes, size_t bits, int64_t address, int64_t words, bool ready) {
        double period = fastest * std::pow(slowest / fastest, uniform());
        double begin = clock + 1 + uniform(), rise = begin + 5 + uniform() * period;
        sent.assign(frame, frame + bytes);
        received.assign(bytes, 0);
        rises.clear();
        heard = next_event = 0;
        events = {{begin, 0, 0}, {begin + uniform(), 2, frame[0] >> 7 & 1}};
        double high = 0;
        for (size_t k = 0; k < bits; k++) {
            high = std::min(std::max(2.001, (0.41 + 0.18 * uniform()) * period), period - 2.001);
            rises.push_back(rise);
            events.push_back({rise, 1, 1});
            events.push_back({rise + high, 1, 0});
            if (k + 1 < bits)
                events.push_back({rise + high + uniform() * (period - high - 1), 2, frame[(k + 1) / 8] >> (7 - (k + 1) % 8) & 1});
            rise += period;
        }
        double end = rise - period + high + 0.001 + 3 * uniform();
        events.push_back({end, 0, 1});
        busy_until = end + 5.001 + 20 * uniform();
        line = Line();
        line.kind = kind;
        line.begin = (int64_t)begin;
        line.taken = bits > 24 ? (int64_t)rises[24] : -1;  // the first word is, just before
        line.end = (int64_t)end;
        line.words = words;
        line.address = address;
        line.ready = ready;
        line.period_e6 = (int64_t)(period * 1e6);
        open = true;
    }

    void read(int64_t kind, int64_t address, int words, bool ready) {
        uint8_t frame[GYRO_SPI_READ_BYTES(GYRO_SPI_MOST_READ)];
        size_t bytes = gyro_spi_read((uint16_t)address, words, frame), bits = 8 * bytes;
        if (kind == BAD_READ_CRC) frame[2] ^= (uint8_t)(1 << below(8));
        if (kind == ABORTED) bits = 1 + below((int)bits - 1);
        send(kind, frame, bytes, bits, address, words, ready);
    }

    void write(int64_t kind, int64_t address, const uint32_t *word, int words) {
        uint8_t frame[GYRO_SPI_WRITE_BYTES(GYRO_SPI_MOST_WRITTEN)];
        size_t bytes = gyro_spi_write((uint16_t)address, word, words, frame);
        if (kind == BAD_WRITE_CRC) frame[2 + below((int)bytes - 2)] ^= (uint8_t)(1 << below(8));
        send(kind, frame, bytes, 8 * bytes, address, words, false);
    }

    void close() {
        uint32_t word[GYRO_SPI_MOST_READ] = {0};
        uint8_t status = 0;
        line.result = gyro_spi_reply(sent.data(), received.data(), word, &status);
        line.status = status;
        for (int k = 0; k < GYRO_SPI_MOST_READ; k++) line.word[k] = word[k];
        lines.push_back(line);
        open = false;
    }

    void begin(bool ready) {
        if (at < list.size()) {
            const std::vector<int64_t> &item = list[at++];
            uint32_t word[2] = {item.size() > 3 ? (uint32_t)item[3] : 0, item.size() > 4 ? (uint32_t)item[4] : 0};
            if (item[0] == REGISTER || item[0] == SAMPLE || item[0] == BAD_READ_CRC || item[0] == ABORTED) read(item[0], item[1], (int)item[2], ready);
            else write(item[0], item[1], word, (int)item[2]);
        } else if (free_running) {
            // registers that can be read only; a wrong write, or half of a pair (never both of one register)
            static const int WIDE[] = {0x10, 0x18, 0x20, 0x28, 0x38};
            uint32_t word[2] = {(uint32_t)random(), (uint32_t)random()};
            if (uniform() < wrong) {
                int kind = ABORTED + below(5);
                if (kind == ABORTED || kind == BAD_READ_CRC) read(kind, 0x280, 7, ready);
                else if (kind == BAD_WRITE_CRC) write(kind, below(2) ? 0 : WIDE[below(5)], word, 1 + below(2));
                else if (kind == HALF_PAIR) write(kind, below(2) ? WIDE[below(3)] : WIDE[3 + below(2)] + 4, word, 1);
                else read(kind, 0x200 + 8 * below(13), 2, ready);
            } else if (ready) read(SAMPLE, 0x280, 7, ready);
        }
    }

    // What the first flip-flops take at this edge: a pin that has changed since the last one is old or new
    void before(bool ready, int *pins) {
        if (open && clock > busy_until) close();
        if (!open) begin(ready);
        std::memcpy(was, level, sizeof was);
        bool moved[3] = {false, false, false};
        while (open && next_event < events.size() && events[next_event].time <= (double)clock) {
            Event &e = events[next_event++];
            moved[e.pin] = level[e.pin] != e.level || moved[e.pin];
            level[e.pin] = e.level;
        }
        for (int k = 0; k < 3; k++) pins[k] = moved[k] && (first_flops() & 1) ? was[k] : level[k];
    }

    // SDO between this edge and the next: taken at rises of SCK, and asked whether it stands around them
    void behind(int level_of_sdo) {
        sdo.resize(1024);
        sdo[clock % 1024] = level_of_sdo;
        while (open && heard < rises.size() && rises[heard] + 2 < (double)clock) {
            // before edge n the pin has the level behind edge n - 1
            int64_t first = (int64_t)std::ceil(rises[heard] - 1) - 1, last = (int64_t)std::ceil(rises[heard] + 2) - 1;
            int bit = sdo[first % 1024];
            for (int64_t n = first; n <= last; n++) broken += sdo[n % 1024] != bit;
            received[heard / 8] |= (uint8_t)(bit << (7 - heard % 8));
            heard++;
        }
        clock++;
    }

    // Both at the ports of a verilated board
    template <class Top> void drive(Top &top) {
        int pins[3];
        before(top.o_data_ready, pins);
        top.cs_n = pins[0]; top.sck = pins[1]; top.sdi = pins[2];
    }
    template <class Top> void hear(Top &top) { behind(top.o_sdo); }
};
