// A host in time at the pins of the locked loop: locked_host STATE SEED LINES {RATE_DPS FASTEST SLOWEST WRONG SAMPLES} ..
// Prints frames, mean rate and standard error (deg/s, by the C driver) of each segment; lines of frames go to a file.
#include "host_bench.h"
#include "loop.h"

static const int SETTLE = 150, BLOCK = 25;

static bool is_sample(const Line &line) { return line.kind == SAMPLE && line.result == GYRO_SPI_OK; }

int main(int count, char **argument) {
    if (count < 4 || (count - 4) % 5) fail("usage: locked_host STATE SEED LINES {RATE_DPS FASTEST SLOWEST WRONG SAMPLES} ..");
    static Loop loop(argument[1]);
    static Host host;
    host.random.seed(std::strtoull(argument[2], nullptr, 10));
    host.first_flops.seed(std::strtoull(argument[2], nullptr, 10));
    host.free_running = true;
    for (int k = 4; k < count; k += 5) {
        double given[5];
        for (int j = 0; j < 5; j++) given[j] = std::atof(argument[k + j]);
        loop.board.rate = given[0] * (3.14159265358979323846 / 180);
        host.fastest = given[1]; host.slowest = given[2]; host.wrong = given[3];
        size_t first = host.lines.size();
        int samples = 0, frames = 0;
        for (; samples < given[4]; frames++) {
            size_t before = host.lines.size();
            for (int c = 0; c < FRAME_TICKS * TICK_CYCLES; c++) {
                int pins[3];
                host.before(loop.top.o_data_ready, pins);
                loop.top.cs_n = pins[0];
                loop.top.sck = pins[1];
                loop.top.sdi = pins[2];
                loop.clock();
                host.behind(loop.top.o_sdo);
            }
            for (size_t n = before; n < host.lines.size(); n++) samples += is_sample(host.lines[n]);
        }
        std::vector<double> blocks;
        double sum = 0, mean = 0, squares = 0;
        int n = 0;
        for (size_t at = first; at < host.lines.size(); at++) {
            uint32_t word[GYRO_SPI_SAMPLE_WORDS];
            if (!is_sample(host.lines[at]) || ++n <= SETTLE) continue;
            for (int j = 0; j < GYRO_SPI_SAMPLE_WORDS; j++) word[j] = (uint32_t)host.lines[at].word[j];
            sum += gyro_deg_per_s(gyro_sample_of(word).rate);
            if ((n - SETTLE) % BLOCK) continue;
            blocks.push_back(sum / BLOCK);
            sum = 0;
        }
        for (double block : blocks) mean += block / blocks.size();
        for (double block : blocks) squares += (block - mean) * (block - mean);
        std::printf("%d %.9f %.9f\n", frames, mean, std::sqrt(squares / (blocks.size() - 1) / blocks.size()));
    }
    std::printf("broken %lld\n", (long long)host.broken);
    FILE *file = std::fopen(argument[3], "wb");
    if (!file || std::fwrite(host.lines.data(), sizeof(Line), host.lines.size(), file) != host.lines.size() || std::fclose(file)) fail("LINES cannot be written");
    return 0;
}
