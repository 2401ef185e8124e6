#include "receivers.h"

#include "clusters.h"
#include "weld.h"

#include <algorithm>
#include <bit>

namespace nusselt {

namespace {

// A turn of 1 radian counts as this many radii of a batch. Larger: narrower cones, wider batches.
constexpr float normal_weight = 1.0f;

struct NormalKey {
    uint32_t bits[3];
    uint32_t vertex;
};

bool same_normal(const NormalKey& a, const NormalKey& b) {
    return std::equal(a.bits, a.bits + 3, b.bits);
}

NormalKey normal_key(const MeshDesc& desc, uint32_t vertex) {
    NormalKey key = {{0, 0, 0}, vertex};
    if (!desc.rest_normals.data) return key;
    const Vec3f n = load(desc.rest_normals, vertex);
    key.bits[0] = std::bit_cast<uint32_t>(n.x + 0.0f);
    key.bits[1] = std::bit_cast<uint32_t>(n.y + 0.0f);
    key.bits[2] = std::bit_cast<uint32_t>(n.z + 0.0f);
    return key;
}

// Fills duplicates, duplicate_of and duplicate_begin; `first_of` as in build_receivers.
void group_duplicates(const Vector<uint32_t>& first_of, const Allocator& allocator, MeshData& mesh) {
    const uint32_t count = mesh.vertex_count;
    mesh.duplicate_begin.assign(size_t(count) + 1, 0);
    for (uint32_t v = 0; v < count; ++v)
        mesh.duplicate_begin[first_of[v] + 1] += first_of[v] != v;
    for (uint32_t v = 0; v < count; ++v)
        mesh.duplicate_begin[v + 1] += mesh.duplicate_begin[v];
    mesh.duplicates.assign(mesh.duplicate_begin[count], 0);
    mesh.duplicate_of.assign(mesh.duplicate_begin[count], 0);
    Vector<uint32_t> fill(mesh.duplicate_begin, HostAllocator<uint32_t>(allocator));
    for (uint32_t v = 0; v < count; ++v) {
        if (first_of[v] == v) continue;
        const uint32_t at = fill[first_of[v]]++;
        mesh.duplicates[at] = v;
        mesh.duplicate_of[at] = first_of[v];
    }
}

} // namespace

void build_receivers(const MeshDesc& desc, const Vec3f* positions, const Allocator& allocator,
                     MeshData& mesh) {
    const HostAllocator<uint32_t> numbers(allocator);
    const uint32_t vertex_count = mesh.vertex_count;
    const uint32_t welded = static_cast<uint32_t>(mesh.weld_source.size());

    Vector<Vec3d> smooth(desc.rest_normals.data ? 0 : welded, Vec3d{}, HostAllocator<Vec3d>(allocator));
    if (!desc.rest_normals.data) {
        for (size_t t = 0; t + 2 < mesh.full_triangles.size(); t += 3) {
            const uint32_t* k = &mesh.full_triangles[t];
            const Vec3d a = to_double(positions[k[0]]);
            const Vec3d n = cross(to_double(positions[k[1]]) - a, to_double(positions[k[2]]) - a);
            for (int i = 0; i < 3; ++i) {
                smooth[k[i]] = smooth[k[i]] + n;
            }
        }
    }

    // Vertices by welded number, then those with equal normals fall together.
    Vector<uint32_t> begin(welded + 1, 0, numbers);
    for (uint32_t v = 0; v < vertex_count; ++v) {
        ++begin[mesh.weld[v] + 1];
    }
    for (uint32_t w = 0; w < welded; ++w) {
        begin[w + 1] += begin[w];
    }
    Vector<NormalKey> keys(vertex_count, NormalKey{}, HostAllocator<NormalKey>(allocator));
    {
        Vector<uint32_t> fill(begin, numbers);
        for (uint32_t v = 0; v < vertex_count; ++v) {
            keys[fill[mesh.weld[v]]++] = normal_key(desc, v);
        }
    }
    Vector<uint32_t> first_of(vertex_count, 0,
                              numbers); // the receiver that a vertex repeats; itself for a receiver
    for (uint32_t w = 0; w < welded; ++w) {
        NormalKey* range = keys.data() + begin[w];
        const uint32_t size = begin[w + 1] - begin[w];
        if (size > 1) {
            std::sort(range, range + size, [](const NormalKey& a, const NormalKey& b) {
                for (int i = 0; i < 3; ++i) {
                    if (a.bits[i] != b.bits[i]) return a.bits[i] < b.bits[i];
                }
                return a.vertex < b.vertex;
            });
        }
        for (uint32_t i = 0; i < size; ++i) {
            const bool repeats = i > 0 && same_normal(range[i], range[i - 1]);
            first_of[range[i].vertex] = repeats ? first_of[range[i - 1].vertex] : range[i].vertex;
        }
    }

    mesh.receivers.clear();
    Vector<uint32_t> not_finite(numbers);
    Vector<uint32_t> vertices(numbers), order(numbers), begins(numbers);
    Vector<SplitPoint> points{HostAllocator<SplitPoint>(allocator)};
    for (uint32_t v = 0; v < vertex_count; ++v) {
        if (first_of[v] != v) continue;
        const uint32_t w = mesh.weld[v];
        const Vec3f p = positions[w];
        if (!is_finite(p)) {
            not_finite.push_back(v);
            continue;
        }
        const Vec3f n =
            unit_or_zero(desc.rest_normals.data ? to_double(load(desc.rest_normals, v)) : smooth[w]);
        order.push_back(static_cast<uint32_t>(points.size()));
        points.push_back({{p.x, p.y, p.z, n.x, n.y, n.z}});
        vertices.push_back(v);
    }
    SplitOptions options;
    options.leaf = batch_receivers;
    options.aligned = true;
    options.direction_weight = normal_weight;
    split_medians(points, options, order, begins);
    mesh.receivers.reserve(order.size() + not_finite.size());
    for (const uint32_t i : order) {
        mesh.receivers.push_back(vertices[i]);
    }
    mesh.receivers.insert(mesh.receivers.end(), not_finite.begin(), not_finite.end());
    group_duplicates(first_of, allocator, mesh);
}

} // namespace nusselt
