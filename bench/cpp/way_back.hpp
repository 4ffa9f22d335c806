// rtctl/way_back.py
#pragma once

#include <algorithm>

#include "layout.hpp"

namespace way_back {
namespace {

constexpr double STEP_MM = 0.1;
constexpr int ROWS = 201;

int row(double depth_mm) { return std::min(std::max(int(depth_mm / STEP_MM), 0), ROWS - 2); }

void remember(double (*way_mm)[3], double depth_mm, const double *offset_mm) {
    std::copy_n(offset_mm, 3, way_mm[row(depth_mm) + 1]);
}

void undo(const double (*way_mm)[3], double before_mm, double depth_mm, double *offset_mm) {
    if (!(depth_mm < before_mm)) return;
    const int k = row(depth_mm);
    const double share = std::min((before_mm - depth_mm) / (before_mm - k * STEP_MM), 1.0);
    for (int i = 0; i < 3; ++i) offset_mm[i] += share * (way_mm[k][i] - offset_mm[i]);
}

}  // namespace
}  // namespace way_back
