// rtctl/electrode/path.py
#pragma once

#include <algorithm>

#include "layout.hpp"

namespace path {
namespace {

void evaluate_path(const Plan &path, double depth_mm, double *value, double *slope) {
    const int64_t last = path.intervals - 1;
    const double end = path.depth_mm[path.intervals];
    const bool resting = depth_mm < path.depth_mm[0] || depth_mm > end;
    const double depth = resting ? std::min(std::max(depth_mm, path.depth_mm[0]), end) : depth_mm;
    int64_t i = 0;
    while (i < last && depth >= path.depth_mm[i + 1]) ++i;
    const double u = depth - path.depth_mm[i];
    for (int64_t c = 0; c < path.channels; ++c) {
        const double c3 = path.coefficient[i][c][0], c2 = path.coefficient[i][c][1];
        const double c1 = path.coefficient[i][c][2], c0 = path.coefficient[i][c][3];
        value[c] = c0 + u * (c1 + u * (c2 + u * c3));
        slope[c] = resting ? 0.0 : c1 + u * (2.0 * c2 + u * 3.0 * c3);
    }
}

}  // namespace
}  // namespace path
