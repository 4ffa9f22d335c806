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

bool is_usable(const Parameters &parameters, State &state, const Sensors &sensors) {
    if (sensors.wrench_validity != VALID) return false;
    const double *b = parameters.filter_b, *a = parameters.filter_a;
    for (int i = 0; i < 6; ++i) {
        const double x = sensors.wrench_in_sensor[i];
        if (!std::isfinite(x)) return false;
        if (state.filter_ready == 0) {
            state.filter_state[i][1] = (b[2] - a[2]) * x;
            state.filter_state[i][0] = (b[1] - a[1]) * x + state.filter_state[i][1];
        }
    }
    state.filter_ready = 1;
    return true;
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
    if (!is_usable(parameters, state, sensors)) {
        for (int i = 0; i < 6; ++i) record.wrench_in_base[i] = NOT_KNOWN;
        state.unbias_left = 0;
        return;
    }
    const double *b = parameters.filter_b, *a = parameters.filter_a;
    double f[6], g[6];
    for (int i = 0; i < 6; ++i) {
        const double x = sensors.wrench_in_sensor[i];
        const double y = b[0] * x + state.filter_state[i][0];
        state.filter_state[i][0] = b[1] * x - a[1] * y + state.filter_state[i][1];
        state.filter_state[i][1] = b[2] * x - a[2] * y;
        f[i] = y;
    }
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
