// Small vectors for the code that runs when a mesh is added.
#pragma once

#include <cmath>

namespace nusselt {

template<class T>
struct Vec3 {
    T x = 0, y = 0, z = 0;
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

template<class T>
constexpr Vec3<T> operator+(Vec3<T> a, Vec3<T> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template<class T>
constexpr Vec3<T> operator-(Vec3<T> a, Vec3<T> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template<class T>
constexpr Vec3<T> operator*(Vec3<T> a, T s) {
    return {a.x * s, a.y * s, a.z * s};
}
template<class T>
constexpr T dot(Vec3<T> a, Vec3<T> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template<class T>
constexpr Vec3<T> cross(Vec3<T> a, Vec3<T> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template<class T>
T length(Vec3<T> a) {
    return std::sqrt(dot(a, a));
}
template<class T>
bool is_finite(Vec3<T> a) {
    return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}
inline Vec3d to_double(Vec3f a) {
    return {a.x, a.y, a.z};
}
inline Vec3f to_float(Vec3d a) {
    return {static_cast<float>(a.x), static_cast<float>(a.y), static_cast<float>(a.z)};
}
// Unit length, or zero where there is no direction.
inline Vec3f unit_or_zero(Vec3d a) {
    const double l = length(a);
    return l > 0 && std::isfinite(l) ? to_float(a * (1 / l)) : Vec3f{};
}

} // namespace nusselt
