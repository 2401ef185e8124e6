// Shared by every instruction set: the per-batch set-up, small enough to stay scalar.
#pragma once

#include "kernels/kernels.h"

#include <cfloat>
#include <cmath>

namespace nusselt::kernels {

inline bool is_finite(float value) {
    return std::fabs(value) <= FLT_MAX;
}

inline void prepare_lane(Batch& batch, const float normal[3][lanes], uint32_t lane) {
    float x = normal[0][lane], y = normal[1][lane], z = normal[2][lane];
    bool good = is_finite(x) && is_finite(y) && is_finite(z) && is_finite(batch.position[0][lane]) &&
                is_finite(batch.position[1][lane]) && is_finite(batch.position[2][lane]);
    // Scaled first: squares of a tiny or huge normal would leave the range of float.
    const float ax = std::fabs(x), ay = std::fabs(y), az = std::fabs(z);
    const float largest = ax > ay ? (ax > az ? ax : az) : (ay > az ? ay : az);
    good = good && largest > 0;
    if (!good || !(batch.valid >> lane & 1)) {
        batch.valid &= ~(1u << lane);
        for (uint32_t i = 0; i < 3; ++i) {
            batch.position[i][lane] = 0;
            for (uint32_t row = 0; row < 3; ++row)
                batch.axis[row][i][lane] = row == i ? 1.0f : 0.0f;
        }
        return;
    }
    x /= largest;
    y /= largest;
    z /= largest;
    const float length = std::sqrt(x * x + y * y + z * z);
    x /= length;
    y /= length;
    z /= length;
    // Scaled again: close to a pole the squares would lose their bits, and the frame its right angles.
    const float flat = std::fabs(x) > std::fabs(y) ? std::fabs(x) : std::fabs(y);
    float cosine = 1, sine = 0, across = 0;
    if (flat > 0) {
        const float u = x / flat, v = y / flat, r = std::sqrt(u * u + v * v);
        cosine = u / r;
        sine = v / r;
        across = flat * r;
    }
    batch.axis[0][0][lane] = z * cosine;
    batch.axis[0][1][lane] = z * sine;
    batch.axis[0][2][lane] = -across;
    batch.axis[1][0][lane] = -sine;
    batch.axis[1][1][lane] = cosine;
    batch.axis[1][2][lane] = 0;
    batch.axis[2][0][lane] = x;
    batch.axis[2][1][lane] = y;
    batch.axis[2][2][lane] = z;
}

inline void prepare_bounds(Batch& batch) {
    ReceiverBounds& bounds = batch.bounds;
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX}, sum[3] = {};
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(batch.valid >> lane & 1)) continue;
        for (uint32_t i = 0; i < 3; ++i) {
            const float p = batch.position[i][lane];
            low[i] = p < low[i] ? p : low[i];
            high[i] = p > high[i] ? p : high[i];
            sum[i] += batch.axis[2][i][lane];
        }
    }
    const float length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    float far = 0, least = 1;
    for (uint32_t i = 0; i < 3; ++i) {
        bounds.centre[i] = batch.valid ? 0.5f * low[i] + 0.5f * high[i] : 0.0f;
        bounds.cone[i] = length > 0 ? sum[i] / length : 0.0f;
    }
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(batch.valid >> lane & 1)) continue;
        float square = 0, along = 0;
        for (uint32_t i = 0; i < 3; ++i) {
            const float d = batch.position[i][lane] - bounds.centre[i];
            square += d * d;
            along += batch.axis[2][i][lane] * bounds.cone[i];
        }
        far = square > far ? square : far;
        least = along < least ? along : least;
    }
    bounds.radius = std::sqrt(far);
    // Beyond a right angle the bound by one cone says nothing; -1 takes in every direction.
    bounds.cone_cos = least > 0 ? least : -1.0f;
    bounds.cone_sin =
        std::sqrt(bounds.cone_cos * bounds.cone_cos < 1 ? 1 - bounds.cone_cos * bounds.cone_cos : 0.0f);
}

inline void prepare_batch(Batch& batch, const float normal[3][lanes]) {
    for (uint32_t lane = 0; lane < lanes; ++lane)
        prepare_lane(batch, normal, lane);
    prepare_bounds(batch);
}

} // namespace nusselt::kernels
