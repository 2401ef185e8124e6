#include "tools/compare/floor.h"

#include "tools/trace/parallel.h"
#include "tools/trace/trace.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <cmath>

namespace nusselt::tools {

std::vector<float> exact_masks(const Moment& moment, const SampleGrid& grid, bool per_block) {
    std::vector<float> transfer(moment.all.positions.size() * 25);
    const TraceScene scene = make_trace_scene(moment.all);
    // The paper's integration: all used bits of a block weigh the same.
    std::vector<double> mean;
    if (per_block) {
        mean.assign(grid.weights.size() / 16, 0.0);
        for (size_t block = 0; block < grid.used.size() / 16; ++block) {
            double used = 0;
            for (size_t k = 0; k < 16; ++k) {
                used += grid.used[block * 16 + k];
                for (size_t i = 0; i < 25; ++i)
                    mean[block * 25 + i] += grid.weights[(block * 16 + k) * 25 + i];
            }
            for (size_t i = 0; i < 25; ++i)
                mean[block * 25 + i] /= std::max(used, 1.0);
        }
    }
    parallel_blocks(moment.traced.size(), 16, [&](size_t begin, size_t end) {
        std::vector<glm::dvec3> directions(grid.used.size());
        std::vector<uint8_t> blocked;
        for (size_t r = begin; r < end; ++r) {
            const uint32_t vertex = moment.traced[r];
            const glm::dvec3 n = glm::normalize(glm::dvec3(moment.all.normals[vertex]));
            const double across = std::sqrt(n.x * n.x + n.y * n.y);
            const double cosine = across > 0 ? n.x / across : 1, sine = across > 0 ? n.y / across : 0;
            const glm::dvec3 t(n.z * cosine, n.z * sine, -across), b(-sine, cosine, 0);
            for (size_t k = 0; k < directions.size(); ++k)
                directions[k] = double{grid.x[k]} * t + double{grid.y[k]} * b + double{grid.z[k]} * n;
            if (!trace_blocked(scene, moment.all, vertex, directions, blocked)) continue;
            double local[25], world[25];
            std::copy(grid.total, grid.total + 25, local);
            for (size_t k = 0; k < blocked.size(); ++k) {
                if (!blocked[k] || !grid.used[k]) continue;
                const double* weight = per_block ? &mean[k / 16 * 25] : &grid.weights[k * 25];
                for (size_t i = 0; i < 25; ++i)
                    local[i] -= weight[i];
            }
            rotate_to_normal(n.x, n.y, n.z, local, world);
            for (size_t i = 0; i < 25; ++i)
                transfer[size_t{25} * vertex + i] = static_cast<float>(world[i]);
        }
    });
    return transfer;
}

} // namespace nusselt::tools
