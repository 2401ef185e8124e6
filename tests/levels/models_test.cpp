// Figures of the levels of real models, printed; only their sanity is tested.
#include "meshes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

namespace nusselt::test {
namespace {

struct Box {
    Vec3d low{1e30, 1e30, 1e30}, high{-1e30, -1e30, -1e30};
};

void extend(Box& box, Vec3f f) {
    const Vec3d p = to_double(f);
    box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y), std::min(box.low.z, p.z)};
    box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y), std::max(box.high.z, p.z)};
}

double diagonal(const Box& box) {
    return length(box.high - box.low);
}

void print_levels(const TriangleMesh& m) {
    double best_ms = 1e30;
    Built b;
    for (int i = 0; i < 3; ++i) {
        const std::clock_t start = std::clock(); // CPU time: the machine is shared
        b = build(m);
        best_ms = std::min(best_ms, 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
    }
    const Clusters& c = b.data.clusters;
    const LevelSamples& samples = b.data.samples;
    const auto at = [&](uint32_t w) { return m.positions[b.data.weld_source[w]]; };
    Box whole;
    for (const Vec3f p : m.positions) {
        extend(whole, p);
    }
    const double size = diagonal(whole);
    std::printf(
        "%s: %u vertices, %u triangles, %u welded, %u components (%u closed), %.1f ms, %.1f ms for 10,000 "
        "vertices\n",
        m.name.c_str(), b.info.vertices, b.info.triangles, b.info.welded_vertices, b.info.components,
        b.info.closed_components, best_ms, best_ms * 1e4 / b.info.vertices);
    std::printf("  level triangles clusters  tri/cluster vert/tri edges/tri  half diagonal  deviation (twice "
                "RMS), max, of the diagonal\n");
    for (uint32_t level = 0; level < b.info.levels; ++level) {
        double clusters = 0, triangles = 0, vertices = 0, edges = 0, half = 0, worst = 0, sum = 0;
        for (uint32_t i = 0; i < c.count(); ++i) {
            if (c.level[i] != level) continue;
            ++clusters;
            triangles += c.triangle_begin[i + 1] - c.triangle_begin[i];
            vertices += c.vertex_begin[i + 1] - c.vertex_begin[i];
            edges += c.edge_begin[i + 1] - c.edge_begin[i];
            Box box;
            for (uint32_t k = c.vertex_begin[i]; k < c.vertex_begin[i + 1]; ++k) {
                extend(box, at(c.vertices[k]));
            }
            half += 0.5 * diagonal(box) / size;
        }
        const uint32_t begin = samples.begin[level], end = samples.begin[level + 1];
        for (size_t i = begin; i < end; ++i) {
            Vec3d d = to_double(at(samples.vertex[i]));
            for (size_t k = 0; k < 3; ++k) {
                d = d - to_double(at(samples.corner[3 * i + k])) * double(samples.weight[3 * i + k]);
            }
            worst = std::max(worst, length(d) / size);
            sum += dot(d, d) / (size * size);
        }
        std::printf("  %5u %9.0f %8.0f %12.1f %8.3f %9.3f %14.4f  %.5f %.5f\n", level, triangles, clusters,
                    triangles / clusters, vertices / triangles, edges / triangles, half / clusters,
                    2 * std::sqrt(sum / std::max(1u, end - begin)), worst);
    }
    uint32_t coarse = 0;
    for (uint32_t i = 0; i < b.data.coarse_clusters.count(); ++i) {
        coarse += b.data.coarse_clusters.triangle_begin[i + 1] - b.data.coarse_clusters.triangle_begin[i];
    }
    double radius = 0, turn = 0, batches = 0;
    for (size_t i = 0; i + batch_receivers <= b.data.receivers.size(); i += batch_receivers, ++batches) {
        Box box;
        Vec3d axis;
        std::vector<Vec3d> normals(batch_receivers);
        for (uint32_t k = 0; k < batch_receivers; ++k) {
            const uint32_t v = b.data.receivers[i + k], w = b.data.weld[v];
            extend(box, m.positions[v]);
            for (uint32_t f = b.data.fan_begin[w]; f < b.data.fan_begin[w + 1]; ++f) {
                normals[k] = normals[k] + cross(to_double(at(b.data.fan[2 * f]) - at(w)),
                                                to_double(at(b.data.fan[2 * f + 1]) - at(w)));
            }
            const double l = length(normals[k]);
            if (l > 0) normals[k] = normals[k] * (1 / l);
            axis = axis + normals[k];
        }
        axis = axis * (1 / std::max(length(axis), 1e-30));
        double r = 0, widest = 1;
        for (uint32_t k = 0; k < batch_receivers; ++k) {
            r = std::max(
                r, length(to_double(m.positions[b.data.receivers[i + k]]) - (box.low + box.high) * 0.5));
            widest = std::min(widest, dot(axis, normals[k]));
        }
        radius += r / size;
        turn += std::acos(std::clamp(widest, -1.0, 1.0));
    }
    std::printf("  coarse %u triangles in %u clusters; batches %.0f: mean radius %.4f of the diagonal, "
                "half-angle %.1f "
                "degrees\n",
                coarse, b.data.coarse_clusters.count(), batches, radius / batches, turn / batches * 57.29578);
    EXPECT_GT(b.info.levels, 3u);
}

TEST(Models, Levels) {
    const std::string folder = std::string(NUSSELT_SHARED_DIR) + "/data/models/classic/";
    TriangleMesh m;
    if (!load_obj(folder + "spot_cow/spot.obj", m)) GTEST_SKIP() << "no models in " << folder;
    print_levels(m);
    for (const char* name : {"stanford_bunny/bunny.obj", "armadillo/armadillo.obj", "human/human_man.obj"}) {
        if (load_obj(folder + name, m)) print_levels(m);
    }
}

} // namespace
} // namespace nusselt::test
