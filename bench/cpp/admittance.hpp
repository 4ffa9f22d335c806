// rtctl/admittance.py
#pragma once

#include <algorithm>
#include <cmath>

#include "layout.hpp"

namespace admittance {
namespace {

double deadband(double force, double zeta) { return force > zeta ? 1.0 - zeta / force : 0.0; }

double lateral(const Parameters &parameters, const double *axis, const double *force, double *offset) {
    const double along = force[0] * axis[0] + force[1] * axis[1] + force[2] * axis[2];
    double squares = 0.0;
    for (int i = 0; i < 3; ++i) {
        const double f = parameters.project_first ? force[i] - along * axis[i] : force[i];
        squares += f * f;
    }
    const double share = deadband(std::sqrt(squares), parameters.deadband_n);
    const double step = parameters.lateral_gain_mm_per_n_s * share * parameters.period_s;
    squares = 0.0;
    for (int i = 0; i < 3; ++i) {
        offset[i] += step * (force[i] - along * axis[i]) * parameters.lateral_mask[i];
        squares += offset[i] * offset[i];
    }
    const double length = std::sqrt(squares);
    if (length > parameters.lateral_limit_mm)
        for (int i = 0; i < 3; ++i) offset[i] *= parameters.lateral_limit_mm / length;
    return length;
}

double blend(const Parameters &parameters, double depth_mm) {
    const double width = parameters.blend_end_mm - parameters.blend_start_mm;
    return std::min(std::max((depth_mm - parameters.blend_start_mm) / width, 0.0), 1.0);
}

double stylet_rate(const Parameters &parameters, double axial_force_n, double depth_mm) {
    const double excess = std::max(0.0, parameters.regulated_force_n - axial_force_n);
    return parameters.stylet_gain_mm_per_n_s * blend(parameters, depth_mm) * excess;
}

}  // namespace
}  // namespace admittance
