// rtctl/robots/planar_3rpr.py
#pragma once

#include <algorithm>
#include <cmath>

#include "layout.hpp"

namespace planar_3rpr {
namespace {

struct Leg {
    double q, turn, by_x, by_y, by_phi;
};

inline Leg leg(const Robot &robot, int i, double x, double y, double c, double s) {
    const double a = robot.a_mm[i], cosine = robot.alpha_cos[i], sine = robot.alpha_sin[i];
    const double r = robot.pulley_radius_mm[i];
    const double ex = c * robot.platform_mm[i][0] - s * robot.platform_mm[i][1];
    const double ey = s * robot.platform_mm[i][0] + c * robot.platform_mm[i][1];
    const double dx = x + ex - robot.base_mm[i][0], dy = y + ey - robot.base_mm[i][1];
    const double dd = dx * dx + dy * dy;
    const double ds = std::sqrt(dd - a * a * sine * sine);
    const double q = a * cosine + ds;

    const double along = a - q * cosine, across = q * sine;
    const double arm_x = dx * along - dy * across, arm_y = dy * along + dx * across;
    const double home_x = robot.home_arm[i][0], home_y = robot.home_arm[i][1];
    const double turn = std::atan2(arm_y * home_x - arm_x * home_y, arm_x * home_x + arm_y * home_y);

    const double pull = (1.0 - r * a * sine / dd) / ds;
    const double wind = r / dd;
    return {q, turn, pull * dx + wind * dy, pull * dy - wind * dx,
            pull * (ex * dy - ey * dx) - wind * (dx * ex + dy * ey)};
}

bool inverse(const Robot &robot, const double *pose, double *joint, double *motor) {
    const double c = std::cos(pose[2]), s = std::sin(pose[2]);
    bool assembled = true;
    for (int i = 0; i < 3; ++i) {
        const Leg l = leg(robot, i, pose[0], pose[1], c, s);
        motor[i] = (l.q - robot.pulley_radius_mm[i] * l.turn) / robot.eta_mm_per_rad[i];
        joint[i] = l.q;
        assembled = assembled && std::isfinite(motor[i]);
    }
    if (!assembled)
        for (int i = 0; i < 3; ++i) joint[i] = motor[i] = NOT_KNOWN;
    return assembled;
}

int forward(const Robot &robot, const double *motor, double *pose) {
    double x = pose[0], y = pose[1], phi = pose[2];
    const double u1 = motor[0] * robot.eta_mm_per_rad[0];
    const double u2 = motor[1] * robot.eta_mm_per_rad[1];
    const double u3 = motor[2] * robot.eta_mm_per_rad[2];
    for (int step = 1; step <= NEWTON_LIMIT; ++step) {
        const double c = std::cos(phi), s = std::sin(phi);
        const auto [q1, turn1, a1, b1, c1] = leg(robot, 0, x, y, c, s);
        const auto [q2, turn2, a2, b2, c2] = leg(robot, 1, x, y, c, s);
        const auto [q3, turn3, a3, b3, c3] = leg(robot, 2, x, y, c, s);
        const double v1 = u1 - q1 + robot.pulley_radius_mm[0] * turn1;
        const double v2 = u2 - q2 + robot.pulley_radius_mm[1] * turn2;
        const double v3 = u3 - q3 + robot.pulley_radius_mm[2] * turn3;
        const double m1 = b2 * c3 - b3 * c2, m2 = b3 * c1 - b1 * c3, m3 = b1 * c2 - b2 * c1;
        const double inverted = 1.0 / (a1 * m1 + a2 * m2 + a3 * m3);
        const double change_x = inverted * (v1 * m1 + v2 * m2 + v3 * m3);
        const double change_y =
            inverted * (v1 * (c2 * a3 - c3 * a2) + v2 * (c3 * a1 - c1 * a3) + v3 * (c1 * a2 - c2 * a1));
        const double change_phi =
            inverted * (v1 * (a2 * b3 - a3 * b2) + v2 * (a3 * b1 - a1 * b3) + v3 * (a1 * b2 - a2 * b1));
        x = x + change_x, y = y + change_y, phi = phi + change_phi;
        const double largest = std::max({std::fabs(change_x), std::fabs(change_y), std::fabs(change_phi)});
        if (!std::isfinite(x + y + phi)) return -1;
        if (largest < NEWTON_STEP) {
            pose[0] = x, pose[1] = y, pose[2] = phi;
            return step;
        }
    }
    return -1;
}

void rotation(const double *pose, double (*matrix)[3]) {
    const double c = std::cos(pose[2]), s = std::sin(pose[2]);
    matrix[0][0] = c, matrix[0][1] = -s, matrix[0][2] = 0.0;
    matrix[1][0] = s, matrix[1][1] = c, matrix[1][2] = 0.0;
    matrix[2][0] = 0.0, matrix[2][1] = 0.0, matrix[2][2] = 1.0;
}

void translate(double *pose, const double *offset_in_base) {
    pose[0] += offset_in_base[0];
    pose[1] += offset_in_base[1];
}

bool within(const Robot &robot, int i, double q) {
    return robot.joint_low[i] - STROKE_TOLERANCE_MM <= q && q <= robot.joint_high[i] + STROKE_TOLERANCE_MM;
}

int64_t reach(const Robot &robot, const double *pose) {
    for (int k = 0; k < 3; ++k)
        if (!(robot.box_low[k] <= pose[k] && pose[k] <= robot.box_high[k])) return OUTSIDE_BOX;
    const double c = std::cos(pose[2]), s = std::sin(pose[2]);
    const auto [q1, turn1, a1, b1, c1] = leg(robot, 0, pose[0], pose[1], c, s);
    const auto [q2, turn2, a2, b2, c2] = leg(robot, 1, pose[0], pose[1], c, s);
    const auto [q3, turn3, a3, b3, c3] = leg(robot, 2, pose[0], pose[1], c, s);
    if (!(within(robot, 0, q1) && within(robot, 1, q2) && within(robot, 2, q3))) return STROKE_LIMIT;
    const double determinant = a1 * (b2 * c3 - b3 * c2) + a2 * (b3 * c1 - b1 * c3) + a3 * (b1 * c2 - b2 * c1);
    if (!(determinant * robot.home_side >= robot.determinant_min_mm)) return SINGULAR;
    return REACHABLE;
}

}  // namespace
}  // namespace planar_3rpr
