// The loop of rtctl/clock.py and rtctl/loop.py in C++, around the tick of tick.cpp: absolute deadlines, after an overrun on
// to the next grid point, counted. It is the reference for how many deadlines this machine lets anybody keep.

#include <time.h>

#include <cerrno>

#include "tick.cpp"

namespace {

int64_t now_ns() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

int64_t sleep_until(int64_t deadline_ns) {
    const timespec t = {time_t(deadline_ns / 1'000'000'000), long(deadline_ns % 1'000'000'000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
    }
    return now_ns();
}

}  // namespace

// Grid points 0 .. `ticks` - 1 at `period_ns`, each with a tick of the recorded `length` ones, over and over from `start`.
// Returns how many grid points were missed after the first tick.
extern "C" int64_t run_loop(const Memory *start, Memory *memory, const Sensors *sensors, Actuators *actuators,
                            Record *records, int64_t length, int64_t period_ns, int64_t ticks) {
    const int64_t origin = now_ns() + period_ns;
    int64_t tick_number = -1, missed = 0;
    for (int64_t k = 0; tick_number + 1 < ticks; k = (k + 1) % length) {
        const int64_t due = std::max((now_ns() - origin) / period_ns + 1, tick_number + 1);
        if (tick_number >= 0) missed += due - tick_number - 1;
        tick_number = due;
        const int64_t deadline = origin + due * period_ns, woken = sleep_until(deadline);
        if (k == 0) *memory = *start;
        records[k].lateness_ns = int32_t(std::min<int64_t>(woken - deadline, INT32_MAX));
        tick::tick(*memory, sensors[k], actuators[k], records[k]);
        memory->command = {};
        records[k].tick_ns = int32_t(std::min<int64_t>(now_ns() - woken, INT32_MAX));
    }
    return missed;
}
