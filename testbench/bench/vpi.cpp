// The board as one system task for an event-driven simulator: $board(pins, back) once per clock, after the edge.
// Files and length come as +state=, +ticks=, +codes=.
#include "board.h"
#include "vpi_user.h"

static Board board;
static i64 ticks;
static const char *codes;
static double began;
static vpiHandle pins, back;

static const char *option(const char *name) {
    s_vpi_vlog_info info;
    vpi_get_vlog_info(&info);
    size_t length = std::strlen(name);
    for (int k = 0; k < info.argc; k++)
        if (!std::strncmp(info.argv[k], name, length)) return info.argv[k] + length;
    fail(name);
    return nullptr;
}

static void answer() {
    s_vpi_value value;
    value.format = vpiIntVal;
    value.value.integer = board.drdy_n() << 1 | board.dout();
    vpi_put_value(back, &value, nullptr, vpiNoDelay);
}

static PLI_INT32 first(PLI_BYTE8 *) {
    vpiHandle list = vpi_iterate(vpiArgument, vpi_handle(vpiSysTfCall, nullptr));
    pins = vpi_scan(list);
    back = vpi_scan(list);
    vpi_free_object(list);
    board.load(option("+state="));
    ticks = std::atoll(option("+ticks="));
    codes = option("+codes=");
    answer();
    board.begin();
    began = cpu_s();
    return 0;
}

static PLI_INT32 clock(PLI_BYTE8 *) {
    s_vpi_value value;
    value.format = vpiIntVal;
    vpi_get_value(pins, &value);
    int p = value.value.integer;
    board.clock(p & 1, p >> 1 & 1, p >> 2 & 15, p >> 6 & 1, p >> 7 & 1, p >> 8 & 1, p >> 9 & 1, p >> 10 & 1,
                p >> 11 & 1, p >> 12 & 1, p >> 13 & 1, p >> 14 & 1, p >> 15 & 1);
    answer();
    if (board.cycle == TICK_CYCLES) {
        board.end();
        if ((i64)board.drive_codes.size() == ticks) {
            board.write(codes, cpu_s() - began);
            vpi_control(vpiFinish, 0);
        } else board.begin();
        answer();
    }
    return 0;
}

static void enter(const char *name, PLI_INT32 (*function)(PLI_BYTE8 *)) {
    s_vpi_systf_data data;
    std::memset(&data, 0, sizeof data);
    data.type = vpiSysTask;
    data.tfname = name;
    data.calltf = function;
    vpi_register_systf(&data);
}

static void both() {
    enter("$board_begin", first);
    enter("$board", clock);
}

extern "C" {
void (*vlog_startup_routines[])() = {both, nullptr};
}
