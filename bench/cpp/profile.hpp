// rtctl/profile.py
#pragma once

#include <algorithm>
#include <cmath>

#include "layout.hpp"

namespace profile {
namespace {

void clear(Profile &profile, int64_t tick) {
    profile.start_tick = tick;
    profile.valid = 1;
    profile.reason = 1;
    profile.reason_value = profile.reason_bound = NOT_KNOWN;
    profile.duration_s = 0.0;
    for (int c = 0; c < AXES; ++c) profile.segments[c] = 0;
}

void append(Profile &profile, int channel, double start_s, double position, double velocity, double acceleration,
            double jerk) {
    const int64_t k = profile.segments[channel];
    profile.start_s[channel][k] = start_s;
    profile.position[channel][k] = position;
    profile.velocity[channel][k] = velocity;
    profile.acceleration[channel][k] = acceleration;
    profile.jerk[channel][k] = jerk;
    profile.segments[channel] = k + 1;
}

void append_velocity_change(Profile &profile, int channel, double position, double velocity, double acceleration,
                            double target, double limit_acceleration, double limit_jerk) {
    const double coast = velocity + 0.5 * acceleration * std::fabs(acceleration) / limit_jerk;
    const double direction = coast <= target ? 1.0 : -1.0;
    const double start = direction * acceleration;
    const double change = direction * (target - velocity);
    double peak = std::sqrt(std::max(limit_jerk * change + 0.5 * start * start, 0.0));
    double hold = 0.0;
    if (peak > limit_acceleration) {
        peak = std::max(limit_acceleration, start);
        hold = (change - (2.0 * peak * peak - start * start) / (2.0 * limit_jerk)) / peak;
    }
    const double durations[3] = {(peak - start) / limit_jerk, hold, peak / limit_jerk};
    const double jerks[3] = {limit_jerk, 0.0, -limit_jerk};
    double time = 0.0;
    for (int piece = 0; piece < 3; ++piece) {
        const double duration = durations[piece], jerk = jerks[piece] * direction;
        if (duration > 0.0) {
            append(profile, channel, time, position, velocity, acceleration, jerk);
            position += duration * (velocity + duration * (0.5 * acceleration + duration * jerk / 6.0));
            velocity += duration * (acceleration + 0.5 * duration * jerk);
            acceleration += duration * jerk;
            time += duration;
        }
    }
    append(profile, channel, time, position, target, 0.0, 0.0);
    profile.duration_s = std::max(profile.duration_s, time);
}

struct Point {
    double position, velocity, acceleration;
};

Point evaluate(const Profile &profile, int channel, double time_s) {
    int64_t k = profile.segments[channel] - 1;
    while (k > 0 && time_s < profile.start_s[channel][k]) --k;
    const double t = time_s - profile.start_s[channel][k];
    const double p = profile.position[channel][k], v = profile.velocity[channel][k];
    const double a = profile.acceleration[channel][k], j = profile.jerk[channel][k];
    return {p + t * (v + t * (0.5 * a + t * j / 6.0)), v + t * (a + 0.5 * t * j), a + t * j};
}

double final_position(const Profile &profile, int channel) {
    return profile.position[channel][profile.segments[channel] - 1];
}

}  // namespace
}  // namespace profile
