// rtctl/wrench.py
#pragma once

#include <cmath>

#include "layout.hpp"

namespace wrench {
namespace {

void into_sensor(const double (*rotation)[3], const double *in_base, double *result) {
    const double gx = rotation[0][0] * in_base[0] + rotation[1][0] * in_base[1] + rotation[2][0] * in_base[2];
    const double gy = rotation[0][1] * in_base[0] + rotation[1][1] * in_base[1] + rotation[2][1] * in_base[2];
    const double gz = rotation[0][2] * in_base[0] + rotation[1][2] * in_base[1] + rotation[2][2] * in_base[2];
    result[0] = gz, result[1] = -gy, result[2] = gx;
}

void into_base(const double (*rotation)[3], double x, double y, double z, double *result) {
    const double gx = z, gy = -y, gz = x;
    for (int i = 0; i < 3; ++i) result[i] = rotation[i][0] * gx + rotation[i][1] * gy + rotation[i][2] * gz;
}

bool is_other_filter(const Parameters &a, const Parameters &b) {
    return a.moving_average != b.moving_average || a.window_ticks != b.window_ticks || a.filter_b[0] != b.filter_b[0];
}

bool is_usable(const Sensors &sensors) {
    if (sensors.wrench_validity != VALID) return false;
    for (int i = 0; i < 6; ++i)
        if (!std::isfinite(sensors.wrench_in_sensor[i])) return false;
    return true;
}

void rest(const Parameters &parameters, State &state, int i, double x) {
    const double *b = parameters.filter_b, *a = parameters.filter_a;
    state.filter_state[i][1] = (b[2] - a[2]) * x;
    state.filter_state[i][0] = (b[1] - a[1]) * x + state.filter_state[i][1];
    const int64_t n = parameters.window_ticks;
    for (int64_t k = 0; k < n; ++k) state.window[i][k] = x;
    state.window_sum[i] = double(n) * x;
    state.window_lap[i] = 0.0;
}

double butterworth(const Parameters &parameters, State &state, int i, double x) {
    const double *b = parameters.filter_b, *a = parameters.filter_a;
    const double y = b[0] * x + state.filter_state[i][0];
    state.filter_state[i][0] = b[1] * x - a[1] * y + state.filter_state[i][1];
    state.filter_state[i][1] = b[2] * x - a[2] * y;
    return y;
}

double average(const Parameters &parameters, State &state, int i, double x) {
    const int64_t k = state.window_at, n = parameters.window_ticks;
    state.window_sum[i] += x - state.window[i][k];
    state.window_lap[i] += x;
    state.window[i][k] = x;
    if (k == n - 1) {
        state.window_sum[i] = state.window_lap[i];
        state.window_lap[i] = 0.0;
    }
    return state.window_sum[i] / double(n);
}

void low_pass(const Parameters &parameters, State &state, const Sensors &sensors, double *result) {
    if (state.filter_ready == 0) {
        for (int i = 0; i < 6; ++i) rest(parameters, state, i, sensors.wrench_in_sensor[i]);
        state.window_at = 0;
        state.filter_ready = 1;
    }
    for (int i = 0; i < 6; ++i) {
        const double x = sensors.wrench_in_sensor[i];
        result[i] = parameters.moving_average ? average(parameters, state, i, x) : butterworth(parameters, state, i, x);
    }
    state.window_at = (state.window_at + 1) % parameters.window_ticks;
}

void average_bias(const Parameters &parameters, State &state, const double *wrench) {
    if (state.unbias_left == 0) return;
    for (int i = 0; i < 6; ++i) state.unbias_sum[i] += wrench[i];
    state.unbias_left -= 1;
    if (state.unbias_left == 0) {
        for (int i = 0; i < 6; ++i)
            state.bias_in_sensor[i] = state.unbias_sum[i] / double(parameters.unbias_ticks);
        state.unbiased = 1;
    }
}

void compensate(const Parameters &parameters, State &state, const Sensors &sensors, Record &record) {
    if (!is_usable(sensors)) {
        for (int i = 0; i < 6; ++i) record.wrench_in_base[i] = NOT_KNOWN;
        state.unbias_left = 0;
        return;
    }
    double f[6], g[6];
    low_pass(parameters, state, sensors, f);
    into_sensor(state.rotation, parameters.gravity_force_in_base_n, g);
    const double *r = parameters.centre_of_mass_in_sensor_mm;
    g[3] = r[1] * g[2] - r[2] * g[1];
    g[4] = r[2] * g[0] - r[0] * g[2];
    g[5] = r[0] * g[1] - r[1] * g[0];
    for (int i = 0; i < 6; ++i) f[i] -= g[i];
    average_bias(parameters, state, f);
    if (state.unbiased == 0) {
        for (int i = 0; i < 6; ++i) record.wrench_in_base[i] = NOT_KNOWN;
        return;
    }
    for (int i = 0; i < 6; ++i) f[i] -= state.bias_in_sensor[i];
    into_base(state.rotation, f[0], f[1], f[2], record.wrench_in_base);
    into_base(state.rotation, f[3], f[4], f[5], record.wrench_in_base + 3);
}

}  // namespace
}  // namespace wrench
