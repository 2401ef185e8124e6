#include "fans.h"

#include <algorithm>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

constexpr uint32_t longest_fan = 256;

// The next of the fan's triangles that starts at `vertex`, from number `i` on; `count` where there is none.
uint32_t find_arc(const uint32_t* arcs, uint32_t count, uint32_t i, uint32_t vertex) {
    while (i < count && arcs[2 * i] != vertex)
        ++i;
    return i;
}

// Moves triangles that close a link to the front, in the order in which they go around. Returns how many; 0
// where none do.
uint32_t take_link(uint32_t* arcs, uint32_t count) {
    for (uint32_t start = 0; start < count; ++start) {
        if (start > 0) std::swap_ranges(arcs, arcs + 2, arcs + 2 * start);
        uint32_t length = 1;
        while (arcs[2 * length - 1] != arcs[0]) {
            const uint32_t next = find_arc(arcs, count, length, arcs[2 * length - 1]);
            if (next == count) break;
            if (next != length) std::swap_ranges(arcs + 2 * length, arcs + 2 * length + 2, arcs + 2 * next);
            ++length;
        }
        if (arcs[2 * length - 1] == arcs[0]) return length;
    }
    return 0;
}

} // namespace

uint32_t shadow_fans(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers,
                     const Batch& batch, Worker& worker, JobList& jobs) {
    const MeshData& mesh = *slice.mesh;
    const float* points = frame.points.data() + 4 * size_t(slice.first_point);
    uint32_t begin[lanes], count[lanes], longest = 0, folded = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const bool valid = batch.valid >> lane & 1;
        const uint32_t w = valid ? mesh.weld[receivers[lane]] : 0;
        begin[lane] = valid ? mesh.fan_begin[w] : 0;
        count[lane] = valid ? mesh.fan_begin[w + 1] - mesh.fan_begin[w] : 0;
        longest = std::max(longest, count[lane]);
    }
    alignas(64) float corners[2][3][lanes] = {};
    for (uint32_t i = 0; i < longest; ++i) {
        uint32_t active = 0;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (i >= count[lane]) continue;
            active |= 1u << lane;
            for (uint32_t side = 0; side < 2; ++side) {
                const float* p = points + 4 * size_t(mesh.fan[2 * size_t(begin[lane] + i) + side]);
                for (uint32_t k = 0; k < 3; ++k)
                    corners[side][k][lane] = p[k];
            }
        }
        folded |= frame.kernels->fan_jobs(batch, corners, active, frame.tables->layout, jobs,
                                          worker.tally.counters);
        if (jobs.count >= job_flush) frame.kernels->run_jobs(*frame.tables, jobs, worker.masks.data());
    }
    return folded;
}

uint32_t fill_fans(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, const Batch& batch,
                   uint32_t folded, Worker& worker) {
    const MeshData& mesh = *slice.mesh;
    const float* points = frame.points.data() + 4 * size_t(slice.first_point);
    const size_t bytes = mask_bytes(frame.tables->layout);
    uint32_t full = 0;
    for (uint32_t left = folded; left; left &= left - 1) {
        const uint32_t lane = static_cast<uint32_t>(__builtin_ctz(left));
        const uint32_t w = mesh.weld[receivers[lane]];
        uint32_t count = mesh.fan_begin[w + 1] - mesh.fan_begin[w];
        if (!mesh.solid[w] || count > longest_fan) continue;
        uint32_t order[2 * longest_fan];
        std::copy_n(mesh.fan.data() + 2 * size_t(mesh.fan_begin[w]), 2 * count, order);
        alignas(64) uint8_t filled[mask_bytes(fine_layout)] = {};
        uint32_t* arcs = order;
        while (const uint32_t length = take_link(arcs, count)) {
            const float* link[longest_fan];
            for (uint32_t i = 0; i < length; ++i)
                link[i] = points + 4 * size_t(arcs[2 * i]);
            fill_fan(*frame.tables, batch, lane, link, length, filled);
            arcs += 2 * length;
            count -= length;
        }
        if (count > 0) continue;
        if (std::all_of(filled, filled + bytes, [](uint8_t byte) { return byte == 0xFF; })) {
            full |= 1u << lane;
        } else {
            std::memcpy(worker.masks.data() + lane * bytes, filled, bytes);
        }
    }
    return full;
}

} // namespace nusselt
