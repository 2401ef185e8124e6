// Sine and cosine from additions and multiplications alone: the C library's own differ in the last bit
// between processors, and the scenes feed golden hashes.
#pragma once

#include <cmath>

namespace nusselt::scenes {

constexpr double pi = 3.14159265358979323846;

// Absolute error below 1e-11. Radians, |x| below 1e6.
inline double sine(double x) {
    double turn = x / (2 * pi);
    turn -= std::floor(turn + 0.5);
    if (turn > 0.25) turn = 0.5 - turn;
    if (turn < -0.25) turn = -0.5 - turn;
    const double y = turn * (2 * pi);
    const double square = y * y;
    double sum = 1;
    for (int k = 16; k >= 2; k -= 2)
        sum = 1 - sum * square / (k * (k + 1));
    return y * sum;
}

inline double cosine(double x) {
    return sine(x + pi / 2);
}

inline float sine(float x) {
    return static_cast<float>(sine(static_cast<double>(x)));
}
inline float cosine(float x) {
    return static_cast<float>(cosine(static_cast<double>(x)));
}

inline float radians(float degrees) {
    return degrees * static_cast<float>(pi / 180);
}

// 0 below `low`, 1 above `high`, smooth between.
inline float smooth_step(float low, float high, float x) {
    float t = (x - low) / (high - low);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}

} // namespace nusselt::scenes
