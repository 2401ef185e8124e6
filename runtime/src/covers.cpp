#include "covers.h"

#include "weld.h"

#include <algorithm>

namespace nusselt {

namespace {

// Vertices that lie in more of a level's clusters than this are left out: those around a hub of n clusters
// would be n for each of as many finer ones. A hub's neighbours tell who covers a cluster there. 10 on real
// models.
constexpr uint32_t most_around = 32;
// A cluster with more over it is one of random triangles; it is said to be covered by none, and drawn at all
// distances. 37 on real models.
constexpr size_t most_covers = 64;

// The clusters of one level around each welded vertex.
struct Incidence {
    explicit Incidence(const Allocator& a)
        : begin(HostAllocator<uint32_t>(a)), clusters(HostAllocator<uint32_t>(a)) {}
    Vector<uint32_t> begin, clusters;
};

void find_incidence(const Clusters& clusters, uint32_t first, uint32_t end, uint32_t welded, Incidence& out) {
    out.begin.assign(welded + 2, 0);
    const uint32_t first_vertex = clusters.vertex_begin[first], end_vertex = clusters.vertex_begin[end];
    for (uint32_t i = first_vertex; i < end_vertex; ++i)
        ++out.begin[clusters.vertices[i] + 2];
    for (size_t w = 2; w < out.begin.size(); ++w)
        out.begin[w] += out.begin[w - 1];
    out.clusters.resize(end_vertex - first_vertex);
    for (uint32_t c = first; c < end; ++c) {
        for (uint32_t i = clusters.vertex_begin[c]; i < clusters.vertex_begin[c + 1]; ++i)
            out.clusters[out.begin[clusters.vertices[i] + 1]++] = c;
    }
    out.begin.pop_back();
}

} // namespace

void build_covers(const Allocator& allocator, MeshData& mesh) {
    Clusters& clusters = mesh.clusters;
    const uint32_t welded = static_cast<uint32_t>(mesh.weld_source.size());
    const uint32_t levels = level_count(mesh.samples);
    Incidence coarse(allocator);
    Vector<uint32_t> sample_of(welded, none, HostAllocator<uint32_t>(allocator));
    Vector<uint32_t> found{HostAllocator<uint32_t>(allocator)};
    clusters.cover_begin.assign(1, 0);
    uint32_t first = 0;
    for (uint32_t level = 0; level < levels; ++level) {
        uint32_t end = first;
        while (end < clusters.count() && clusters.level[end] == level)
            ++end;
        uint32_t coarse_end = end;
        while (coarse_end < clusters.count() && clusters.level[coarse_end] == level + 1)
            ++coarse_end;
        find_incidence(clusters, end, coarse_end, welded, coarse);
        if (level + 1 < levels) {
            for (uint32_t i = mesh.samples.begin[level + 1]; i < mesh.samples.begin[level + 2]; ++i)
                sample_of[mesh.samples.vertex[i]] = i;
        }
        for (uint32_t c = first; c < end; ++c) {
            found.clear();
            const auto add = [&](uint32_t w) {
                if (coarse.begin[w + 1] - coarse.begin[w] > most_around) return;
                found.insert(found.end(), coarse.clusters.begin() + coarse.begin[w],
                             coarse.clusters.begin() + coarse.begin[w + 1]);
            };
            for (uint32_t i = clusters.vertex_begin[c]; i < clusters.vertex_begin[c + 1]; ++i) {
                const uint32_t w = clusters.vertices[i];
                add(w);
                for (uint32_t k = 0; k < 3 && sample_of[w] != none; ++k)
                    add(mesh.samples.corner[3 * size_t(sample_of[w]) + k]);
            }
            std::sort(found.begin(), found.end());
            found.erase(std::unique(found.begin(), found.end()), found.end());
            if (found.size() > most_covers) found.clear();
            clusters.covers.insert(clusters.covers.end(), found.begin(), found.end());
            clusters.cover_begin.push_back(static_cast<uint32_t>(clusters.covers.size()));
        }
        first = end;
    }
}

} // namespace nusselt
