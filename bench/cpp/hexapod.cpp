// Forward kinematics of rtctl/robots/hexapod.py, with what it takes from orientation.py and twist_algebra.py.

#include <algorithm>
#include <cmath>

#include "robot.hpp"

namespace {

struct Quaternion {
    double w, x, y, z;
};

struct Matrix {
    double r[9];
};

struct Symmetric {
    double m11, m12, m13, m22, m23, m33;
};

struct Vector {
    double x, y, z;
};

struct Leg {
    double length, ux, uy, uz, wx, wy, wz;
};

Quaternion quaternion_of_euler(double alpha, double beta, double gamma) {
    const double ca = std::cos(0.5 * alpha), sa = std::sin(0.5 * alpha);
    const double cb = std::cos(0.5 * beta), sb = std::sin(0.5 * beta);
    const double cg = std::cos(0.5 * gamma), sg = std::sin(0.5 * gamma);
    return {ca * cb * cg + sa * sb * sg, sa * cb * cg - ca * sb * sg, ca * sb * cg + sa * cb * sg,
            ca * cb * sg - sa * sb * cg};
}

Matrix matrix_of_quaternion(const Quaternion &q) {
    const auto [w, x, y, z] = q;
    return {{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
             2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
             2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)}};
}

Vector euler_of_quaternion(const Quaternion &q) {
    const auto [w, x, y, z] = q;
    return {std::atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
            std::asin(std::min(std::max(2.0 * (w * y - x * z), -1.0), 1.0)),
            std::atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))};
}

Quaternion turned(const Quaternion &q, double x, double y, double z) {
    const auto [w, a, b, c] = q;
    x = 0.5 * x, y = 0.5 * y, z = 0.5 * z;
    const double turn_w = w - x * a - y * b - z * c;
    const double turn_x = a + x * w + y * c - z * b;
    const double turn_y = b + y * w + z * a - x * c;
    const double turn_z = c + z * w + x * b - y * a;
    const double scale = 1.0 / std::sqrt(turn_w * turn_w + turn_x * turn_x + turn_y * turn_y + turn_z * turn_z);
    return {scale * turn_w, scale * turn_x, scale * turn_y, scale * turn_z};
}

inline Leg leg(const Robot &robot, int i, double x, double y, double z, const double *r) {
    const double px = robot.platform_mm[i][0], py = robot.platform_mm[i][1], pz = robot.platform_mm[i][2];
    const double ax = r[0] * px + r[1] * py + r[2] * pz;
    const double ay = r[3] * px + r[4] * py + r[5] * pz;
    const double az = r[6] * px + r[7] * py + r[8] * pz;
    const double dx = x + ax - robot.base_mm[i][0], dy = y + ay - robot.base_mm[i][1];
    const double dz = z + az - robot.base_mm[i][2];
    const double length = std::sqrt(dx * dx + dy * dy + dz * dz), shorten = 1.0 / length;
    const double ux = shorten * dx, uy = shorten * dy, uz = shorten * dz;
    return {length, ux, uy, uz, ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux};
}

Symmetric inverse_of_symmetric(const Symmetric &m) {
    const auto [m11, m12, m13, m22, m23, m33] = m;
    const double k11 = m22 * m33 - m23 * m23, k12 = m13 * m23 - m12 * m33, k13 = m12 * m23 - m13 * m22;
    const double scale = 1.0 / (m11 * k11 + m12 * k12 + m13 * k13);
    const double k22 = m11 * m33 - m13 * m13, k23 = m12 * m13 - m11 * m23, k33 = m11 * m22 - m12 * m12;
    return {scale * k11, scale * k12, scale * k13, scale * k22, scale * k23, scale * k33};
}

Vector times(const Symmetric &m, double x, double y, double z) {
    return {m.m11 * x + m.m12 * y + m.m13 * z, m.m12 * x + m.m22 * y + m.m23 * z, m.m13 * x + m.m23 * y + m.m33 * z};
}

