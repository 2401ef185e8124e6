#include "nusselt/visible.h"

#include "jobs/float_environment.h"
#include "vec3.h"
#include "weld.h"

#include <cmath>

namespace nusselt {

namespace {

Status check(const Vec3View& positions, const uint32_t* indices, size_t index_count, const uint32_t* needed) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (!positions.data || !needed || (index_count > 0 && !indices))
        return bad("nothing marked: positions, indices or needed is null; give all three");
    if (positions.stride < 12 || positions.stride % 4 != 0)
        return bad("nothing marked: the stride is under 12 bytes or no multiple of 4; strides are in bytes");
    if (index_count % 3 != 0)
        return bad("nothing marked: the index count is no multiple of 3; give three indices a triangle");
    for (size_t i = 0; i < index_count; ++i) {
        if (indices[i] >= positions.count)
            return bad("nothing marked: an index is not below the number of positions; check the index "
                       "buffer");
    }
    return {};
}

// Bit k is set where the point is on the outer side of the k-th border of the picture. What is not a number
// is on no outer side.
uint32_t outside(const Camera& camera, Vec3f p) {
    const float* m = camera.clip_from_position;
    const float x = m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3];
    const float y = m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7];
    const float w = m[12] * p.x + m[13] * p.y + m[14] * p.z + m[15];
    const float edge = w * (1 + camera.margin);
    return uint32_t(x > edge) | uint32_t(x < -edge) << 1 | uint32_t(y > edge) << 2 |
           uint32_t(y < -edge) << 3 | uint32_t(w < 0) << 4;
}

bool faces_away(const Camera& camera, Vec3f a, Vec3f b, Vec3f c) {
    const Vec3f u{b.x - a.x, b.y - a.y, b.z - a.z}, v{c.x - a.x, c.y - a.y, c.z - a.z};
    const float n[3] = {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    const float* e = camera.eye;
    const float to_eye[3] = {e[0] - e[3] * a.x, e[1] - e[3] * a.y, e[2] - e[3] * a.z};
    float facing = 0, size = 0;
    for (int k = 0; k < 3; ++k) {
        facing += n[k] * to_eye[k];
        size += std::fabs(n[k] * to_eye[k]);
    }
    return facing < -1e-5f * size;
}

} // namespace

Status mark_visible(const Camera& camera, Vec3View positions, const uint32_t* indices, size_t index_count,
                    uint32_t* needed) {
    if (const Status status = check(positions, indices, index_count, needed); !status.ok()) return status;
    const jobs::FloatEnvironment environment;
    for (size_t i = 0; i < index_count; i += 3) {
        const Vec3f a = load(positions, indices[i]), b = load(positions, indices[i + 1]),
                    c = load(positions, indices[i + 2]);
        if (outside(camera, a) & outside(camera, b) & outside(camera, c)) continue;
        if (!camera.back_faces && faces_away(camera, a, b, c)) continue;
        for (size_t k = 0; k < 3; ++k)
            needed[indices[i + k] / 32] |= 1u << indices[i + k] % 32;
    }
    return {};
}

} // namespace nusselt