// (translation, rotation) of [A C; C^T D] (translation, rotation) = (f, m)
void solve_by_blocks(const Symmetric &a, const double *c, const Symmetric &d, const Vector &f, const Vector &m,
                     Vector &translation, Vector &rotation) {
    const Symmetric inverted = inverse_of_symmetric(a);
    const Vector g1 = times(inverted, c[0], c[3], c[6]), g2 = times(inverted, c[1], c[4], c[7]);
    const Vector g3 = times(inverted, c[2], c[5], c[8]), h = times(inverted, f.x, f.y, f.z);
    const Symmetric left = inverse_of_symmetric({d.m11 - (c[0] * g1.x + c[3] * g1.y + c[6] * g1.z),
                                                 d.m12 - (c[0] * g2.x + c[3] * g2.y + c[6] * g2.z),
                                                 d.m13 - (c[0] * g3.x + c[3] * g3.y + c[6] * g3.z),
                                                 d.m22 - (c[1] * g2.x + c[4] * g2.y + c[7] * g2.z),
                                                 d.m23 - (c[1] * g3.x + c[4] * g3.y + c[7] * g3.z),
                                                 d.m33 - (c[2] * g3.x + c[5] * g3.y + c[8] * g3.z)});
    rotation = times(left, m.x - (c[0] * h.x + c[3] * h.y + c[6] * h.z), m.y - (c[1] * h.x + c[4] * h.y + c[7] * h.z),
                     m.z - (c[2] * h.x + c[5] * h.y + c[8] * h.z));
    translation = {h.x - (g1.x * rotation.x + g2.x * rotation.y + g3.x * rotation.z),
                   h.y - (g1.y * rotation.x + g2.y * rotation.y + g3.y * rotation.z),
                   h.z - (g1.z * rotation.x + g2.z * rotation.y + g3.z * rotation.z)};
}

int64_t forward(const Robot &robot, const double *motor, double *pose) {
    double x = pose[0], y = pose[1], z = pose[2];
    Quaternion q = quaternion_of_euler(pose[3], pose[4], pose[5]);
    for (int64_t step = 1; step <= NEWTON_LIMIT; ++step) {
        const Matrix r = matrix_of_quaternion(q);
        Symmetric a{}, d{};
        double c[9]{};
        Vector f{}, m{};
        for (int i = 0; i < 6; ++i) {
            const auto [length, ux, uy, uz, wx, wy, wz] = leg(robot, i, x, y, z, r.r);
            const double v = robot.home_leg_mm[i] + robot.lead_mm_per_rad[i] * motor[i] - length;
            a.m11 += ux * ux, a.m12 += ux * uy, a.m13 += ux * uz, a.m22 += uy * uy, a.m23 += uy * uz, a.m33 += uz * uz;
            c[0] += ux * wx, c[1] += ux * wy, c[2] += ux * wz;
            c[3] += uy * wx, c[4] += uy * wy, c[5] += uy * wz;
            c[6] += uz * wx, c[7] += uz * wy, c[8] += uz * wz;
            d.m11 += wx * wx, d.m12 += wx * wy, d.m13 += wx * wz, d.m22 += wy * wy, d.m23 += wy * wz, d.m33 += wz * wz;
            f.x += ux * v, f.y += uy * v, f.z += uz * v;
            m.x += wx * v, m.y += wy * v, m.z += wz * v;
        }
        Vector change, turn;
        solve_by_blocks(a, c, d, f, m, change, turn);
        x += change.x, y += change.y, z += change.z;
        q = turned(q, turn.x, turn.y, turn.z);
        if (!std::isfinite(x + y + z + q.w + q.x + q.y + q.z)) return -1;
        const double shift = std::max({std::fabs(change.x), std::fabs(change.y), std::fabs(change.z)});
        if (std::max({shift, std::fabs(turn.x), std::fabs(turn.y), std::fabs(turn.z)}) < NEWTON_STEP) {
            const Vector euler = euler_of_quaternion(q);
            pose[0] = x, pose[1] = y, pose[2] = z, pose[3] = euler.x, pose[4] = euler.y, pose[5] = euler.z;
            return step;
        }
    }
    return -1;
}

}  // namespace

// `count` times: the pose of motor[k] (6), found from pose[k] (6), into pose[k]; its number of steps into steps[k].
extern "C" void drive(const Robot *robot, const double *motor, double *pose, int64_t *steps, int64_t count) {
    for (int64_t k = 0; k < count; ++k) steps[k] = forward(*robot, motor + 6 * k, pose + 6 * k);
}
